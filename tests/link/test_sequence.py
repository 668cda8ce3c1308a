"""The host's link raises the sequence number of each frame as it leaves: the numbers on the wire rise by one, whatever
was refused, replaced, overruled, or has expired."""

from __future__ import annotations

import random
from collections import defaultdict
from typing import Any

import pytest

import wirebond
from tests.link.drivers import VirtualDriver
from wirebond.errors import QueueFullError, StoppedError
from wirebond.protocol import loads

pytestmark = pytest.mark.usefixtures("links")

FRAMES = {
    "plain": "[magic: 0xAA, sequence: u8PER, length: u8, id: u8, payload: by_length, check: crc-16/modbus]",
    "bits": "[magic: 0xAA, {bits: u16be, fields: {id: 5, sequence: RUN, top: 1}}, length: u8, payload: by_length, "
    "check: xor8]",
    "cobs": "[delimiter: 0x00, cobs: [id: u8, sequence: u16PER, payload: rest, check: crc-16/ibm-sdlc], "
    "delimiter: 0x00]",
    "escaped": "[{delimiter: 0x7E}, hdlc: [sequence: u8PER, id: u8, payload: rest, check: crc-16/ibm-sdlc], "
    "{delimiter: 0x7E}]",
    "partly": "[{delimiter: 0x00}, {constant: 0x33}, cobs: [id: u8, sequence: u24bePER, payload: rest, check: sum8], "
    "{check: {type: crc-8/maxim-dow, text: hex}}, {delimiter: 0x00}]",
    "seeded": "[magic: 0xFD, length: u8, sequence: u8PER, id: u8, {payload: by_length, trim_zeros: true}, "
    "check: {type: crc-16/mcrf4xx, over: length..payload, seed: message}]",
    "optional": "[magic: 0xA5, {field: marks, type: u8, default: 1}, {sequence: u32, when: marks & 0x01PER}, "
    "length: u8, id: u8, payload: by_length, check: crc-16/modbus]",
}
MESSAGES = """
  drive: {id: 1, SEED1sender: host, every: 20 ms, fields: {speed: {type: i16}, turn: {type: i16}}}
  arm:   {id: 2, SEED2sender: host, fields: {torque: {type: i16}}}
  lamp:  {id: 3, SEED3sender: host, every: 10 ms, fields: {level: {type: u8}}}
  note:  {id: 4, SEED4sender: host, fields: {text: {type: bytes, max: 100}}}
"""


def codec_of(frame: str, per: str = "sender") -> wirebond.Codec:
    text = FRAMES[frame].replace("PER", f", per: {per}" if per != "sender" else "")
    text = text.replace("RUN", "10" if per == "sender" else f"{{bits: 10, per: {per}}}")
    for width in ("u8", "u16", "u24be"):  # a part with an option is a mapping of its own
        text = text.replace(f"sequence: {width}, per: {per}", f"{{sequence: {width}, per: {per}}}")
    messages = MESSAGES
    for number in range(1, 5):
        messages = messages.replace(f"SEED{number}", f"seed: {number * 11}, " if frame == "seeded" else "")
    if frame == "seeded":  # what is trimmed cannot vary in size
        messages = messages.replace("max: 100", "size: 100")
    stop = "emergency_stop: [{message: arm, torque: 0}, {message: drive, speed: 0, turn: 0}]"
    head = "wirebond: 1\nprotocol: numbered\nlink: {baud: 115200, max_age: 60 ms}\n"
    return wirebond.Codec(loads(f"{head}frame: {text}\nmessages:{messages}{stop}\n"))


