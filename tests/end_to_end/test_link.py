"""A link over a real tty (a pty): whole frames, reconnect, leases, deadlines, the account of what was sent."""

from __future__ import annotations

import grp
import os
import pickle
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import wirebond
from tests.shared import PROTOCOLS, ROOT, account_closes, codec
from tests.waiting import PATIENCE, let_pass, moments, wait_until
from wirebond import LinkDownError, MessageError, PortError, StoppedError, UsageError
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live


@pytest.fixture
def port() -> Iterator[PtyPort]:
    pty = PtyPort()
    yield pty
    pty.close()


def read_until(port: PtyPort, size: int) -> bytes:
    data = bytearray()
    wait_until(lambda: len(data) >= size or data.extend(port.read(0.05)), lambda: f"{size} bytes; there is {data!r}")
    return bytes(data)


def receive(link: wirebond.Link, count: int) -> list[wirebond.Message]:
    messages: list[wirebond.Message] = []
    wait_until(
        lambda: len(messages) >= count or messages.extend(link.receive(0.1)),
        lambda: f"{count} messages; there are {messages}",
    )
    return messages


def wait_for_state(link: wirebond.Link, state: str) -> None:
    wait_until(lambda: link.state == state, lambda: f"the link is {state}; it stays {link.state}")


def send_account_closes(stats: wirebond.SendStats) -> bool:
    refused = stats.refused_down + stats.refused_full + stats.refused_stopped
    ended = stats.sent + stats.queued + stats.replaced + stats.expired + stats.overruled + stats.aborted
    return stats.offered == stats.accepted + refused and stats.accepted == ended


def test_frames_go_out_whole_and_come_in_with_fields(port: PtyPort) -> None:
    proto = codec("diffdrive")
    with wirebond.open(proto, port.path) as link:
        link.send("velocity", linear=0.5, angular=0.0)
        expected = proto.encode("velocity", linear=0.5, angular=0.0)
        assert read_until(port, len(expected)) == expected
        port.write(proto.encode("odometry", left_ticks=3, right_ticks=-3))
        (message,) = receive(link, 1)
        assert (message.name, message.fields) == ("odometry", {"left_ticks": 3, "right_ticks": -3})
        newest = link.latest("odometry")
        assert newest is not None
        assert 0 <= newest.age < 3600  # its time is that of the monotonic clock
        assert account_closes(link.stats.receive)
        assert send_account_closes(link.stats.send)
        assert link.state == "up"


def test_objects_of_generated_modules_are_sent_as_their_name_and_values(port: PtyPort) -> None:
    class Velocity:
        NAME = "velocity"

        def values(self) -> dict[str, float]:
            return {"linear": 0.5, "angular": 0.25}

    proto = codec("diffdrive")
    expected = proto.encode("velocity", linear=0.5, angular=0.25)
    with wirebond.open(proto, port.path) as link:
        link.send(Velocity())
        assert read_until(port, len(expected)) == expected
        link.repeat(Velocity(), hold=60)
        assert read_until(port, len(expected))[: len(expected)] == expected
        with pytest.raises(UsageError, match="Velocity has its values already"):
            link.send(Velocity(), linear=0.1)


def test_iterating_gives_messages_in_order(port: PtyPort) -> None:
    proto = codec("diffdrive")
    with wirebond.open(proto, port.path) as link:
        for i in range(100):
            port.write(proto.encode("odometry", left_ticks=i, right_ticks=0))
        seen = []
        for message in link:
            seen.append(message.fields["left_ticks"])
            if len(seen) == 100:
                break
    assert seen == list(range(100))


def test_every_frame_handed_over_arrives_while_the_other_side_reads_slowly(port: PtyPort) -> None:
    proto = codec("diffdrive")
    frames = 3000  # more than the pty's buffer holds
    with wirebond.open(proto, port.path) as link:
        decoder = proto.decoder("host")
        received: list[wirebond.Message] = []
        accepted = 0
        for i in range(frames):
            try:
                link.send("velocity", linear=i % 100 / 100, angular=0)
                accepted += 1
            except wirebond.QueueFullError:
                received += decoder.feed(port.read(0.05))
        wait_until(
            lambda: len(received) >= accepted or received.extend(decoder.feed(port.read(0.05))),
            lambda: f"{accepted} frames; {len(received)} came",
        )
        stats = link.stats.send
        assert len(received) == accepted == stats.sent
        assert stats.offered == frames
        assert send_account_closes(stats)
        assert sum(decoder.stats.discarded_bytes.values()) == 0


