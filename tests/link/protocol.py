"""The protocol of these tests: an arm on a base, with all that a link must keep apart."""

from __future__ import annotations

import wirebond
from wirebond.protocol import loads

TEXT = """
wirebond: 1
protocol: manipulator
link: {{baud: 115200{link}}}
frame: [magic: 0xAA 0x55, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  drive: {{id: 1, sender: host, every: 20 ms, fields: {{speed: {{type: i16}}, turn: {{type: i16}}}}}}
  arm:   {{id: 2, sender: host, fields: {{torque: {{type: i16}}}}}}
  lamp:  {{id: 3, sender: host, every: 10 ms, fields: {{level: {{type: u8}}}}}}
  note:  {{id: 4, sender: host, fields: {{number: {{type: u32}}, text: {{type: bytes, max: 200, default: ""}}}}}}
  query: {{id: 5, sender: host, reply: pose}}
  pose:  {{id: 6, sender: mcu, fields: {{x: {{type: i16}}}}}}
deadlines:
  - {{message: pose, at: host, after: 300 ms, then: warn}}
  - {{message: pose, at: host, after: 1 s, then: halt, recover: explicit}}
emergency_stop:
  - {{message: arm, torque: 0}}
  - {{message: drive, speed: 0, turn: 0}}
"""


def manipulator(link: str = "") -> wirebond.Codec:
    """``link``: further keys of the file's ``link``, such as ``", max_age: 50 ms"``."""
    return wirebond.Codec(loads(TEXT.format(link=link)))


def without_deadlines() -> wirebond.Codec:
    """For tests of other things: where the machine pauses, no deadline strikes and holds messages back."""
    before, _, after = TEXT.format(link="").partition("deadlines:\n")
    return wirebond.Codec(loads(before + after[after.index("emergency_stop:") :]))
