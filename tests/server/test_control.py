"""One program at a time commands what moves; whatever becomes of it, the robot stops."""

from __future__ import annotations

import json
import re
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import msgspec
import pytest

import wirebond
from tests.relay import Relay
from tests.server.conftest import Served, Writer
from tests.shared import codec
from tests.suspended import Suspended
from tests.waiting import PATIENCE, let_pass, moments, rounds_for, wait_until
from wirebond import NotInControlError, StoppedError
from wirebond.link.attached import words
from wirebond.link.attached.attached_link import AttachedLink
from wirebond.protocol import loads
from wirebond.server import Server
from wirebond.server.control import ControlBook
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

SAFE = 0.0  # m/s


def speeds(messages: list[wirebond.Message]) -> list[float]:
    return [m["linear"] for m in messages if m.name == "velocity"]


def test_the_first_command_takes_control_and_another_program_is_refused(served: Served) -> None:
    with served.attach() as first, served.attach() as second:
        assert first.control.holder is None
        first.send("velocity", linear=0.5, angular=0.0)
        wait_until(lambda: first.control.is_own and second.control.holder == first.control.holder)
        with pytest.raises(NotInControlError, match=r"is in control of the robot.*over=True"):
            second.send("velocity", linear=0.1, angular=0.0)
        with pytest.raises(NotInControlError):
            second.repeat("velocity", linear=0.1, angular=0.0)
        second.send("status_query")  # moves nothing
        assert speeds(served.sent()) == [0.5]


def test_taking_over_is_explicit_and_sends_the_safe_value_between(served: Served) -> None:
    with served.attach() as first, served.attach() as second:
        first.repeat("velocity", linear=0.5, angular=0.0, hold=60)
        before = speeds(served.sent_until(speeds))
        with pytest.raises(NotInControlError):
            second.take_control()
        second.take_control(over=True)
        second.send("velocity", linear=0.25, angular=0.0)
        with pytest.raises(NotInControlError):
            first.repeat("velocity", linear=0.5, angular=0.0)
        found = before + speeds(served.sent(0.3))
        assert found.index(SAFE) < found.index(0.25)
        assert set(found[: found.index(SAFE)]) == {0.5}
        assert set(found[found.index(SAFE) :]) == {SAFE, 0.25}
        wait_until(lambda: not first.control.is_own)


def test_control_is_taken_over_only_from_the_program_that_is_named(served: Served) -> None:
    with served.attach() as first, served.attach() as second:
        first.take_control()
        name = first.control.holder
        assert name is not None
        with pytest.raises(NotInControlError, match=re.escape(f"{name} is in control of the robot by now, not pad")):
            second.take_control(over="pad")
        assert first.control.is_own
        second.take_control(over=name)
        assert second.control.is_own
        wait_until(lambda: not first.control.is_own)


def test_a_program_that_lost_control_must_ask_for_it(served: Served) -> None:
    with served.attach() as first, served.attach() as second:
        first.send("velocity", linear=0.5, angular=0.0)
        second.take_control(over=True)
        second.release_control()
        with pytest.raises(NotInControlError, match=r"call take_control\(\)"):
            first.send("velocity", linear=0.5, angular=0.0)
        first.take_control()
        first.send("velocity", linear=0.5, angular=0.0)


def test_a_stop_by_anyone_holds_for_all_and_its_end_leaves_nobody_in_control(served: Served) -> None:
    with served.attach() as driver, served.attach() as watcher:
        driver.repeat("velocity", linear=0.5, angular=0.0, hold=60)
        watcher.emergency_stop()
        for link in (driver, watcher):
            assert link.stopped
            with pytest.raises(StoppedError):
                link.send("velocity", linear=0.5, angular=0.0)
        watcher.release_stop()
        wait_until(lambda: driver.control.holder is None)
        with pytest.raises(NotInControlError):
            driver.repeat("velocity", linear=0.5, angular=0.0)
        served.sent()
        assert speeds(served.sent(0.2)) == []


def test_the_end_of_a_program_ends_its_leases_at_once(served: Served) -> None:
    with served.attach() as watcher:
        with served.attach() as driver:
            driver.repeat("velocity", linear=0.5, angular=0.0, hold=60)
            served.sent_until(speeds)
        wait_until(lambda: watcher.control.holder is None)
        assert speeds(served.sent_until(lambda found: SAFE in speeds(found)))[-1] == SAFE
        assert speeds(served.sent(0.2)) == []


