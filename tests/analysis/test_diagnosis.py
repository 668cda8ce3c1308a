"""Diagnosis in words: a fault is named on a stream that has it; a healthy line, or noise, is accused of nothing."""

from __future__ import annotations

import io
import itertools
import json
import math
import random
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import pytest
from rich.console import Console
from tests.shared import PROTOCOLS, codec, loaded
from tests.waiting import wait_until

import wirebond
from wirebond import Codec
from wirebond.analysis.diagnosis import Diagnosis, Kind, diagnose_dump
from wirebond.analysis.diagnosis.live import LiveDiagnosis
from wirebond.analysis.diagnosis.recent import recent
from wirebond.analysis.diagnosis.uart import misread
from wirebond.analysis.samples import pool
from wirebond.cli.commands.wire import line_shape
from wirebond.cli.main import main
from wirebond.link import Dump, open_link
from wirebond.link.dump import Piece
from wirebond.protocol import loads
from wirebond.protocol.model import End, Parity
from wirebond.sim.pty_port import PtyPort
from wirebond.sim.wire import WireProcess, WireSettings

NAMES = ("diffdrive", "enterprize", "native", "servo_bus", "contrib/crsf", "contrib/ubx", "contrib/tfmini")


def described(name: str) -> Codec:
    return loaded(PROTOCOLS / f"{name}.yaml")


def frames_of(of: Codec, source: random.Random, number: int) -> list[bytes]:
    """As a device sends them that is not reset: without hellos."""
    drawn = pool(of, End.MCU, source.randrange(1 << 30), 60)
    assert drawn is not None
    hello = of.model.service("hello")
    without = None if hello is None else hello.message("message")
    frames = [frame for frame in drawn.frames if of.decoder(End.MCU).feed(frame)[0].name != without]
    return source.choices(frames, k=number)


def heard(of: Codec, data: bytes, source: random.Random, *, sent: bytes = b"", read: int = 0) -> Dump:
    """``data`` in reads of some size, at the pace of the line."""
    pieces = [Piece(0.0, "port_up", b"")]
    if sent:
        pieces.append(Piece(0.0, "sent", sent))
    at = 0
    now = 0.0
    while at < len(data):
        size = read or source.randrange(1, 200)
        now += size * 10 / of.model.link.baud
        pieces.append(Piece(now, "received", data[at : at + size]))
        at += size
    return Dump(of, now + 0.1, pieces, 0)


def kinds(dump: Dump) -> list[Kind]:
    return [one.kind for one in diagnose_dump(dump, dump.codec.model.link.baud)]


@pytest.mark.parametrize("name", NAMES)
def test_a_healthy_line_is_accused_of_nothing(name: str) -> None:
    of = described(name)
    for seed in range(5):
        source = random.Random(f"healthy {name} {seed}")
        assert kinds(heard(of, b"".join(frames_of(of, source, 200)), source)) == []


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(1, 5))])
@pytest.mark.parametrize("name", NAMES)
def test_noise_has_no_cause(name: str, seed: int) -> None:
    of = described(name)
    source = random.Random(f"noise {name} {seed}")
    assert kinds(heard(of, source.randbytes(3000), source)) == [Kind.UNKNOWN]
    data = bytearray(b"".join(frames_of(of, source, 150)))
    for at in range(len(data)):
        if source.random() < 0.03:
            data[at] = source.randrange(256)
    assert set(kinds(heard(of, bytes(data), source))) <= {Kind.UNKNOWN}


@pytest.mark.parametrize("name", NAMES)
def test_an_open_or_stuck_line_has_no_baud_rate(name: str) -> None:
    of = described(name)
    source = random.Random(f"stuck {name}")
    for data in (bytes(2000), bytes(source.choice(b"\x00\x80\xff\xfe\xf8") for _ in range(2000))):
        assert Kind.BAUD not in kinds(heard(of, data, source))


