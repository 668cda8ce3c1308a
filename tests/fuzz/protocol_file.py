"""Verifies the rules that hold for any text that is read as a protocol file."""

from __future__ import annotations

import random
import zlib

from tests.fuzz.emit import bound_rounds_past
from tests.streams import random_values
from wirebond import Codec, MessageError
from wirebond.protocol import ProtocolFileError, loads, protocol_hash
from wirebond.protocol.model import End, Message, Protocol
from wirebond.protocol.planning import plan_for

_MOST_MESSAGES = 3  # of a file, each time: others of the same kind tell nothing new


# What a sender may refuse although each value is valid by itself: a frame without a byte, a size that a length in words
# cannot tell.
_REFUSALS = ("is empty, and so is its frame", "which the frame's length cannot express")


def verify(text: str) -> bool:
    """True if the text is a protocol. AssertionError, or whatever else comes out, where an invariant is broken."""
    try:
        protocol = loads(text, "f")
    except ProtocolFileError as error:
        _verify_refusal(error, text)
        return False
    for end in (End.HOST, End.MCU):
        plan_for(protocol, end)
    assert 0 <= protocol_hash(protocol) < 2**64
    codec = Codec(protocol)
    source = random.Random(zlib.crc32(text.encode("utf-8", errors="replace")))
    for message in source.sample(protocol.messages, min(_MOST_MESSAGES, len(protocol.messages))):
        _verify_message(codec, message, source)
    return True


def _verify_refusal(error: ProtocolFileError, text: str) -> None:
    assert error.problems, "a refusal has a reason"
    lines = text.count("\n") + text.count("\r") + text.count("\x85") + text.count("\u2028") + text.count("\u2029") + 2
    for problem in error.problems:
        assert 0 <= problem.line <= lines, f"the place is in the text: {problem}"
        assert (problem.column > 0) == (problem.line > 0), f"a place has line and column: {problem}"
        assert "; " in problem.sentence, f"a problem says what to do: {problem}"
        assert str(problem).isprintable(), f"a sentence is one line: {problem!r}"


def _verify_message(codec: Codec, message: Message, source: random.Random) -> None:
    """A message of random values goes through encode and decode, and comes out as it was."""
    sender = End.HOST if message.sender == End.BOTH else message.sender
    try:
        frame = codec.encode(message.name, random_values(message, source))
    except MessageError as error:
        if any(reason in str(error) for reason in _REFUSALS):
            return
        raise
    decoder = codec.decoder(sender)
    asking = next((m.name for m in codec.model.messages if m.reply == message.name), None)
    decoder.expect(asking)  # where several messages share an id, a reply is known by its request alone
    found = decoder.feed(frame) + decoder.finish()
    if _splits(codec.model, frame):
        return
    assert [m.raw for m in found] == [frame], f"{message.name} comes back: {frame.hex()} {found}"
    assert found[0].name == message.name
    assert found[0].violations == [], f"{message.name}: {found[0].violations}"
    if not any(map(bound_rounds_past, message.fields)):  # else the decoded value may not be sent
        assert codec.encode(message.name, found[0].fields, header=found[0].header) == frame
    assert decoder.stats.bytes == decoder.stats.frame_bytes == len(frame)


def _splits(protocol: Protocol, frame: bytes) -> bool:
    """A delimiter among what is not stuffed ends the frame too early; the manual and `wirebond check` say so."""
    frame_format = protocol.format
    is_stuffed = frame_format.stuffing.hides_delimiters and not any(part.is_plain for part in frame_format.parts)
    if frame_format.delimiter is None or is_stuffed:
        return False
    body = frame[len(frame_format.opening or b"") : -len(frame_format.delimiter)]
    return any(mark in body for mark in (frame_format.delimiter, frame_format.opening) if mark is not None)
