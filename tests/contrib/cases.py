"""Messages of a format as its users would send them, and the frames that carry them."""

from __future__ import annotations

import random
from typing import Any

from tests.contrib.oracle import Case, Oracle, from_wires, to_wires
from tests.shared import PROTOCOLS
from wirebond import Codec
from wirebond.protocol.model import End

CONTRIB = PROTOCOLS / "contrib"


def random_case(
    codec: Codec, oracle: Oracle, source: random.Random, end: End | None = None
) -> tuple[Case, dict[str, Any]]:
    """A message to send, and its values as Wirebond's API has them. ``end``: its sender."""
    known = [m for m in codec.model.messages if m.name not in oracle.lacks]
    message = source.choice([m for m in known if end is None or m.sent_by(end)])
    sender = message.sender if message.sender != End.BOTH else end or source.choice([End.HOST, End.MCU])
    wire = to_wires(message.fields, oracle.values(message, source))
    return Case(message.name, sender, wire, oracle.header(message, source)), from_wires(message.fields, wire)


def frame_of(codec: Codec, oracle: Oracle, case: Case, values: dict[str, Any]) -> bytes:
    """The other side's frame, or, where that does not write this message, Wirebond's own."""
    return oracle.encode(case) or codec.encode(case.message, values, header=case.header)