@pytest.mark.parametrize("rate", [38400, 57600, 230400, 460800])
def test_a_wrong_baud_rate_is_named(rate: int) -> None:
    of = codec("diffdrive")
    source = random.Random(f"baud {rate}")
    link = of.model.link
    frames = frames_of(of, source, 300)
    gaps = [sum(map(len, frames[:number])) for number in range(len(frames))]
    data = misread(b"".join(frames), (rate, Parity.NONE), (link.baud, Parity.NONE), gaps)
    (one,) = diagnose_dump(heard(of, data, source), link.baud)
    assert one.kind == Kind.BAUD
    assert f" {rate}" in one.sentence


def test_a_uart_at_the_same_rate_reads_what_was_sent() -> None:
    data = random.Random("uart").randbytes(500)
    for parity in Parity:
        assert misread(data, (9600, parity), (9600, parity), [10, 20]) == data


def test_seven_bits_with_parity_are_named() -> None:
    of = codec("diffdrive")
    source = random.Random("parity")
    seven = [byte & 0x7F for byte in source.randbytes(500)]
    data = bytes(byte | (byte.bit_count() & 1) << 7 for byte in seven)
    (one,) = diagnose_dump(heard(of, data, source), 115200)
    assert (one.kind, "even" in one.sentence) == (Kind.PARITY, True)


def test_an_echo_is_named() -> None:
    of = codec("diffdrive")
    source = random.Random("echo")
    sent = b"".join(of.encode("velocity", linear=number / 100, angular=0) for number in range(20))
    assert kinds(heard(of, sent, source, sent=sent)) == [Kind.ECHO]
    answers = b"".join(frames_of(of, source, 50))
    assert kinds(heard(of, answers, source, sent=sent)) == []


def test_two_writers_are_named() -> None:
    source = random.Random("writers")
    of = codec("enterprize")
    torn = []
    for outer, inner in zip(frames_of(of, source, 40), frames_of(of, source, 40), strict=True):
        at = source.randrange(3, len(outer) - 3)
        torn.append(outer[:at] + inner + outer[at:])
    assert kinds(heard(of, b"".join(torn), source)) == [Kind.TWO_WRITERS]


def test_a_reset_loop_is_named() -> None:
    of = codec("diffdrive")
    source = random.Random("resets")
    life = b"rst:0x10 (RTCWDT_RTC_RESET),boot:0x13\r\n" + b"".join(frames_of(of, source, 4))
    assert Kind.RESETS in kinds(heard(of, life * 6, source, read=1000))


def test_a_hello_that_comes_again_and_again_is_a_reset_loop() -> None:
    of = codec("native")
    source = random.Random("hello")
    service = of.model.service("hello")
    assert service is not None
    name = service.message("message")
    assert name is not None
    hello = of.encode(name, {field.name: 0 for field in of.model.message(name).fields}, sender="mcu")
    life = hello + b"".join(frames_of(of, source, 60))
    assert kinds(heard(of, life * 5, source)) == [Kind.RESETS]
    asked = of.encode(name, {field.name: 0 for field in of.model.message(name).fields})
    assert kinds(heard(of, life * 2, source, sent=asked)) == []


def test_losses_in_full_reads_of_an_adapter_are_named() -> None:
    of = codec("enterprize")
    source = random.Random("usb")
    data = b"".join(frames_of(of, source, 600))
    kept = b""
    reads = []
    for at in range(0, len(data) - 512, 512):
        piece = data[at : at + 448]  # 64 bytes of each 512 are lost
        reads.append(piece)
        kept += piece
    pieces = [Piece(0.0, "port_up", b""), *(Piece(0.001 * n, "received", piece) for n, piece in enumerate(reads, 1))]
    assert kinds(Dump(of, 1.0, pieces, 0)) == [Kind.LOST_READS]


RANGES = """
wirebond: 1
protocol: ranges
frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: {{type: crc-16/modbus{over}}}]
messages: {{state: {{id: 1, sender: mcu, fields: {{x: {{type: u32}}, y: {{type: u32}}}}}}}}
"""


def test_a_check_over_another_range_is_named() -> None:
    source = random.Random("check")
    theirs, ours = (Codec(loads(RANGES.format(over=over))) for over in (", over: id..payload", ""))
    data = b"".join(frames_of(theirs, source, 60))
    (found,) = diagnose_dump(heard(ours, data, source), 115200)
    assert found.kind == Kind.CHECK
    assert "over: id..payload" in found.remedy