def test_link_comes_back_when_the_device_does(tmp_path: Path) -> None:
    proto = codec("diffdrive")
    name = tmp_path / "tty"
    first, second = PtyPort(), PtyPort()
    name.symlink_to(first.path)
    with wirebond.open(proto, name) as link:
        first.write(proto.encode("odometry", left_ticks=1, right_ticks=1))
        assert receive(link, 1)[0].fields["left_ticks"] == 1
        name.unlink()  # before its number is free: another pty may get it
        first.close()
        wait_for_state(link, "down")
        with pytest.raises(LinkDownError, match="velocity was not sent: "):
            link.send("velocity", linear=0, angular=0)
        name.symlink_to(second.path)
        wait_for_state(link, "stale")
        second.write(proto.encode("odometry", left_ticks=2, right_ticks=2))
        assert receive(link, 1)[0].fields["left_ticks"] == 2
        link.send("velocity", linear=0, angular=0)
        assert len(read_until(second, 11)) == 11
        stats = link.stats
        assert stats.reconnects >= 1
        assert stats.send.refused_down == 1
        assert send_account_closes(stats.send)
        assert account_closes(stats.receive)
    second.close()


def test_repeated_value_ends_with_its_lease_and_the_safe_value(port: PtyPort) -> None:
    proto = codec("diffdrive")
    with wirebond.open(proto, port.path) as link:
        decoder = proto.decoder("host")
        speeds: list[float] = []

        def read() -> list[float]:
            return [m.fields["linear"] for m in decoder.feed(port.read(0.05))]

        for _ in moments("a repeated value"):
            link.repeat("velocity", linear=0.5, angular=0.0, hold=0.3)
            if 0.5 in (speeds := read()):  # or a pause of the machine was longer than the lease
                break
        wait_until(lambda: speeds[-1] == 0 or speeds.extend(read()), lambda: f"the safe value after {speeds}")
        let_pass(0.2)
        speeds += read()
    assert speeds[-1] == 0  # the safe value, once, and then silence
    assert set(speeds[:-1]) == {0.5}
    assert 1 <= len(speeds[:-1]) <= 8  # at 20 Hz for 0.3 s


def test_host_deadlines_run_from_start_up_and_end_with_a_message(port: PtyPort, tmp_path: Path) -> None:
    text = (PROTOCOLS / "diffdrive.yaml").read_text()
    fast = tmp_path / "fast.yaml"
    fast.write_text(text.replace("after: 3 s, then: warn", "after: 1100 ms, then: warn"))
    proto = wirebond.load(fast)
    slow = tmp_path / "slow.yaml"
    slow.write_text(
        text.replace("after: 3 s, then: warn", "after: 60 s, then: warn").replace("after: 5 s", "after: 60 s")
    )
    with wirebond.open(slow, port.path) as link:
        assert link.deadlines == {"warn": False, "stop_navigation": False}
    with wirebond.open(proto, port.path) as link:
        changes: list[bool] = []
        link.on_deadline("warn")(lambda change: changes.append(change.struck))
        wait_until(lambda: link.deadlines["warn"], "the deadline strikes")
        wait_until(lambda: changes == [True], "it is said")
        port.write(proto.encode("status", battery=12.0, errors=[], state=[]))
        wait_until(lambda: changes[1:2] == [False], "its end is said")


@pytest.mark.parametrize("hold", [0.0, -1.0, float("nan"), float("inf"), 1e30])
def test_lease_without_end_is_refused(port: PtyPort, hold: float) -> None:
    with wirebond.open(codec("diffdrive"), port.path) as link, pytest.raises(UsageError, match="at most 60 s"):
        link.repeat("velocity", linear=0.5, hold=hold)