@pytest.mark.parametrize("end", ["close", "release"])
def test_an_orderly_end_of_control_stops_what_it_moved(served: Served, end: str) -> None:
    with served.attach() as watcher:
        driver = served.attach()
        driver.send("velocity", linear=0.5, angular=0.0)
        assert speeds(served.sent()) == [0.5]
        if end == "close":
            driver.close()
        else:
            driver.release_control()
        wait_until(lambda: watcher.control.holder is None)
        assert speeds(served.sent_until(speeds)) == [SAFE]
        driver.close()
    assert speeds(served.sent(0.1)) == []  # once is enough


def test_a_client_that_hands_over_leaves_the_robot_moving(served: Served) -> None:
    with served.attach() as watcher:
        with served.attach() as driver:
            driver.send("velocity", linear=0.5, angular=0.0)
            driver.hand_over()
        wait_until(lambda: watcher.control.holder is None)
        assert speeds(served.sent(0.1)) == [0.5]
        watcher.send("velocity", linear=0.25, angular=0.0)  # the program that goes on
        assert speeds(served.sent()) == [0.25]
    assert speeds(served.sent_until(speeds)) == [SAFE]


@pytest.mark.usefixtures("real_ages")
@pytest.mark.parametrize("how", ["send", "repeat"])
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_a_program_that_is_killed_or_stopped_cannot_leave_the_robot_driving(
    served: Served, start_writer: Callable[..., Writer], how: str, end: signal.Signals
) -> None:
    writer = start_writer(how)
    found = served.sent(0.1)
    is_stopped = end == signal.SIGSTOP
    with Suspended(writer.process.pid) if is_stopped else nullcontext():
        if not is_stopped:
            writer.process.kill()
        # How soon: `test_silence_ends_control_within_its_time`, in virtual time. A machine's pause is a silence, too.
        served.sent_until(lambda after: SAFE in speeds(found + after))
        assert speeds(served.sent(0.3)) == []
    if is_stopped:
        while (said := writer.line()) != "NotInControlError":  # it does not drive on
            assert said == "LateCommandError"
        assert set(speeds(served.sent(0.1))) <= {SAFE}


@pytest.mark.usefixtures("real_ages")
def test_a_program_whose_packets_are_dropped_without_a_close_is_silent(
    served: Served, start_writer: Callable[..., Writer]
) -> None:
    with Relay(served.server.port or 0) as relay:
        start_writer("repeat", f"wirebond://127.0.0.1:{relay.port}?token={served.server.token}")
        found = served.sent(0.1)
        relay.drops.set()
        served.sent_until(lambda after: SAFE in speeds(found + after))
        assert speeds(served.sent(0.2)) == []


# ---- the rules, in virtual time


def book_of_two() -> ControlBook:
    book = ControlBook()
    for client in "ab":
        book.add(client, f"program {client}", asks=False, now=0.0)
    return book


class Raw:
    """A client as bytes on a socket, for what the library never sends."""

    def __init__(self, served: Served) -> None:
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(PATIENCE)
        self._socket.connect(served.server.path or "")
        self._splitter = words.Splitter(words.MOST_TO_CLIENT)
        self.tick = 0
        self.number = 0
        self.controls: list[bool] = []  # of each word of the server about who is in control: is it this client?
        self.ask(words.Attach(messages="none"))

    def write(self, request: words._Request) -> None:
        self.number += 1
        request.id = self.number
        self._socket.sendall(words.json_message(request))

    def ask(self, request: words._Request) -> dict[str, Any]:
        """The answer; ``tick`` is the newest that came until then."""
        self.write(request)
        return self.answer()

    def answer(self) -> dict[str, Any]:
        """That to the newest request."""
        while True:
            for _, body in self._splitter.feed(self._socket.recv(1 << 16)):
                said = json.loads(body)
                self.tick = said.get("tick", self.tick)
                self.controls += [said["yours"]] if said.get("event") == "control" else []
                if said.get("re") == self.number:
                    return said

    def command(self, speed: float) -> words.Send:
        return words.Send(message="velocity", fields={"linear": speed, "angular": 0.0}, tick=self.tick)

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def raw(served: Served) -> Iterator[Raw]:
    client = Raw(served)
    yield client
    client.close()


def test_a_client_that_takes_control_twice_learns_that_it_has_it(raw: Raw) -> None:
    """A page that was cut off for a second assumes that its control ended, and asks for it again."""
    for times in (1, 2):
        wait_until(lambda: "ok" in raw.ask(words.Take(tick=raw.tick)))
        assert raw.controls[-times:] == [True] * times


