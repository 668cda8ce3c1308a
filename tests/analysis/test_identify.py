"""`wirebond identify`: the right format wins on its own damaged bytes, and nothing wins on bytes of no format."""

from __future__ import annotations

import json
import random
import re
import threading
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from tests.contrib.cases import CONTRIB, frame_of, random_case
from tests.contrib.oracles import ORACLES
from tests.shared import PROTOCOLS, few_or_many, loaded

from wirebond import Codec, load
from wirebond.analysis.identify import Candidate, Format, known_formats, rank
from wirebond.analysis.identify.lines import Heard, Line, best_of, lines_for, search
from wirebond.analysis.samples import pool
from wirebond.cli.main import main
from wirebond.protocol import loads
from wirebond.protocol.model import End
from wirebond.sim.pty_port import PtyPort

DAMAGED = 0.01  # of the bytes


@cache
def formats() -> list[Format]:
    return known_formats().formats


def ranked(data: bytes) -> list[Candidate]:
    return rank(data, formats())


def stream(name: str, source: random.Random, end: End | None = None, frames: int = 80, least: int = 3000) -> bytes:
    """Return a conversation of a device of this format with its host, with this many bytes replaced."""
    codec, oracle = loaded(CONTRIB / f"{name}.yaml"), ORACLES[name]
    out = bytearray()
    number = 0
    while number < frames or len(out) < least:
        case, values = random_case(codec, oracle, source, end)
        out += frame_of(codec, oracle, case, values)
        number += 1
    for at in range(len(out)):
        if source.random() < DAMAGED:
            out[at] = source.randrange(256)
    return bytes(out)


def says(candidates: list[Candidate], name: str) -> bool:
    """Is it the best, or the same wire as the best?"""
    best = candidates[0]
    alike = {one.format.name for one in candidates if one.format.wire == best.format.wire}
    return best.fits and name in alike


@few_or_many(1, 20)
@pytest.mark.parametrize("name", sorted(ORACLES))
def test_a_damaged_stream_of_every_public_format_is_named(name: str, number: int) -> None:
    for seed in range(number):
        candidates = ranked(stream(name, random.Random(f"{name} {seed}")))
        assert says(candidates, name), [(one.format.name, one.evidence) for one in candidates[:3]]


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(ORACLES))
def test_one_end_alone_is_enough(name: str) -> None:
    model = loaded(CONTRIB / f"{name}.yaml").model
    heard = 0
    for end in (End.HOST, End.MCU):
        if any(m.sent_by(end) and m.name not in ORACLES[name].lacks for m in model.messages):
            heard += 1
            for seed in range(5):
                assert says(ranked(stream(name, random.Random(f"{name} {end} {seed}"), end)), name)
    assert heard