def test_emergency_stop_overtakes_a_full_queue(port: PtyPort) -> None:
    proto = codec("diffdrive")
    with wirebond.open(proto, port.path) as link:
        with pytest.raises(wirebond.QueueFullError):  # noqa: PT012  (which of the calls it is, nobody can know)
            for _ in range(100_000):
                link.send("velocity", linear=1.0, angular=0)
        link.emergency_stop()
        already_written = link.stats.send.sent  # read behind the call, before which frames still left
        decoder = proto.decoder("host")
        speeds: list[float] = []
        wait_until(
            lambda: 0.0 in speeds or speeds.extend(m.fields["linear"] for m in decoder.feed(port.read(0.05))),
            "the stop",
        )
        # Before it came only what the system's own buffer held already, and the frame that was half out.
        assert speeds.index(0.0) <= already_written + 1
        assert link.stats.send.offered > already_written + 1000


def test_second_opener_finds_the_port_in_use_until_the_first_closes(port: PtyPort) -> None:
    proto = codec("diffdrive")
    with wirebond.open(proto, port.path), pytest.raises(PortError, match="is in use by another program"):
        wirebond.open(proto, port.path)
    wirebond.open(proto, port.path).close()


def test_messages_of_the_other_end_are_not_sent(port: PtyPort) -> None:
    with wirebond.open(codec("diffdrive"), port.path) as link:
        with pytest.raises(MessageError, match="odometry is sent by the mcu"):
            link.send("odometry", left_ticks=0, right_ticks=0)
        with pytest.raises(MessageError, match=r"outside -2 \.\.\. 2 m/s"):
            link.send("velocity", linear=9, angular=0)
        assert link.stats.send.offered == 0


def test_emergency_stop_sends_the_declared_message(port: PtyPort) -> None:
    proto = codec("diffdrive")
    with wirebond.open(proto, port.path) as link:
        link.emergency_stop()
        assert read_until(port, 11) == proto.encode("velocity", linear=0, angular=0)


def test_a_loop_that_ends_early_leaves_the_rest_to_the_next_and_to_receive(port: PtyPort) -> None:
    proto = codec("diffdrive")
    with wirebond.open(proto, port.path) as link:
        port.write(b"".join(proto.encode("odometry", left_ticks=i, right_ticks=0) for i in range(10)))
        seen: list[int] = []
        for _ in range(3):
            for message in link:
                seen.append(message.fields["left_ticks"])
                break
        while len(seen) < 10:
            seen += [message.fields["left_ticks"] for message in link.receive(PATIENCE)]
        assert seen == list(range(10))
        assert link.stats.dropped_messages == 0


def test_messages_before_close_can_be_taken_after_it_and_then_there_is_an_end(port: PtyPort) -> None:
    proto = codec("diffdrive")
    for take in (lambda link: link.receive(), list):
        link = wirebond.open(proto, port.path)
        port.write(proto.encode("odometry", left_ticks=1, right_ticks=0))
        wait_until(lambda link=link: link.stats.receive.frames, "a frame")
        link.close()
        assert [message.name for message in take(link)] == ["odometry"]
        assert list(link) == []
        with pytest.raises(LinkDownError, match="is closed; no message will come"):
            link.receive(PATIENCE)


def test_a_closed_link_refuses_what_it_cannot_do(port: PtyPort) -> None:
    link = wirebond.open(codec("diffdrive"), port.path)
    link.close()
    for call in (
        lambda: link.send("velocity", linear=0, angular=0),
        lambda: link.repeat("velocity", linear=0, angular=0),
        link.emergency_stop,
    ):
        with pytest.raises(LinkDownError, match=r"is closed; .* was not sent"):
            call()
    assert not link.stopped
    assert send_account_closes(link.stats.send)


def test_closing_wakes_a_thread_that_waits(port: PtyPort) -> None:
    link = wirebond.open(codec("diffdrive"), port.path)
    ended = threading.Event()
    taker = threading.Thread(target=lambda: (list(link), ended.set()))
    taker.start()
    let_pass(0.05)
    link.close()
    assert ended.wait(PATIENCE)
    taker.join()


def test_a_stop_says_what_it_holds(port: PtyPort) -> None:
    with wirebond.open(codec("diffdrive"), port.path) as link:
        assert not link.stopped
        link.emergency_stop()
        assert link.stopped
        with pytest.raises(StoppedError, match="an emergency stop holds velocity until release_stop") as caught:
            link.send("velocity", linear=1.0, angular=0)
        assert (caught.value.message, caught.value.stopped) == ("velocity", ("velocity",))
        again = pickle.loads(pickle.dumps(caught.value))
        assert (str(again), again.stopped) == (str(caught.value), ("velocity",))
        link.release_stop()
        assert not link.stopped