@pytest.mark.usefixtures("real_ages")
@pytest.mark.parametrize("end", ["killed", "runs"])
def test_commands_received_during_a_stall_do_not_drive(served: Served, raw: Raw, end: str) -> None:
    wait_until(lambda: "ok" in raw.ask(raw.command(0.5)))  # with the newest tick
    stalled, goes_on = threading.Event(), threading.Event()
    served.server._owner.loop.call_soon_threadsafe(lambda: (stalled.set(), goes_on.wait(PATIENCE)))
    assert stalled.wait(PATIENCE)
    found = speeds(served.sent(0.05))
    for _ in range(20):
        raw.write(raw.command(0.25))
    if end == "killed":
        raw.close()
    let_pass(words.OLDEST_COMMAND + words.TICK_EVERY + 0.1)
    goes_on.set()
    wait_until(lambda: served.server.holder is None)
    wait_until(lambda: SAFE in found or found.extend(speeds(served.sent())), lambda: f"the safe value; {found} left")
    found += speeds(served.sent(0.2))
    assert set(found[:-1]) == {0.5}
    assert found[-1] == SAFE
    if end == "runs":
        assert raw.ask(raw.command(0.25))["error"] in ("late", "not_in_control")


@pytest.mark.usefixtures("real_ages")
@pytest.mark.parametrize("request_", [words.Take(over=True), words.ReleaseStop(over=True)])
def test_permissions_to_move_do_not_act_after_a_stall(
    served: Served, raw: Raw, request_: words.Take | words.ReleaseStop
) -> None:
    """Its program may have given up, and somebody may have stopped the robot since."""
    raw.ask(words.Stop())
    request_.tick = raw.tick
    stalled, goes_on = threading.Event(), threading.Event()
    served.server._owner.loop.call_soon_threadsafe(lambda: (stalled.set(), goes_on.wait(PATIENCE)))
    assert stalled.wait(PATIENCE)
    raw.write(request_)
    let_pass(words.OLDEST_COMMAND + words.TICK_EVERY + 0.1)
    goes_on.set()
    assert raw.answer()["error"] == "late"
    assert served.link.stopped
    assert served.server.holder is None


@pytest.mark.usefixtures("real_ages")
def test_a_program_that_still_waits_takes_control_and_releases_after_a_stall(served: Served) -> None:
    with served.attach() as link:
        link.emergency_stop()
        engine = link.internals.engine
        assert isinstance(engine, AttachedLink)
        engine._tick = 0  # long ago, until the next tick comes
        let_pass(words.OLDEST_COMMAND + words.TICK_EVERY + 0.1)
        engine._tick = 0
        link.release_stop()
        engine._tick = 0
        link.take_control()
        assert link.control.is_own


# The MCU answers `move` and `ask` with messages of one id, so that a request waits for the reply to the one before.
_ASKED_IN_TURN = """
wirebond: 1
protocol: arm
link: {baud: 115200}
frame: [magic: 0xAA 0x55, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  move: {id: 1, sender: host, reply: moved, fields: {speed: {type: i16}}}
  ask: {id: 2, sender: host, reply: asked}
  moved: {id: 3, sender: mcu, fields: {speed: {type: i16}}}
  asked: {id: 3, sender: mcu, fields: {place: {type: i16}}}
deadlines: [{message: move, at: mcu, after: 1 s, then: stop}]
emergency_stop: {message: move, speed: 0}
"""


@pytest.mark.usefixtures("real_ages")
@pytest.mark.parametrize("end", ["killed", "taken over", "waits for long"])
def test_a_command_that_waits_for_its_turn_leaves_only_in_control_and_in_time(tmp_path: Path, end: str) -> None:
    proto, pty = wirebond.Codec(loads(_ASKED_IN_TURN)), PtyPort()
    path = tmp_path / "server.sock"
    with wirebond.open(proto, pty.path) as link, Server(link, path) as server:
        served = Served(proto, pty, link, server, f"wirebond://{path}")
        with served.attach() as other:
            raw, asks = Raw(served), Raw(served)
            asks.ask(words.Send(message="ask", fields={}, tick=asks.tick, reply=60))
            move = words.Send(message="move", fields={"speed": 5}, reply=60)
            # Its turn comes when `ask` is answered.
            wait_until(lambda: "ok" in raw.ask(msgspec.structs.replace(move, tick=raw.tick)), "it is accepted")
            if end == "killed":
                raw.close()
                wait_until(lambda: server.holder is None)
            elif end == "taken over":
                other.take_control(over=True)
            else:
                for _ in rounds_for(words.OLDEST_COMMAND + 0.05):
                    raw.ask(words.Ask(what="state"))
                    raw.write(words.Beat(tick=raw.tick))
            pty.write(proto.encode("asked", place=1))
            wait_until(lambda: link.stats.receive.frames > 0)
            asks.ask(words.Ask(what="stats"))
            assert [m["speed"] for m in served.sent(0.2) if m.name == "move" and m["speed"]] == []
            asks.close()
            if end != "killed":
                raw.close()
    pty.close()