def numbers(codec: wirebond.Codec, data: bytes) -> list[tuple[str, int]]:
    """Return the numbers of all frames in these bytes, which must be frames and nothing else."""
    decoder = codec.decoder("host")
    found = [(m.name, m.header["sequence"]) for m in decoder.feed(data)]
    assert sum(decoder.stats.discarded_bytes.values()) == 0
    assert decoder.stats.unknown_frames == 0
    return found


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("per", ["sender", "message"])
def test_numbers_rise_by_one_on_the_wire_whatever_becomes_of_other_frames(frame: str, per: str) -> None:
    """Refused, replaced, overruled and expired frames are all among them."""
    codec = codec_of(frame, per)
    draw = random.Random(f"{frame} {per}")
    link = VirtualDriver(codec)
    refused = 0
    for _ in range(400):
        try:
            match draw.randrange(9):
                case 0 | 1:
                    link.send("note", text=bytes(draw.choices((0, 0x7D, 0x7E, 0xAA, 1), k=100)))
                case 2:
                    link.repeat("drive", speed=draw.randrange(-999, 999), turn=draw.randrange(-999, 999))
                case 3:
                    link.repeat("lamp", level=draw.randrange(256), hold=0.03)
                case 4:
                    link.send("arm", torque=draw.randrange(-999, 999))
                case 5:
                    for _ in range(40):
                        link.send("note", text=bytes(100))
                case 6:
                    link.stop_repeating("lamp")
                case 7 if draw.random() < 0.2:
                    link.emergency_stop()
                case _:
                    link.release_stop()
        except (QueueFullError, StoppedError):
            refused += 1
        link.run(draw.choice((0.001, 0.01, 0.05)))
    for _ in range(3000):  # more than the queue holds, so that some are refused
        try:
            link.send("note", text=b"\x01" * 100)
        except QueueFullError:
            refused += 1
    link.run(0.2)
    link.close()
    send = link.stats()["send"]
    assert refused and send["refused_full"] and send["replaced"] and send["overruled"] and send["expired"]
    found = numbers(codec, link.arrived())
    assert len(found) == send["sent"] > 300
    last: dict[str, int] = defaultdict(lambda: -1)
    top = 2 ** {"bits": 10, "cobs": 16, "partly": 24, "optional": 32}.get(frame, 8)
    for name, number in found:
        key = name if per == "message" else ""
        last[key] = (last[key] + 1) % top
        assert number == last[key]


def test_each_repetition_and_each_stop_has_a_number_of_its_own() -> None:
    codec = codec_of("plain")
    link = VirtualDriver(codec)
    link.repeat("drive", speed=5, turn=0)
    link.run(0.1)
    link.emergency_stop()
    link.run(0.2)
    found = numbers(codec, link.arrived())
    assert [number for _, number in found] == list(range(len(found)))
    assert {name for name, _ in found} == {"drive", "arm"}
    assert len(found) > 10


def test_a_number_that_the_caller_gave_is_sent_and_the_count_goes_on_without_it() -> None:
    codec = codec_of("plain")
    link = VirtualDriver(codec)
    link.send("arm", torque=1)
    frame = codec.encode("arm", torque=2, header={"sequence": 77})
    assert link.core.send(1, frame, -1, link.now, takes_number=False) == 0
    link.send("arm", torque=3)
    link.run(0.1)
    assert numbers(codec, link.arrived()) == [("arm", 0), ("arm", 77), ("arm", 1)]


def test_a_port_that_takes_nothing_for_a_while_changes_no_number() -> None:
    codec = codec_of("cobs")
    link = VirtualDriver(codec)
    link.buffer_bytes = 3
    for torque in range(5):
        link.send("arm", torque=torque)
        link.run(0.001)
    link.emergency_stop()  # before a frame that was offered to the port and not taken
    link.run(0.1)
    link.close()
    found = numbers(codec, link.arrived())
    assert [number for _, number in found] == list(range(len(found)))


def test_encode_gives_the_same_bytes_each_time() -> None:
    codec = codec_of("plain")
    assert codec.encode("arm", torque=1) == codec.encode("arm", torque=1)


def test_the_link_counts_missing_frames_of_the_other_end() -> None:
    text = FRAMES["plain"].replace("PER", "")
    codec = wirebond.Codec(
        loads(f"wirebond: 1\nprotocol: p\nframe: {text}\nmessages: {{pose: {{id: 9, sender: mcu, fields: {{}}}}}}\n")
    )
    link = VirtualDriver(codec)
    for number in (250, 251, 254, 254, 3, 200, 201):
        link.answer(codec.encode("pose", header={"sequence": number}))
    stats: dict[str, Any] = link.stats()
    assert stats["sequence"] == {"numbered": 7, "gaps": 2 + 4, "repeats": 1, "restarts": 1, "peers": []}
