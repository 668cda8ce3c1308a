"""Addresses at the host: a lease for each servo, a stop for each, and frames that are for others."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import pytest

import wirebond
from tests.shared import ROOT, account_closes
from tests.waiting import PATIENCE, moments, rounds_for, wait_until
from wirebond import Codec, Message, UsageError, _engine, load
from wirebond.link.settings import engine_settings, safe_value
from wirebond.protocol import loads
from wirebond.protocol.model import End
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.usefixtures("links")

BUS = load(ROOT / "tests" / "formats" / "servo_options.yaml")
BROADCAST = Codec(
    loads(
        (ROOT / "tests" / "formats" / "servo_options.yaml")
        .read_text()
        .replace("emergency_stop: {message: move,", "emergency_stop: {message: move, header: {servo: 0xFE},")
    )
)
ENDS = """\
wirebond: 1
protocol: ends
frame:
  - magic: 0xA5
  - {field: to, type: u8, default: {host: 1, mcu: 100}, address: receiver, broadcast: 255}
  - {field: source, type: u8, default: {host: 100, mcu: 1}, address: sender}
  - id: u8
  - payload: by_id
  - check: crc-16/modbus
messages:
  ask: {id: 1, sender: host, reply: state}
  state: {id: 2, sender: mcu, every: 100 ms, fields: {x: {type: u8}}}