BRIEF = """
wirebond: 1
protocol: brief
frame: [magic: 0xAA, id: u8, payload: {size}, check: {check}]
messages: {{m: {{id: 1, sender: mcu, every: 20 ms, fields: {{d: {{type: u8, count: {size}}}}}}}}}
"""


@pytest.mark.parametrize("size", [4, 10])
def test_another_check_is_named_however_short_the_frames_are(size: int) -> None:
    source = random.Random(f"brief {size}")
    theirs, ours = (Codec(loads(BRIEF.format(size=size, check=check))) for check in ("xor8", "crc-8"))
    (found,) = diagnose_dump(heard(ours, b"".join(frames_of(theirs, source, 120)), source), 115200)
    assert (found.kind, found.remedy) == (Kind.CHECK, "Write `- check: xor8`.")
    assert found.sentence.startswith("The peer computes its check in another way.")


def test_frames_that_are_longer_than_the_file_says_are_named() -> None:
    source = random.Random("longer")
    theirs, ours = (Codec(loads(BRIEF.format(size=size, check="crc-16/modbus"))) for size in (8, 6))
    (found,) = diagnose_dump(heard(ours, b"".join(frames_of(theirs, source, 120)), source), 115200)
    assert found.kind == Kind.FORMAT
    assert "the frames are 2 bytes longer than the file says" in found.sentence
    assert found.remedy.startswith("Write `- payload: 8`")


def test_an_end_in_the_mcus_role_hears_the_host() -> None:
    of = codec("diffdrive")
    source = random.Random("role")
    drawn = pool(of, End.HOST, 1, 60)
    assert drawn is not None
    data = b"".join(source.choices(drawn.frames, k=100))
    pieces = heard(of, data, source).pieces
    assert kinds(Dump(of, 1.0, pieces, 0, End.MCU)) == []
    assert kinds(Dump(of, 1.0, pieces, 0, End.HOST)) == [Kind.UNKNOWN]


def test_silence_is_reported_if_something_should_come() -> None:
    of = codec("diffdrive")  # odometry is due
    assert kinds(Dump(of, 5.0, [Piece(0.0, "port_up", b"")], 0)) == [Kind.SILENCE]
    assert kinds(Dump(of, 1.0, [Piece(0.0, "port_up", b"")], 0)) == []
    gone = [Piece(0.0, "port_up", b""), Piece(1.0, "port_down", b"")]
    assert kinds(Dump(of, 5.0, gone, 0)) == []


def over_time(of: Codec, *stretches: tuple[list[bytes], float]) -> Dump:
    """Reads, and the seconds over which they come."""
    pieces = [Piece(0.0, "port_up", b"")]
    now = 0.0
    for reads, seconds in stretches:
        for number, read in enumerate(reads, 1):
            pieces.append(Piece(now + seconds * number / len(reads), "received", read))
        now += seconds
    return Dump(of, now, pieces, 0)


@pytest.mark.parametrize("name", NAMES)
def test_ended_faults_are_no_longer_reported(name: str) -> None:
    of = described(name)
    source = random.Random(f"over {name}")
    good, bad = frames_of(of, source, 100), [source.randbytes(60) for _ in range(50)]
    together = [one + two for one, two in itertools.pairwise([b"", *good])][:50]
    dump = over_time(of, (bad, 10), (together, 10))
    assert [one.kind for one in diagnose_dump(dump, 115200)] == [Kind.UNKNOWN]
    for seconds in (9.0, 7.3, 4.1, 2.2):  # a frame at the cut is whole, or gone
        assert diagnose_dump(dump, 115200, seconds) == []
    begun = over_time(of, (good, 10), (bad, 10))
    assert [one.kind for one in diagnose_dump(begun, 115200, 5.0)] == [Kind.UNKNOWN]


