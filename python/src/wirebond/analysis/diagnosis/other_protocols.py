"""Separates one of several formats on a line from the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from wirebond.codec import Codec
from wirebond.link import DumpEntry
from wirebond.protocol.model import End


def own_entries(entries: Sequence[DumpEntry], others: Sequence[Codec], sender: End) -> list[DumpEntry]:
    """Remove the bytes of other protocols' frames, which are not faults.

    :param entries: all that was received, in the order of the line.
    :param sender: who sends it.
    """
    if not others:
        return list(entries)
    is_others = bytearray(sum(len(entry.bytes) for entry in entries))
    data = b"".join(entry.bytes for entry in entries)
    for codec in others:
        decoder = codec.decoder(sender)
        for message in (*decoder.feed(data), *decoder.finish()):
            is_others[message.offset : message.offset + len(message.raw)] = b"\1" * len(message.raw)
    own, at = [], 0
    for entry in entries:
        end = at + len(entry.bytes)
        rest = bytes(byte for byte, is_other in zip(entry.bytes, is_others[at:end], strict=True) if not is_other)
        at = end
        if entry.kind == "frame" or len(rest) == len(entry.bytes):
            own.append(entry)
        elif rest:
            own.append(replace(entry, bytes=rest))
    return own
