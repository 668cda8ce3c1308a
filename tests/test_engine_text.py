"""The engine writes numbers and bytes in its sentences as Python does, without Python's help."""

from __future__ import annotations

import random
import struct

from wirebond.arguments import shown
from wirebond.codec import Codec, Message
from wirebond.protocol.loader import loads

PROTOCOL = """
wirebond: 1
protocol: texts
frame:
- {{magic: 0xAA 0x55}}
- {{length: u8}}
- {{payload: by_length}}
- {{check: {{type: crc-16/modbus, over: length..payload}}}}
messages:
  one: {{sender: mcu, fields: {{x: {}}}}}
"""
# Beginnings and ends of characters, of too long ones, of surrogates and beyond Unicode; and plain ones.
UTF8_BYTES = b"aZ\x00\x7f\x80\x8f\x90\x9f\xa0\xbf\xc0\xc1\xc2\xdf\xe0\xe1\xed\xef\xf0\xf1\xf4\xf5\xff"
RAW = Codec(loads(PROTOCOL.format("{type: bytes, max: 200}")))


def received(field: str, payloads: list[bytes]) -> list[Message]:
    """Messages with one field, with these payloads, whatever rule they break."""
    frames = b"".join(RAW.encode("one", {"x": payload}) for payload in payloads)
    messages = Codec(loads(PROTOCOL.format(field))).decoder().feed(frames, 0.0)
    assert len(messages) == len(payloads)
    return messages


def doubles(source: random.Random, count: int) -> list[float]:
    """Return doubles of all magnitudes, with few digits and with many."""
    of_all_bits = struct.unpack(f"<{count}d", source.randbytes(8 * count))
    short = [
        source.choice((-1, 1)) * source.randrange(1, 100000) * 10.0 ** source.randrange(-30, 30) for _ in range(count)
    ]
    edges = [1e15, 1e16, 9999999999999998.0, 1e-4, 9.999e-5, 1e-5, 2.0**63, 5e-324, 1.7976931348623157e308, 123456789.5]
    return [*of_all_bits, *short, *edges, *(-one for one in edges)]


def test_numbers_are_as_in_python() -> None:
    numbers = [x for x in doubles(random.Random(1), 3000) if not 1 <= x <= 2]
    messages = received("{type: f64, range: [1, 2]}", [struct.pack("<d", x) for x in numbers])
    for number, message in zip(numbers, messages, strict=True):
        text = repr(number).removesuffix(".0")
        infinite = f"one.x is {text}, not a finite number"
        outside = f"one.x = {text} is outside 1 ... 2"
        assert message.violations == [infinite if number - number != 0 else outside]


def test_text_is_utf_8_where_python_says_so() -> None:
    source = random.Random(2)
    texts = [bytes(source.choices(UTF8_BYTES, k=source.randrange(1, 7))) for _ in range(20_000)]
    texts += ["Ωß€𝄞 text".encode(), b"", *(bytes((byte,)) for byte in range(256))]
    for text, message in zip(texts, received("{type: text, max: 200}", texts), strict=True):
        decoded = text.decode(errors="replace")
        assert message.fields["x"] == decoded
        assert message.violations == ([] if decoded.encode() == text else ["one.x is not UTF-8"])


def test_characters_that_are_no_number_are_quoted_as_in_python() -> None:
    source = random.Random(3)
    texts = [bytes(source.choices(range(256), k=source.randrange(1, 12))) for _ in range(3000)]
    texts += [b"it's", b'say "no"', b"both ' and \"", b"\\", b"x" * 77, b"x" * 78, b"x" * 79, b"\xe9" * 90, b"\n" * 60]
    for text, message in zip(texts, received("{type: i16, text: decimal, max: 200}", texts), strict=True):
        if message.fields["x"] is not None:
            continue
        quoted = shown(text.decode("latin-1"))
        assert message.violations == [f"one.x is {quoted}, which is no 16-bit number in decimal digits"]