deadlines: [{message: state, at: host, after: 1 s, then: warn}]
"""


@dataclass
class Line:
    """A link under virtual time on a line that takes everything."""

    codec: Codec
    now: int = 1_000_000
    core: _engine.LinkCore = field(init=False)
    written: list[Message] = field(default_factory=list)

    def __post_init__(self) -> None:
        settings = engine_settings(self.codec, 1_000_000)
        self.core = _engine.LinkCore(
            self.codec.tables.protocol, self.codec.tables.format_for(End.MCU), settings, self.now
        )
        self.core.port_up(self.now)
        self._heard = self.codec.decoder("host")

    def send(self, name: str, *, header: dict[str, Any] | None = None, **values: Any) -> int:
        return self._give(self.core.send, name, header, values, ())

    def repeat(self, name: str, hold: float, *, header: dict[str, Any] | None = None, **values: Any) -> int:
        return self._give(self.core.repeat, name, header, values, (hold,))

    def _give(self, call: Any, name: str, header: Any, values: dict[str, Any], more: tuple[Any, ...]) -> int:
        model = self.codec.model.message(name)
        address = self.codec.tables.address_of(header or {}) or 0
        for stop in self.codec.model.emergency_stop:
            if stop.message == name and not self.core.is_stopped():
                assert self.core.note_safe(safe_value(self.codec, stop, header or {}))
        reply = -1 if model.reply is None else self.codec.tables.indices[model.reply]
        frame = self.codec.encode(name, values, header=header)
        return int(call(self.codec.tables.indices[name], frame, *more, reply, self.now, True, address))

    def run(self, microseconds: int) -> list[tuple[str, int, dict[str, Any]]]:
        """Return what left in this time: message, address, values."""
        left: list[tuple[str, int, dict[str, Any]]] = []
        for _ in range(microseconds // 1000):
            self.core.poll(self.now)
            while chunk := self.core.to_write(self.now):
                self.core.written(len(chunk), self.now)
                left += [(m.name, m.header["servo"], m.fields) for m in self._heard.feed(chunk, self.now / 1e6)]
            self.now += 1000
        return left

    def hear(self, name: str, *, header: dict[str, Any] | None = None, **values: Any) -> list[str]:
        """Give the link a frame of the MCU; return the messages that the program gets, by name."""
        self.core.received(self.codec.encode(name, values, header=header, sender=End.MCU), self.now, self.now)
        return [message.name for message in self.core.receive()]


def test_two_servos_have_a_schedule_each() -> None:
    line = Line(BUS)
    line.repeat("move", 1.0, header={"servo": 3}, angle=0.3)
    line.repeat("move", 1.0, header={"servo": 7}, angle=0.7)
    left = line.run(99_000)
    assert [f["angle"] for _, servo, f in left if servo == 3] == [0.3] * 5
    assert [f["angle"] for _, servo, f in left if servo == 7] == [0.7] * 5
    assert len(left) == 10


def test_the_end_of_a_lease_sends_the_safe_value_to_its_address_alone() -> None:
    line = Line(BUS)
    line.repeat("move", 0.05, header={"servo": 3}, angle=0.3)
    line.repeat("move", 1.0, header={"servo": 7}, angle=0.7)
    left = line.run(60_000)
    assert left.count(("move", 3, {"angle": 0.0, "torque": 0})) == 1
    after = line.run(60_000)
    assert {servo for _, servo, _ in after} == {7}
    assert {fields["angle"] for _, servo, fields in (*left, *after) if servo == 7} == {0.7}
    line = Line(BUS)
    line.repeat("move", 0.05, header={"servo": 3}, angle=0.3)
    assert line.run(200_000)[-1] == ("move", 3, {"angle": 0.0, "torque": 0})


def test_a_message_ends_with_its_safe_value_at_its_address_alone() -> None:
    line = Line(BUS)
    move = BUS.tables.indices["move"]
    assert not line.core.end_safely(move, 3)  # nothing went there: it has no safe value
    line.repeat("move", 1.0, header={"servo": 7}, angle=0.7)
    line.repeat("move", 1.0, header={"servo": 3}, angle=0.3)
    line.run(20_000)
    for servo in (7, 3, 3):
        line.send("move", header={"servo": servo}, angle=1.0)
    assert line.core.end_safely(move, 3)
    stop, *rest = line.run(100_000)
    assert stop == ("move", 3, {"angle": 0.0, "torque": 0})  # before all that waits
    assert {servo for _, servo, _ in rest} == {7}
    line.core.close()
    assert not line.core.end_safely(move, 3)
    assert line.run(20_000) == [("move", 7, {"angle": 0.0, "torque": 0})]  # whose lease lived


def test_a_safe_value_waits_for_the_port() -> None:
    line = Line(BUS)
    line.send("move", header={"servo": 3}, angle=1.0)
    line.run(1000)
    line.core.port_down(line.now)
    assert line.core.end_safely(BUS.tables.indices["move"], 3)
    assert line.run(1000) == []
    line.core.port_up(line.now)
    assert line.run(1000) == [("move", 3, {"angle": 0.0, "torque": 0})]


def test_a_stop_reaches_every_address_that_the_message_went_to() -> None:
    line = Line(BUS)
    line.repeat("move", 1.0, header={"servo": 3}, angle=0.3)
    line.send("move", header={"servo": 7, "options": ["quiet"]}, angle=0.7)
    line.run(20_000)
    line.core.stop(line.now)
    left = line.run(20_000)
    assert sorted(servo for _, servo, _ in left) == [1, 3, 7]
    assert all(values == {"angle": 0.0, "torque": 0} for _, _, values in left)
    assert line.send("move", header={"servo": 9}, angle=0.1) == 3  # stopped
    assert {servo for _, servo, _ in line.run(200_000)} == {1, 3, 7}  # and repeated
    line.core.release_stop()
    assert line.run(100_000) == []


def test_a_stop_by_broadcast_needs_no_other() -> None:
    line = Line(BROADCAST)
    line.repeat("move", 1.0, header={"servo": 3}, angle=0.3)
    line.run(20_000)
    line.core.stop(line.now)
    assert {servo for _, servo, _ in line.run(100_000)} == {0xFE}
    line = Line(BROADCAST)
    line.repeat("move", 0.05, header={"servo": 3}, angle=0.3)
    assert line.run(200_000)[-1] == ("move", 3, {"angle": 0.0, "torque": 0})  # a lease's end stops its servo alone


def test_a_safe_value_takes_no_flag_of_the_command() -> None:
    line = Line(BUS)
    line.repeat("move", 0.05, header={"servo": 3, "options": ["quiet"]}, angle=0.3)
    heard = BUS.decoder("host")
    frames = []
    for _ in range(200):
        line.core.poll(line.now)
        while chunk := line.core.to_write(line.now):
            line.core.written(len(chunk), line.now)
            frames += heard.feed(chunk)
        line.now += 1000
    assert frames[-2].header["options"] == ["quiet"]
    assert (frames[-1].header["options"], frames[-1].header["servo"]) == ([], 3)


def test_one_address_can_be_silenced() -> None:
    line = Line(BUS)
    for servo in (3, 7):
        line.repeat("move", 1.0, header={"servo": servo}, angle=0.3)
    line.core.stop_repeating(BUS.tables.indices["move"], 3)
    assert {servo for _, servo, _ in line.run(100_000)} == {7}
    line.core.stop_repeating(BUS.tables.indices["move"])
    assert line.run(100_000) == []


def test_every_address_of_a_byte_has_room() -> None:
    line = Line(BUS)
    for servo in range(256):
        assert line.repeat("move", 1.0, header={"servo": servo}, angle=0.1) == 0
    assert len({servo for _, servo, _ in line.run(60_000)}) == 256
    send = line.core.stats()["send"]
    assert send["offered"] == send["accepted"] + send["refused_down"] + send["refused_full"] + send["refused_stopped"]
    kept = ("sent", "queued", "replaced", "expired", "overruled", "aborted")
    assert send["accepted"] == sum(send[name] for name in kept)


def test_a_reply_counts_only_from_an_address_that_was_asked() -> None:
    line = Line(BUS)
    assert line.hear("state", header={"servo": 9}, angle=0, voltage=7) == ["state"]  # nobody asked yet
    line.send("ask", header={"servo": 3})
    line.run(2000)
    assert line.hear("state", header={"servo": 9}, angle=0, voltage=7) == []
    assert line.hear("state", header={"servo": 3}, angle=0, voltage=7) == ["state"]
    line.send("ask", header={"servo": 9})
    line.run(2000)
    assert line.hear("state", header={"servo": 9}, angle=0, voltage=7) == ["state"]
    assert line.hear("state", header={"servo": 3}, angle=0, voltage=7) == ["state"]  # it came late
    stats = line.core.stats()
    assert (stats["foreign_frames"], stats["frames"]) == (1, 5)
    assert stats["bytes"] == stats["frame_bytes"] and stats["foreign_bytes"] * 5 == stats["bytes"]
    line.send("ask", header={"servo": 0xFE})
    line.run(2000)
    assert line.hear("state", header={"servo": 77}, angle=0, voltage=7) == ["state"]  # all were asked


def test_frames_for_another_end_are_foreign_and_keep_the_line_alive() -> None:
    line = Line(Codec(loads(ENDS)))
    assert line.hear("state", x=1) == ["state"]
    assert line.hear("state", header={"to": 255}, x=1) == ["state"]
    line.now += 900_000
    line.core.poll(line.now)
    assert line.hear("state", header={"to": 7}, x=1) == []
    line.now += 300_000
    line.core.poll(line.now)
    assert line.core.struck_deadlines() == [0]  # the foreign one has not met the deadline
    assert line.core.state(line.now) == "up"
    assert line.core.stats()["foreign_frames"] == 1
    line.core.set_address(7)
    assert line.hear("state", header={"to": 7}, x=1) == ["state"]
    assert line.hear("state", header={"to": 100}, x=1) == []
    line.core.listen_to_all(True)
    assert line.hear("state", header={"to": 100}, x=1) == ["state"]


def test_a_decoder_that_knows_its_address_counts_others_as_foreign() -> None:
    frames = b"".join(BUS.encode("state", angle=0, voltage=7, header={"servo": servo}) for servo in (3, 9, 3))
    decoder = BUS.decoder("mcu")
    assert len(decoder.feed(frames)) == 3
    decoder.expect("ask", header={"servo": 3})
    assert [m.header["servo"] for m in decoder.feed(frames)] == [3, 3]
    assert (decoder.stats.foreign_frames, decoder.stats.frames) == (1, 6)
    assert account_closes(decoder.stats)
    decoder.expect("ask")
    assert len(decoder.feed(frames)) == 3


def test_a_stop_message_may_have_header_values_and_wrong_ones_are_reported() -> None:
    assert BROADCAST.model.emergency_stop[0].header == (("servo", 0xFE),)
    text = (ROOT / "tests" / "formats" / "servo_options.yaml").read_text()
    for header, sentence in (("{servo: 300}", "300 does not fit `servo`"), ("{leg: 1}", "has no field `leg`")):
        with pytest.raises(Exception, match=sentence):
            loads(
                text.replace("emergency_stop: {message: move,", f"emergency_stop: {{message: move, header: {header},")
            )


@pytest.mark.live
def test_an_open_link_has_an_address_listens_and_sends_it() -> None:
    port = PtyPort()
    codec = Codec(loads(ENDS))
    with wirebond.open(codec, port.path) as link:
        assert link.address == 100
        with pytest.raises(UsageError, match="address is 256; to takes 0 to 255"):
            link.address = 256
        link.address = 7
        port.write(codec.encode("state", x=1) + codec.encode("state", x=2, header={"to": 7}))
        (message,) = link.receive(PATIENCE)
        assert (message.fields, link.stats.receive.foreign_frames) == ({"x": 2}, 1)
        link.send("ask")
        (asked,) = heard(codec, port)
        assert asked.header == {"to": 1, "source": 7}
        link.send("ask", header={"to": 5, "source": 9})
        (asked,) = heard(codec, port)
        assert asked.header == {"to": 5, "source": 9}
    with wirebond.open(codec, port.path, listen="all") as link:
        port.write(codec.encode("state", x=1, header={"to": 55}))
        assert [m.header["to"] for m in link.receive(PATIENCE)] == [55]
    with pytest.raises(UsageError, match="listen is 'some'; expected 'own' or 'all'"):
        wirebond.open(codec, port.path, listen="some")
    with wirebond.open(BUS, port.path) as link:
        assert link.address is None
        with pytest.raises(UsageError, match="frames of servo_options have no address of the host"):
            link.address = 3
    port.close()


@pytest.mark.live
def test_an_open_link_repeats_for_each_servo_and_stops_each() -> None:
    port = PtyPort()
    with wirebond.open(BUS, port.path, paced=False) as link:
        for servo in (3, 7):
            link.repeat("move", hold=60, header={"servo": servo}, angle=0.1)
        found: list[Message] = []

        def hears(*servos: int) -> bool:
            found.extend(heard(BUS, port, 0.02))
            return {m.header["servo"] for m in found} == set(servos)

        wait_until(lambda: hears(3, 7), "both")
        link.stop_repeating("move", header={"servo": 7})
        let_go = link.stats.send.sent + 1  # one may be under way
        wait_until(lambda: hears(3, 7) and link.stats.send.sent > let_go, "the other goes on")
        heard(BUS, port, 0.05)
        found.clear()
        for _ in rounds_for(0.2):
            hears()
        wait_until(lambda: hears(3), "only the other")
        link.emergency_stop()
        let_go = link.stats.send.sent + 1
        wait_until(lambda: hears(3) or link.stats.send.sent > let_go, "the stop leaves")
        heard(BUS, port, 0.05)
        found.clear()
        wait_until(lambda: hears(1, 3, 7), "all stop")
        assert {m.fields["angle"] for m in found} == {0.0}
        with pytest.raises(wirebond.StoppedError):
            link.send("move", header={"servo": 9}, angle=0.1)
    port.close()


def heard(codec: Codec, port: PtyPort, seconds: float = 0.0) -> list[Message]:
    """Return the messages that the link wrote: for this long, or until a frame is there."""
    decoder = codec.decoder("host")
    found: list[Message] = []
    for _ in rounds_for(seconds) if seconds else moments("a frame"):
        found += decoder.feed(port.read(0.01))
        if found and not seconds:
            break
    return found