def test_a_command_that_waits_for_its_turn_leaves_when_that_comes_in_time(tmp_path: Path) -> None:
    proto, pty = wirebond.Codec(loads(_ASKED_IN_TURN)), PtyPort()
    path = tmp_path / "server.sock"
    with wirebond.open(proto, pty.path) as link, Server(link, path) as server:
        served = Served(proto, pty, link, server, f"wirebond://{path}")
        raw, asks = Raw(served), Raw(served)
        for _ in moments("a turn that comes in time"):
            asks.ask(words.Send(message="ask", fields={}, tick=asks.tick, reply=60))
            raw.ask(words.Send(message="move", fields={"speed": 5}, reply=60, tick=raw.tick))
            pty.write(proto.encode("asked", place=1))
            if 5 in [m["speed"] for m in served.sent(0.2) if m.name == "move"]:
                break  # else a pause let the command become too old
            pty.write(proto.encode("asked", place=1))
        asks.close()
        raw.close()
    pty.close()


def test_a_program_whose_server_dies_as_it_takes_control_must_take_it_again(tmp_path: Path) -> None:
    proto, pty, path = codec("diffdrive"), PtyPort(), tmp_path / "server.sock"
    with wirebond.open(proto, pty.path) as own:
        server = Server(own, path)
        with wirebond.open(proto, f"wirebond://{path}") as link:
            engine = link.internals.engine
            assert isinstance(engine, AttachedLink)
            exchange = engine._exchange

            def dies(request: words._Request, *rest: Any) -> dict[str, Any]:
                answer = exchange(request, *rest)
                server.close()
                wait_until(lambda: link.state == "down")
                return answer

            engine._exchange = dies  # type: ignore[method-assign]
            link.take_control()
            engine._exchange = exchange  # type: ignore[method-assign]
            with Server(own, path):
                wait_until(lambda: link.state != "down")
                with pytest.raises(NotInControlError):
                    link.send("velocity", linear=0.5, angular=0.0)
                link.take_control()
                link.send("velocity", linear=0.5, angular=0.0)
    pty.close()


@pytest.mark.usefixtures("real_ages")
def test_silence_ends_control_within_its_time() -> None:
    book = book_of_two()
    now = 0.0
    for _ in range(40):  # a beat each 0.1 s
        tick = book.ticks.next(now)
        assert book.refuses("a", tick, now) is None
        book.beat("a", tick, now)
        now += words.BEAT_EVERY
        assert not book.silent(now)
    last = now - words.BEAT_EVERY
    assert not book.silent(last + words.SILENCE)
    assert book.silent(last + words.SILENCE + 0.001)


@pytest.mark.usefixtures("real_ages")
def test_a_command_that_was_under_way_for_long_is_refused() -> None:
    book = book_of_two()
    old = book.ticks.next(0.0)
    for n in range(1, 10):
        book.ticks.next(n * words.TICK_EVERY)
    now = 9 * words.TICK_EVERY
    refused = book.refuses("a", old, now)
    assert refused is not None
    assert refused[0] == "late"
    assert book.holder is None
    assert book.refuses("a", book.ticks.newest, now) is None


@pytest.mark.usefixtures("real_ages")
def test_a_command_with_the_newest_tick_is_old_if_no_tick_was_made_for_long() -> None:
    book = book_of_two()
    newest = book.ticks.next(0.0)
    assert book.refuses("a", newest, words.TICK_EVERY + words.OLDEST_COMMAND) is None
    refused = book.refuses("a", newest, words.TICK_EVERY + words.OLDEST_COMMAND + 0.001)
    assert refused is not None
    assert refused[0] == "late"


@pytest.mark.usefixtures("real_ages")
def test_beats_that_come_late_in_one_burst_show_nothing() -> None:
    book = book_of_two()
    tick = book.ticks.next(0.0)
    assert book.refuses("a", tick, 0.0) is None
    for n in range(1, 20):
        book.ticks.next(n * words.TICK_EVERY)
    book.beat("a", tick, 0.95)
    assert book.silent(0.95)


@pytest.mark.usefixtures("real_ages")
def test_a_tick_that_never_was_is_late() -> None:
    book = book_of_two()
    refused = book.refuses("a", 10_000, 0.0)
    assert refused is not None
    assert refused[0] == "late"
