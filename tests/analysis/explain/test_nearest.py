"""The search finds what really happened: each case damages a frame, or its format, in one known way."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest

from wirebond.analysis.checksum import checksum
from wirebond.analysis.explain import FittingGuess, Kind, Stretch, explain
from wirebond.analysis.explain.stuffing import Unstuffed, unstuff
from wirebond.codec import Codec
from wirebond.errors import UsageError
from wirebond.protocol import Protocol, loads
from wirebond.protocol.model import End

FILE = """\
wirebond: 1
protocol: wheel
frame:
  - magic: 0xAA 0x55
  - length: u16
  - id: u8
  - payload: by_length
  - check: crc-16/mcrf4xx
  - tail: 0x0D
messages:
  command:
    id: 0x01
    sender: host
    fields:
      left: {type: i16, unit: m/s, scale: 0.001}
      right: {type: i16, unit: m/s, scale: 0.001}
  state: {id: 0x81, sender: mcu, fields: {position: {type: i32}, speed: {type: f32}, more: {type: u16}}}
"""
STUFFED = FILE[: FILE.index("frame:")] + (
    "frame: [delimiter: 0x00, cobs: [id: u8, payload: rest, check: crc-16/ibm-sdlc], delimiter: 0x00]\n"
    + FILE[FILE.index("messages:") :]
)
READING = "command: left 0.5 m/s, right -1.2 m/s"
CHECK = "check: crc-16/mcrf4xx"


def frame_of(text: str) -> bytes:
    return Codec(loads(text)).encode("command", left=0.5, right=-1.2)


def explained(
    data: bytes, text: str = FILE, sender: End | None = End.HOST, peers: tuple[Protocol, ...] = ()
) -> Stretch:
    """The one stretch that is not a fill."""
    stretches = [s for s in explain(loads(text), data, sender, peers).stretches if s.kind != Kind.FILL]
    assert len(stretches) == 1, stretches
    return stretches[0]


def best(stretch: Stretch) -> FittingGuess:
    assert stretch.kind in (Kind.REFUSED, Kind.NOISE)
    assert stretch.guesses, f"nothing found in {stretch.tried} guesses"
    return stretch.guesses[0]


# What the firmware really does, in the file's words. The file says something else; the remedy must be these words.
OTHER_FORMATS = [
    "check: crc-16/modbus",
    "check: {type: crc-16/mcrf4xx, byte_order: big}",
    "check: {type: crc-16/modbus, byte_order: big}",
    "check: {type: crc-16/mcrf4xx, over: length..payload}",
    "check: {type: crc-16/mcrf4xx, over: id..payload}",
    "check: {type: crc-16/mcrf4xx, over: payload}",
    "check: {type: crc-16/xmodem, over: payload}",
    "check: sum16",
    "length: {type: u16, counts: frame}",
    "length: {type: u16, counts: rest}",
    "length: {type: u16, counts: self_and_rest}",
    "length: {type: u16, offset: 1}",
    "length: u16be",
    "length: {type: u16be, counts: self_and_rest, offset: 1}",
    "magic: 0xAA 0x54",
    "magic: 0xA5 0x5A",
    "tail: 0x7E",
]


@pytest.mark.parametrize("part", OTHER_FORMATS)
def test_another_format_is_named_in_the_files_own_words(part: str) -> None:
    kind = part.partition(":")[0]
    own = next(line for line in FILE.splitlines() if line.startswith(f"  - {kind}:"))
    guess = best(explained(frame_of(FILE.replace(own, f"  - {part}"))))
    assert f"`- {part}`" in guess.remedy
    assert guess.reading == READING
    assert guess.chance is not None and guess.chance < 0.01


def test_other_magic_and_other_range_are_found_together() -> None:
    truth = FILE.replace("0xAA 0x55", "0xA5 0x5A").replace(CHECK, "check: {type: crc-16/mcrf4xx, over: id..payload}")
    guess = best(explained(frame_of(truth)))
    assert guess.what.startswith("With A5 5A as magic, the check ")
    assert "over: id..payload" in guess.remedy


def test_all_numbers_the_other_way_round_is_the_files_byte_order() -> None:
    guess = best(explained(frame_of(FILE.replace("protocol: wheel", "protocol: wheel\nbyte_order: big"))))
    assert guess.remedy == "Write `byte_order: big` at the top of the file."
    assert guess.reading == READING


@pytest.mark.parametrize("filler", [b"", b"\0\0"])
def test_a_check_that_covers_the_tail_too_is_found_although_no_file_can_say_that_it_covers_itself(
    filler: bytes,
) -> None:
    """Around itself, or with itself as zeros."""
    frame = frame_of(FILE)
    model = loads(FILE)
    algorithm = model.format.parts[4].algorithm
    assert algorithm is not None
    value = checksum(algorithm, frame[:-3] + filler + frame[-1:])
    guess = best(explained(frame[:-3] + value.to_bytes(2, "little") + frame[-1:]))
    assert "`[magic..payload, tail]`" in guess.what
    assert ("itself, as zeros" in guess.what) == bool(filler)
    assert guess.remedy.startswith("No `over:` can say that") == bool(filler)
    assert ("over: [magic..payload, tail]" in guess.remedy) == (not filler)


FRAME = frame_of(FILE)
DAMAGE: list[tuple[str, Callable[[bytes], bytes], str]] = [
    ("bit in the payload", lambda f: f[:6] + bytes([f[6] ^ 0x10]) + f[7:], "bit 4 of byte 6 (11) was turned and is 01"),
    ("bit in the length", lambda f: f[:2] + bytes([f[2] ^ 0x10]) + f[3:], "bit 4 of byte 2 (14) was turned and is 04"),
    ("bit in the magic", lambda f: bytes([f[0] ^ 0x01]) + f[1:], "bit 0 of byte 0 (AB) was turned and is AA"),
    ("first byte lost", lambda f: f[1:], "AA comes before byte 0"),
    ("magic lost", lambda f: f[2:], "AA 55 comes before byte 0"),
    ("last byte lost", lambda f: f[:-1], "0D follows at the end"),
    ("byte too many", lambda f: f[:6] + b"\x33" + f[6:], "byte 6 (33) is left out"),
    ("doubled byte", lambda f: f[:6] + f[5:], "byte 5 (F4) is left out"),
    ("zero lost", lambda f: f[:3] + f[4:], "a byte 00 is put in after byte 2"),
]


@pytest.mark.parametrize(("mangle", "expected"), [case[1:] for case in DAMAGE], ids=[case[0] for case in DAMAGE])
def test_damage_is_named(mangle: Callable[[bytes], bytes], expected: str) -> None:
    guess = best(explained(mangle(FRAME)))
    assert expected in guess.what
    assert guess.reading == READING


@pytest.mark.parametrize("size", range(1, len(FRAME) - 1))
def test_a_truncated_frame_says_how_much_is_missing(size: int) -> None:
    stretch = explained(FRAME[:size])
    assert stretch.cause == "incomplete"
    told = next(guess for guess in stretch.guesses if guess.chance is None)
    if size >= 5:  # then the length is there
        assert f": {len(FRAME) - size} more byte" in told.what
        assert "a frame of command" in told.what
    else:
        assert "at least" in told.what


def test_a_terminal_driver_is_suspected_where_it_explains_the_bytes() -> None:
    text = FILE.replace("- tail: 0x0D", "- reserved: 1")
    frame = Codec(loads(text)).encode("command", left=0.013, right=3.341)  # 0D 00 0D 0D
    assert frame.count(b"\r") == 3
    stretch = explained(frame.replace(b"\r", b"\n"), text)
    assert any("terminal driver" in guess.what and "stty raw" in guess.remedy for guess in stretch.guesses)


def test_a_swallowed_xoff_is_found() -> None:
    frame = Codec(loads(FILE)).encode("command", left=0.019, right=0)  # 13 00
    guess = best(explained(frame.replace(b"\x13", b"")))
    assert "(XOFF) at place 5 was swallowed" in guess.what


def test_the_other_ends_frame_is_distinguished_from_an_unknown_one() -> None:
    stretch = explained(FRAME, sender=End.MCU)
    assert (stretch.kind, stretch.message) == (Kind.FRAME, "unknown")
    assert stretch.guesses[0].what == "This is a frame that the host sends, not the MCU."
    assert stretch.guesses[0].remedy.startswith("Say `--sender host`")


def test_where_unknown_frames_are_refused_their_message_is_asked_for() -> None:
    strict = FILE.replace("messages:", "unknown: reject\nmessages:")
    guess = best(explained(frame_of(FILE.replace("id: 0x01", "id: 0x07")), strict))
    assert "no message of the host has the id 0x07" in guess.what
    assert "`id: 0x07` and `sender: host`" in guess.remedy


def test_where_unknown_frames_are_refused_another_payload_size_is_named() -> None:
    strict = FILE.replace("messages:", "unknown: reject\nmessages:")
    longer = frame_of(FILE.replace("right: {type: i16", "right: {type: i32"))
    guess = best(explained(longer, strict))
    assert "command has 4 payload bytes, and here are 6" in guess.what
    assert "fields of command" in guess.remedy


def test_another_protocol_file_that_fits_is_named() -> None:
    other = loads(FILE.replace("protocol: wheel", "protocol: other").replace("0xAA 0x55", "0xC0"), "other.yaml")
    frame = Codec(other).encode("command", left=0.5, right=-1.2)
    guesses = explained(frame, peers=(other,)).guesses
    assert any("a frame of the protocol other, from the host" in guess.what for guess in guesses)
    assert any("other.yaml" in guess.remedy for guess in guesses)


class TestSeed:
    TEXT = FILE.replace(CHECK, "check: {type: crc-16/mcrf4xx, over: length..payload, seed: message}").replace(
        "    sender: host\n", "    sender: host\n    seed: 50\n"
    )

    def test_another_seed_is_worked_out(self) -> None:
        guess = best(explained(frame_of(self.TEXT.replace("seed: 50", "seed: 124")), self.TEXT))
        assert guess.what == "The check fits if the seed of command is 124, not 50."
        assert "`seed: 124`" in guess.remedy

    def test_a_missing_seed_is_found(self) -> None:
        truth = self.TEXT.replace(", seed: message", "").replace("    seed: 50\n", "")
        assert (
            "`- check: {type: crc-16/mcrf4xx, over: length..payload}`"
            in best(explained(frame_of(truth), self.TEXT)).remedy
        )


def test_a_check_in_hex_digits_is_explained_in_digits() -> None:
    text = FILE.replace(CHECK, "check: {type: xor8, over: id..payload, text: hex}")
    frame = frame_of(text.replace("over: id..payload", "over: length..payload"))
    stretch = explained(frame, text)
    assert stretch.rules[-1].found == frame[-3:-1].decode()
    assert "over: length..payload, text: hex" in best(stretch).remedy


def test_a_form_of_the_frame_that_varies_is_explained_in_its_own_parts() -> None:
    """A stamp that is there when a bit says so."""
    text = FILE.replace(
        "  - payload:",
        "  - {field: flags, type: u8, default: 1}\n  - {field: stamp, type: u32, when: flags & 0x01}\n  - payload:",
    )
    frame = frame_of(text)
    (stretch,) = explain(loads(text), frame, End.HOST).stretches
    assert [row.name for row in stretch.rows if row.level == 0] == [
        "magic", "length", "id", "flags", "stamp", "payload", "check", "tail",
    ]  # fmt: skip
    guess = best(explained(frame_of(text.replace(CHECK, "check: crc-16/modbus")), text))
    assert guess.remedy == "Write `- check: crc-16/modbus`."


class TestStuffed:
    FRAME = frame_of(STUFFED)

    def test_a_frame_without_its_delimiters_is_recognised(self) -> None:
        guess = best(explained(self.FRAME[1:-1], STUFFED))
        assert "00 comes before and 00 behind these bytes" in guess.what
        assert guess.reading == READING

    def test_bytes_before_stuffing_are_recognised(self) -> None:
        frame = Codec(loads(STUFFED)).encode("command", left=0.513, right=-1.2)
        content = unstuff(loads(STUFFED).format, frame[1:-1])
        assert isinstance(content, Unstuffed)
        guess = best(explained(content.data, STUFFED))
        assert guess.what == "Everything holds if these are the bytes before stuffing."

    def test_a_turned_bit_in_a_code_is_found(self) -> None:
        broken = self.FRAME[:1] + bytes([self.FRAME[1] ^ 0x40]) + self.FRAME[2:]
        stretch = explained(broken, STUFFED)
        assert stretch.cause == "bad_stuffing"
        assert "bit 6 of byte 1" in best(stretch).what

    def test_another_check_is_named(self) -> None:
        truth = STUFFED.replace("crc-16/ibm-sdlc", "crc-16/modbus")
        assert best(explained(frame_of(truth), STUFFED)).remedy == "Write `- check: crc-16/modbus`."


@pytest.mark.long
def test_random_checks_are_seldom_explained() -> None:
    """A search over hundreds of guesses must not find a story for everything."""
    source = random.Random(7)
    told = 0
    for _ in range(150):
        wrong = FRAME[:-3] + source.randbytes(2) + FRAME[-1:]
        told += bool(explained(wrong).guesses)
    assert told <= 3


def test_a_weak_check_is_not_taken_for_proof() -> None:
    text = FILE.replace(CHECK, "check: xor8")
    source = random.Random(7)
    told = 0
    for _ in range(150):
        frame = frame_of(text)
        stretch = explained(frame[:-2] + bytes([frame[-2] ^ source.randint(1, 255)]) + frame[-1:], text)
        told += any(guess.chance is not None and guess.chance > 0.3 for guess in stretch.guesses)
        assert stretch.repaired == f"with check {frame[-2]:02X} this is {READING}"
    assert told <= 8


def test_the_same_bytes_have_the_same_explanation() -> None:
    data = random.Random(3).randbytes(300) + FRAME[:-1]
    assert explain(loads(FILE), data) == explain(loads(FILE), data)


def test_a_sender_is_named_as_to_a_decoder() -> None:
    protocol = loads(FILE)
    found = explain(protocol, frame_of(FILE), sender="host")
    assert found.sender == "host"
    with pytest.raises(UsageError, match="sender is 'robot'; expected 'mcu' or 'host'"):
        explain(protocol, b"", sender="robot")
