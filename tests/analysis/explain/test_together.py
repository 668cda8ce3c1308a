"""Frames are judged together: a change to the file that fits all of them comes first, and chance is not advice."""

from __future__ import annotations

import random

import pytest

from wirebond.analysis.explain import Explanation, explain
from wirebond.analysis.explain.together import Together, chance_of
from wirebond.codec import Codec
from wirebond.protocol import loads

ANY_REMOTE = """\
wirebond: 1
protocol: remote
fixed: both
frame: [id: u8, payload: 5, check: {check}]
messages:
  a0: {{id: 0xA0, sender: mcu, fields: {{data: {{type: bytes, size: 5}}}}}}
  a8: {{id: 0x80, sender: mcu, fields: {{data: {{type: bytes, size: 5}}}}}}
"""
# Captured from an undocumented remote control; the check is the xor of all bytes before it.
REMOTE = bytes.fromhex(
    "A000000082FEDC A000000084FEDA A0000000FE99C7 A0000000FEFAA4 80000000FFB8C7"
    "A0000000A3FAF9 80000000B9754C A0000000A10001 80000000FFB4CB 8000000083B4B7"
)
PEER = """\
wirebond: 1
protocol: strong
frame: [magic: 0xAA 0x55, id: u8, payload: {size}, check: crc-16/modbus]
messages:
  odom: {{id: 1, sender: mcu, fields: {{x: {{type: i16}}, y: {{type: i16}}, theta: {{type: i16}}{more}}}}}
"""
OLD = PEER.format(size=6, more="")
NEW = PEER.format(size=8, more=", gyro_z: {type: i16}")
SHORT = """\
wirebond: 1
protocol: brief
frame: [magic: 0xAA, id: u8, payload: {size}, check: {check}]
messages: {{m: {{id: 1, sender: mcu, fields: {{d: {{type: u8, count: {size}}}}}}}}}
"""


def told(explanation: Explanation) -> list[str]:
    """The first advice for each stretch that is none of the file's frames."""
    return [s.guesses[0].remedy if s.guesses else "" for s in explanation.stretches if s.kind != "frame"]


@pytest.mark.parametrize("check", ["sum8", "crc-8"])
def test_a_guess_that_fits_all_frames_comes_first_and_is_reported_for_each(check: str) -> None:
    explanation = explain(loads(ANY_REMOTE.format(check=check)), REMOTE)
    assert set(told(explanation)) == {"Write `- check: xor8`."}
    (best, *_) = explanation.together
    assert best.remedy == "Write `- check: xor8`."
    assert best.fits == best.of == len(told(explanation)) >= 9  # the tenth frame holds by sum8, too
    assert best.chance is not None and best.chance < 1e-12


def test_a_hit_that_chance_explains_is_no_advice() -> None:
    source = random.Random(5)
    data = b"".join(b"\xa0" + source.randbytes(6) for _ in range(10))
    explanation = explain(loads(ANY_REMOTE.format(check="sum8")), data)
    assert set(told(explanation)) <= {""}
    assert explanation.together == ()


@pytest.mark.parametrize("size", [4, 10])
def test_short_frames_reveal_their_check_as_long_ones_do(size: int) -> None:
    source = random.Random(size)
    sender = Codec(loads(SHORT.format(size=size, check="xor8")))
    data = b"".join(sender.encode("m", d=list(source.randbytes(size))) for _ in range(12))
    explanation = explain(loads(SHORT.format(size=size, check="crc-8")), data, "mcu")
    assert set(told(explanation)) == {"Write `- check: xor8`."}


def test_damaged_frames_among_good_ones_do_not_speak_for_another_check() -> None:
    source = random.Random(8)
    codec = Codec(loads(SHORT.format(size=10, check="crc-8")))
    frames = [bytearray(codec.encode("m", d=list(source.randbytes(10)))) for _ in range(60)]
    for frame in frames[::6]:
        frame[source.randrange(2, 12)] ^= 1 << source.randrange(8)
    explanation = explain(codec.model, b"".join(frames), "mcu")
    assert len(explanation.frames) >= 50
    assert explanation.together == ()


def test_too_long_frames_are_reported_with_the_difference() -> None:
    codec = Codec(loads(NEW))
    data = codec.encode("odom", x=1, y=2, theta=3, gyro_z=4) + codec.encode("odom", x=5, y=2, theta=3, gyro_z=9)
    (first, second) = explain(loads(OLD), data, "mcu").stretches
    for stretch in (first, second):
        assert stretch.guesses[0].what == (
            "Everything holds if the payload has 8 bytes, not 6: the frames are 2 bytes longer than the file says."
        )
        assert stretch.guesses[0].remedy.startswith("Write `- payload: 8`, and compare the fields of odom")
    assert second.guesses[0].reading == "odom: x 5, y 2, theta 3"


def test_too_short_frames_are_reported_too() -> None:
    codec = Codec(loads(OLD))
    data = b"".join(codec.encode("odom", x=number, y=2, theta=3) for number in range(6))
    explanation = explain(loads(NEW), data, "mcu")
    assert explanation.together[0].what.endswith("the frames are 2 bytes shorter than the file says.")


def test_a_size_given_by_the_id_is_reported_for_its_message() -> None:
    old = OLD.replace("payload: 6", "payload: by_id").replace(
        "messages:\n", "messages:\n  beat: {id: 2, sender: mcu, fields: {n: {type: u8}}}\n"
    )
    codec = Codec(loads(old.replace("theta: {type: i16}", "theta: {type: i32}")))
    data = b"".join(codec.encode("odom", x=n, y=2, theta=3) + codec.encode("beat", n=n) for n in range(4))
    explanation = explain(loads(old), data, "mcu")
    (best, *_) = explanation.together
    assert best.what.endswith("8 bytes, not 6: odom is 2 bytes longer than the file says.")
    assert len(explanation.frames) == 4


def test_the_neighbours_file_that_reads_every_byte_is_named_first_with_its_values() -> None:
    frame = Codec(loads(NEW)).encode("odom", x=1, y=2, theta=3, gyro_z=4)
    (stretch,) = explain(loads(OLD), frame, peers=(loads(NEW, "peer_new.yaml"),)).stretches
    assert stretch.guesses[0].what == "This is a frame of the protocol strong, from the MCU."
    assert stretch.guesses[0].remedy == "Take the file peer_new.yaml."
    assert stretch.guesses[0].reading == "odom: x 1, y 2, theta 3, gyro_z 4"


def test_frames_with_another_magic_are_counted_together() -> None:
    codec = Codec(loads(OLD.replace("0xAA 0x55", "0xA5 0x5A")))
    data = b"".join(codec.encode("odom", x=number, y=2, theta=3) for number in range(8))
    explanation = explain(loads(OLD), data, "mcu")
    assert explanation.together[0].remedy == "Write `- magic: 0xA5 0x5A`."
    assert explanation.together[0].fits == 8


def test_chance_is_that_of_the_binomial_distribution() -> None:
    assert chance_of(256, 1, Together(1, 1)) == pytest.approx(1 / 256)
    assert chance_of(256, 10, Together(1, 1)) == pytest.approx(1 - (255 / 256) ** 10)
    assert chance_of(4, 1, Together(2, 3)) == pytest.approx(3 * 3 / 64 + 1 / 64)
    assert chance_of(256, 100, Together(500, 1000)) == pytest.approx(0, abs=1e-100)
    assert chance_of(1, 5, Together(3, 3)) == 1.0