@pytest.mark.parametrize("path", sorted(PROTOCOLS.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_projects_own_formats_are_named(path: Path) -> None:
    frames = [
        frame for end in (End.HOST, End.MCU) if (drawn := pool(loaded(path), end, 1, 40)) for frame in drawn.frames
    ]
    random.Random(path.stem).shuffle(frames)
    assert says(ranked(b"".join(frames)), loaded(path).name)


def test_two_files_of_one_wire_are_said_to_be_the_same(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    capture = tmp_path / "capture"
    capture.write_bytes(stream("feetech", random.Random("twins")))
    assert main(["identify", str(capture)]) == 0
    assert "are the same wire" in capsys.readouterr().out
    assert main(["identify", str(capture), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert {told["format"], *told["same_wire"]} == {"dynamixel_1", "feetech"}


def no_format(source: random.Random) -> dict[str, bytes]:
    word = source.randbytes(37)
    return {
        "random": source.randbytes(30_000),
        "zeros": bytes(3000),
        "mostly zeros": bytes(source.choice([0, 0, 0, source.randrange(256)]) for _ in range(30_000)),
        "few values": bytes(source.choice(b"\x00\x0f\x10\x03\x7e\xc0\xdb\x59\xff\x55\xaa") for _ in range(20_000)),
        "text": (PROTOCOLS.parent / "docs" / "cli.md").read_bytes(),
        "counter": b"".join(number.to_bytes(2, "little") for number in range(10_000)),
        "one thing again and again": 300 * (word[:5] + b"\x0f" + bytes(word[5:28]) + b"\x00" + word[28:]),
        "nothing": b"",
    }


@pytest.mark.parametrize("kind", sorted(no_format(random.Random("no format"))))
def test_nothing_fits_bytes_of_no_format(kind: str) -> None:
    candidates = ranked(no_format(random.Random("no format"))[kind])
    assert [one.format.name for one in candidates if one.fits] == []


def test_few_frames_with_a_strong_check_win_over_formats_without_one() -> None:
    source = random.Random("few")
    codec, oracle = loaded(CONTRIB / "mavlink.yaml"), ORACLES["mavlink"]
    pieces = [source.randbytes(5000)]
    for _ in range(3):
        pieces += [frame_of(codec, oracle, *random_case(codec, oracle, source, End.MCU)), source.randbytes(5000)]
    candidates = ranked(b"".join(pieces))
    assert [one.format.name for one in candidates if one.fits] == ["mavlink"]


def test_frames_of_messages_that_the_file_does_not_list_count() -> None:
    source = random.Random("unlisted")
    pieces = []
    for _ in range(40):
        body = bytes([0x0A, 0x77, 12, 0]) + source.randbytes(12)  # a class and an id that the file does not have
        a = b = 0
        for byte in body:
            a = a + byte & 0xFF
            b = b + a & 0xFF
        pieces.append(b"\xb5\x62" + body + bytes([a, b]))
    best = ranked(b"".join(pieces))[0]
    assert (best.format.name, best.frames, best.known_frames, best.messages) == ("ubx", 40, 0, {"other messages": 40})


OWN = """
wirebond: 1
protocol: of_my_own
frame: [magic: 0xC3 0x3C, id: u8, payload: 3, check: crc-16/modbus]
messages: {beat: {id: 7, sender: mcu, fields: {count: {type: u24}}}}
"""


def test_files_of_the_user_are_tried_and_wrong_ones_are_named(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "mine.yaml").write_text(OWN)
    (tmp_path / "wrong.yaml").write_text("wirebond: 1\n")
    codec = load(tmp_path / "mine.yaml")
    frames = b"".join(codec.encode("beat", {"count": 12345 * number % 2**24}) for number in range(50)).hex()
    assert main(["identify", "--hex", frames]) == 1
    assert "No known format fits" in capsys.readouterr().out
    assert main(["identify", "--hex", frames, "--also", str(tmp_path), "--json"]) == 0
    shown = capsys.readouterr()
    told = json.loads(shown.out)
    assert (told["format"], told["same_wire"]) == ("of_my_own", [])
    assert told["candidates"][0]["messages"] == {"beat": 50}
    assert told["candidates"][0]["frame_share"] == 1.0
    assert "wrong.yaml is left out" in shown.err
    assert main(["identify", "--hex", frames, "--also", str(tmp_path / "wrong.yaml")]) == 1
    assert "wrong.yaml:1:1" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "give bytes one way"),
        (["x", "--hex", "00"], "give bytes one way"),
        (["no_such_capture"], "no such file"),
        (["sim:"], "sim: knows its protocol; name the tty"),
        (["--hex", "0"], "do not make whole bytes"),
        (["--hex", "00", "--also", "no_such_folder"], "no such file"),
    ],
)
def test_wrong_arguments_get_a_sentence(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["identify", *arguments]) in (1, 2)
    assert sentence in capsys.readouterr().err


def test_a_robot_at_rest_is_asked_to_move(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    frame = loaded(PROTOCOLS / "diffdrive.yaml").encode("odometry", left_ticks=0, right_ticks=0)
    capture = tmp_path / "still.bin"
    capture.write_bytes(frame * 60)
    assert main(["identify", str(capture)]) == 1
    shown = " ".join(capsys.readouterr().out.split())
    assert "The same bytes come again and again. diffdrive explains 100% of them" in shown
    assert "move the robot" in shown


def test_no_bytes_are_said_to_be_none(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "empty").write_bytes(b"")
    assert main(["identify", str(tmp_path / "empty")]) == 1
    assert "There are no bytes to look at." in capsys.readouterr().out


# ---- a port


def test_the_right_rate_is_found_and_ends_the_search() -> None:
    source = random.Random("rates")
    data = stream("crsf", source, End.MCU)
    heard_at = []

    def listen(line: Line) -> Iterator[bytes]:
        heard_at.append(line)
        yield b""
        wrong = source.randbytes(len(data))  # at another rate the bits are cut elsewhere
        yield data if line == Line(420_000) else wrong

    lines = lines_for(formats())
    heard = list(search(lines, listen, formats()))
    best = best_of(heard)
    assert (best.line, best.candidates[0].format.name) == (Line(420_000), "crsf")
    assert best.is_sure
    assert heard_at == [one.line for one in heard] == lines[: len(heard)]
    assert len(heard) < len(lines)


def test_every_format_is_listened_for_at_its_own_rate() -> None:
    lines = lines_for(formats())
    for each in formats():
        link = each.model.link
        assert Line(link.baud, link.parity, round(link.stop_bits)) in lines
    assert len(set(lines)) == len(lines)


def test_where_nothing_fits_the_rate_with_most_bytes_is_shown() -> None:
    source = random.Random("no rate")

    def listen(line: Line) -> Iterator[bytes]:
        yield source.randbytes(500 if line.baud == 9600 else 20)

    best = best_of(list(search([Line(4800), Line(9600), Line(19200)], listen, formats())))
    assert (best.line, best.size, best.candidates[0].fits) == (Line(9600), 500, False)


def test_two_formats_that_share_a_line_are_reported_with_their_shares(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    source = random.Random("shared")
    ubx, nmea = (frames(name) for name in ("contrib/ubx", "contrib/nmea"))
    mixed = tmp_path / "mixed.bin"
    mixed.write_bytes(b"".join(source.choice(ubx) + source.choice(nmea) for _ in range(60)))
    assert main(["identify", str(mixed)]) == 0
    shown = capsys.readouterr().out
    assert "share the line: each explains other bytes" in shown
    assert re.search(r"One port can carry both: wirebond serve \S+\.yaml \S+\.yaml PORT", shown)
    assert "explains many of the same frames" not in shown


def frames(name: str) -> tuple[bytes, ...]:
    drawn = pool(loaded(PROTOCOLS / f"{name}.yaml"), End.MCU, 3, 60) or pool(
        loaded(PROTOCOLS / f"{name}.yaml"), End.HOST, 3, 60
    )
    assert drawn is not None
    return drawn.frames


ARM = """\
wirebond: 1
protocol: arm
frame: [magic: 0xAB 0x54, id: u8, payload: {size}, check: crc-16/modbus]
messages: {{odom: {{id: 1, sender: mcu, fields: {{x: {{type: i16}}, y: {{type: i16}}, t: {{type: i16}}{more}}}}}}}
"""


def test_a_file_whose_frames_have_gained_a_field_is_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file, capture = tmp_path / "arm.yaml", tmp_path / "arm.bin"
    file.write_text(ARM.format(size=6, more=""))
    new = Codec(loads(ARM.format(size=8, more=", g: {type: i16}")))
    capture.write_bytes(b"".join(new.encode("odom", x=7 * n, y=n, t=3, g=-n) for n in range(60)))
    assert main(["identify", str(capture), "--also", str(file)]) == 1
    shown = capsys.readouterr().out
    assert "arm fits if its payload has 8 bytes and not 6: the frames are 2 bytes longer" in shown
    assert main(["identify", str(capture), "--also", str(file), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["other_sizes"] == [{"format": "arm", "file": str(file), "payload": 8, "told": 6}]


def test_identify_shows_what_can_be_seen_in_an_undocumented_format(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    codec = Codec(loads(ARM.format(size=8, more=", g: {type: i16}")))
    capture = tmp_path / "arm.bin"
    capture.write_bytes(b"".join(codec.encode("odom", x=31 * n, y=n, t=3, g=-n) for n in range(60)))
    assert main(["identify", str(capture)]) == 1
    shown = capsys.readouterr().out
    assert "- magic: 0xAB 0x54" in shown
    assert "- payload: 8" in shown
    assert "- check: {type: crc-16/modbus, over: magic..payload, byte_order: little}" in shown
    assert "wirebond infer CAPTURE -o FILE.yaml" in shown
    out = tmp_path / "drafted.yaml"
    assert main(["infer", str(capture), "-o", str(out)]) == 0
    assert main(["check", str(out)]) == 0
    assert main(["decode", str(out), str(capture)]) == 0
    assert len([line for line in capsys.readouterr().out.splitlines() if line.startswith("{")]) == 60
    assert main(["infer", str(capture), "-o", str(out)]) == 2  # it exists
    assert main(["infer", "--hex", "00 11 22"]) == 1
    assert "nothing repeats as frames do" in capsys.readouterr().err


@pytest.fixture
def pty() -> Iterator[PtyPort]:
    port = PtyPort()
    yield port
    port.close()


@pytest.mark.live
def test_a_port_is_identified(pty: PtyPort, capsys: pytest.CaptureFixture[str]) -> None:
    data = stream("ubx", random.Random("port"), End.MCU)
    ends = threading.Event()

    def send() -> None:
        while not ends.wait(0.005):
            pty.write(data[:800])

    thread = threading.Thread(target=send)
    thread.start()
    try:
        assert main(["identify", pty.path, "--seconds", "5", "--json"]) == 0
    finally:
        ends.set()
        thread.join()
    told = json.loads(capsys.readouterr().out)
    assert (told["format"], told["baud"], told["parity"]) == ("ubx", 115200, "none")
    assert len(told["settings_tried"]) == 1


@pytest.mark.live
def test_a_silent_port_is_said_to_be_silent(pty: PtyPort, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", pty.path, "--baud", "9600", "--seconds", "0.05"]) == 1
    assert "No byte came" in " ".join(capsys.readouterr().err.split())
    assert main(["identify", "/dev/no_such_port", "--baud", "9600"]) == 3
    assert "there is no port" in capsys.readouterr().err
    assert main(["identify", "--hex", "00", "--baud", "9600"]) == 2


@pytest.mark.live
def test_ctrl_c_shows_the_best_so_far(
    pty: PtyPort, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    candidates = ranked(stream("crsf", random.Random("break")))

    def ended(*_: object) -> Iterator[Heard]:
        yield Heard(Line(9600), bytes(4000), candidates)
        raise KeyboardInterrupt

    monkeypatch.setattr("wirebond.cli.commands.identify_port.search", ended)
    assert main(["identify", pty.path]) == 0
    shown = capsys.readouterr()
    assert "4000 bytes at 9600 baud 8N1" in shown.out
    assert "ended after 1 of" in shown.err