def test_a_frame_in_two_reads_is_not_cut() -> None:
    of = codec("diffdrive")
    (frame, *_) = frames_of(of, random.Random("cut"), 1)
    stream = b"".join([frame] * 8)
    pieces = [Piece(0.0, "port_up", b""), Piece(1.0, "received", frame), Piece(2.0, "received", stream[:-4])]
    pieces.append(Piece(2.01, "received", stream[-4:]))
    now = recent(Dump(of, 3.0, pieces, 0), 0.995)  # since 2.005, between the last two reads
    assert [(e.kind, e.bytes) for e in now.entries if e.direction == "received"] == [("frame", frame)]
    assert now.dropped_bytes == len(frame) * 8


def test_silence_is_reported_since_the_last_byte() -> None:
    of = codec("diffdrive")
    dump = over_time(of, (frames_of(of, random.Random("quiet"), 20), 10), ([], 8))
    for seconds in (math.inf, 5.0):
        (one,) = diagnose_dump(dump, 115200, seconds)
        assert one.kind == Kind.SILENCE
        assert "no byte for 8 s" in one.evidence


def test_a_reset_loop_is_reported_until_its_next_start_does_not_come() -> None:
    of = codec("diffdrive")
    source = random.Random("resets over")
    loop = ([b"rst:0x10 (RTCWDT_RTC_RESET),boot:0x13\r\n", *frames_of(of, source, 20)], 8.0)
    assert [one.kind for one in diagnose_dump(over_time(of, *[loop] * 4), 115200, 5.0)] == [Kind.RESETS]
    healthy = (frames_of(of, source, 50), 20.0)
    assert diagnose_dump(over_time(of, *[loop] * 4, healthy), 115200, 5.0) == []


def test_a_live_diagnosis_stays_until_two_checks_find_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    one = Diagnosis(Kind.BAUD, "It is another rate", "9 of 9", "Change it.")
    monkeypatch.setattr("wirebond.analysis.diagnosis.live._EVERY", 3600.0)
    watch = LiveDiagnosis(cast("wirebond.Link", None))
    shown: list[list[str]] = []
    told: list[int | None] = []
    for look in ([one], [], [replace(one, evidence="8 of 8")], [], [], [one]):
        monkeypatch.setattr("wirebond.analysis.diagnosis.live.diagnose", lambda *_, found=look: found)
        watch._look()
        changed = watch.changed()
        shown.append([one.evidence for one in watch.found()])
        told.append(None if changed is None else len(changed))
    assert shown == [["9 of 9"], ["9 of 9"], ["8 of 8"], ["8 of 8"], [], ["9 of 9"]]
    assert told == [1, None, None, None, 0, 1]


@pytest.mark.live
def test_the_table_of_monitor_shows_the_current_diagnosis(monkeypatch: pytest.MonkeyPatch) -> None:
    of = codec("diffdrive")
    source = random.Random("table")
    port = PtyPort()
    noise = b"".join(frames_of(of, source, 20)) + source.randbytes(500)
    screen = io.StringIO()
    monkeypatch.setattr(
        "wirebond.cli.commands.live.console", Console(file=screen, force_terminal=True, width=100, height=50)
    )
    monkeypatch.setattr("wirebond.cli.commands.live.open_link", partial(open_and_hear, port, noise))
    ctrl_c_after(3, monkeypatch)
    assert main(["monitor", str(PROTOCOLS / "diffdrive.yaml"), port.path]) == 0
    port.close()
    first, *_, last = screen.getvalue().split("Ctrl-C ends")[:-1]
    assert "diagnosis" not in first
    assert "Many bytes are not frames, and I do not know why" in last
    assert "wirebond explain" in last


def test_a_diagnosis_is_a_sentence_with_evidence_and_remedy() -> None:
    one = Diagnosis(Kind.ECHO, "It echoes", "3 of 3", "Stop it.")
    assert str(one) == "It echoes (3 of 3). Stop it."


def parity_of(line: str) -> Parity:
    return Parity.EVEN if "E" in line else Parity.NONE


def bytes_heard(data: bytes, sent: tuple[float, Parity], heard: tuple[float, Parity]) -> int:
    """Return how many of these bytes arrive, with the line at rest before and after them."""
    end = b"\xff"  # behind a rest, so that a last byte is complete
    return len(misread(data + end, sent, heard, [len(data)])) - len(misread(end, sent, heard))