def test_closing_twice_and_from_with_is_fine(port: PtyPort) -> None:
    with wirebond.open(codec("diffdrive"), port.path) as link:
        link.close()
        link.close()
    assert list(link) == []


class TestPortThatCannotBeOpened:
    def test_missing_port_is_named(self) -> None:
        with pytest.raises(PortError, match="there is no port /dev/ttyNOPE; plug it in"):
            wirebond.open(codec("diffdrive"), "/dev/ttyNOPE")

    def test_file_is_no_port(self, tmp_path: Path) -> None:
        file = tmp_path / "file"
        file.write_text("hello")
        with pytest.raises(PortError, match="is not a serial port"):
            wirebond.open(codec("diffdrive"), file)

    def test_folder_is_no_port(self, tmp_path: Path) -> None:
        with pytest.raises(PortError, match="is a folder, and a serial port is expected"):
            wirebond.open(codec("diffdrive"), tmp_path)

    def test_port_without_permission_says_what_to_do(self, port: PtyPort) -> None:
        is_root = os.geteuid() == 0
        Path(port.path).chmod(0o660 if is_root else 0)
        if is_root:
            os.chown(port.path, -1, grp.getgrnam("dialout").gr_gid)
        expected = "join its group with `sudo usermod -aG dialout $USER`" if is_root else "no permission to open"
        proto, opens = codec("diffdrive"), wirebond.open  # imported now: the user `nobody` may not read all modules
        child = os.fork()
        if child == 0:  # as nobody: root may open anything
            if is_root:
                os.setgroups([])
                os.setgid(65534)
                os.setuid(65534)
            try:
                opens(proto, port.path)
            except PortError as error:
                os._exit(0 if expected in str(error) else 2)
            os._exit(1)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0

    @pytest.mark.parametrize("baud", [0, -1, 10**9])
    def test_impossible_baud_is_refused(self, port: PtyPort, baud: int) -> None:
        with pytest.raises(UsageError, match="expected a whole number from 1 to 100000000 bits per second"):
            wirebond.open(codec("diffdrive"), port.path, baud=baud)


def test_an_action_that_no_deadline_has_is_answered_with_those_that_there_are(port: PtyPort) -> None:
    both = "it has warn, stop_navigation"
    near = f"did you mean stop_navigation? {both}"
    sentences = {
        "nope": f"diffdrive has no deadline 'nope' at the host; {both}",
        "stop_navigatoin": f"diffdrive has no deadline 'stop_navigatoin' at the host; {near}",
        "odometry": f"diffdrive has no deadline 'odometry' at the host; {near}",
        7: f"7 is not an action of a deadline; {both}",
    }
    with wirebond.open(codec("diffdrive"), port.path) as link:
        for action, sentence in sentences.items():
            with pytest.raises(UsageError) as raised:
                link.recover(action)  # type: ignore[arg-type]
            assert str(raised.value) == sentence
    with wirebond.open(codec("enterprize"), port.path) as link, pytest.raises(UsageError) as raised:
        link.recover("nope")
    assert str(raised.value).startswith("enterprize has no deadline at the host, so that there is nothing to recover;")


def test_a_link_knows_its_replies_from_what_it_sends(port: PtyPort) -> None:
    proto = wirebond.load(ROOT / "tests" / "formats" / "by_request.yaml")
    with wirebond.open(proto, port.path) as link:
        for request, reply, values in (
            ("read_speed", "speed", {"speed": 0.25}),
            ("read_state", "state", {"battery": 11.5, "faults": 1, "uptime": 7}),
        ):
            link.send(request)
            expected = proto.encode(request)
            assert read_until(port, len(expected)) == expected
            link.send("drive", speed=0.1)  # no request: what was asked stays
            assert read_until(port, len(proto.encode("drive", speed=0.1)))
            port.write(proto.encode(reply, values))
            (message,) = receive(link, 1)
            assert (message.name, message.fields) == (reply, values)