@pytest.mark.live
@pytest.mark.parametrize(("own", "rate", "line", "kind"), [
    ("8N1", 57600, "8N1", Kind.BAUD),
    ("8E1", 115200, "8N1", Kind.PARITY),
    ("8N1", 115200, "8E1", None),  # the parity bit stands where the stop bit is expected, and a tty gives the byte
    ("8N1", 115200, "8N2", None),  # a UART looks at the first stop bit
])  # fmt: skip
def test_wrong_settings_of_an_mcu_are_named_through_a_wire(own: str, rate: int, line: str, kind: Kind | None) -> None:
    model = codec("diffdrive").model
    of = Codec(replace(model, link=replace(model.link, parity=parity_of(own))))
    frames = frames_of(of, random.Random(f"wire {rate} {line}"), 300)
    settings = WireSettings(baud=115200, line=line_shape(own), baud_b=rate, line_b=line_shape(line))
    with WireProcess(settings) as wire, wirebond.open(of, wire.a) as link, Path(wire.b).open("wb", buffering=0) as mcu:
        due = 0
        for frame in frames:
            mcu.write(frame)
            due += bytes_heard(frame, (rate, parity_of(line)), (115200, parity_of(own)))
            # Then the line rests, and the next frame is heard from its start.
            wait_until(lambda due=due: link.stats.receive.bytes >= due, "all bytes")
        assert link.stats.receive.bytes == due
        assert [one.kind for one in wirebond.diagnose(link)] == ([] if kind is None else [kind])


@pytest.mark.live
def test_monitor_reports_faults_live_as_json(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    of = codec("diffdrive")
    source = random.Random("live")
    port = PtyPort()
    noise = b"".join(frames_of(of, source, 20)) + source.randbytes(500)
    monkeypatch.setattr("wirebond.cli.commands.live.open_link", partial(open_and_hear, port, noise))
    ctrl_c_after(3, monkeypatch)
    assert main(["monitor", str(PROTOCOLS / "diffdrive.yaml"), port.path, "--json"]) == 0
    port.close()
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    (event,) = [line for line in lines if "event" in line]  # told once, as nothing changes
    assert event["event"] == "diagnosis"
    assert [one["kind"] for one in event["found"]] == ["unknown"]
    assert "I do not know why" in event["found"][0]["sentence"]


def ctrl_c_after(looks: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command ends when it has shown the result of this many looks at the line, however long they take."""
    shown = [0]
    found = LiveDiagnosis.found

    def counted(watch: LiveDiagnosis) -> list[Diagnosis]:
        if shown[0] == looks:
            raise KeyboardInterrupt
        shown[0] += watch._looked is not None
        return found(watch)

    monkeypatch.setattr(LiveDiagnosis, "found", counted)
    monkeypatch.setattr("wirebond.analysis.diagnosis.live._EVERY", 0.0)
    monkeypatch.setattr("wirebond.analysis.diagnosis.live._RECENT", math.inf)


def open_and_hear(port: PtyPort, data: bytes, *arguments: Any, **options: Any) -> wirebond.Link:
    link = open_link(*arguments, **options)
    port.write(data)
    wait_until(lambda: link.stats.receive.bytes >= len(data), "all bytes")
    return link


@pytest.mark.live
def test_monitor_says_what_is_wrong_and_is_otherwise_quiet(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    of = codec("diffdrive")
    source = random.Random("monitor")
    noise = b"".join(frames_of(of, source, 20)) + source.randbytes(500)
    for data, word in ((noise, "I do not know why"), (b"".join(frames_of(of, source, 20)), "")):
        port = PtyPort()
        with wirebond.open(of, port.path) as link:
            port.write(data)
            wait_until(lambda data=data: link.stats.receive.bytes >= len(data), "all bytes")
            assert [word in one.sentence for one in wirebond.diagnose(link)] == [True] * bool(word)
        with monkeypatch.context() as patched:
            patched.setattr("wirebond.cli.commands.live.open_link", partial(open_and_hear, port, data))
            assert main(["monitor", str(PROTOCOLS / "diffdrive.yaml"), port.path, "--seconds", "0.3", "--json"]) == 0
        port.close()
        told = capsys.readouterr().err
        assert ("diagnosis:" in told) == bool(word)
        assert word in told
