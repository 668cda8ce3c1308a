"""Header values: generated code sends the frames that the engine sends, and reads back what they carry."""

from __future__ import annotations

import random
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from tests.conformance.headers import answers, build_headers
from tests.shared import PROTOCOLS, ROOT, loaded
from tests.test_against_reference import FORMATS
from wirebond import Codec, Message, MessageError, _engine
from wirebond.protocol.model import End, HeaderField
from wirebond.protocol.model.forms import header_fields

pytestmark = pytest.mark.live

EVERY_HEADER = ROOT / "tests" / "generate" / "code" / "every_header.yaml"
FILES = {path.stem: path for path in [*FORMATS.values(), *PROTOCOLS.glob("*.yaml"), EVERY_HEADER]}
ALWAYS = {"every_header", "servo_bus", "optional", "dynamixel_1", "by_sender"}  # others are proofs
MESSAGES = 300


def cases() -> list[Any]:
    found = []
    for name, path in sorted(FILES.items()):
        model = loaded(path).model
        if not header_fields(model.format.parts):
            continue
        for end in (End.HOST, End.MCU):
            if any(message.sent_by(end) for message in model.messages):
                marks = [] if name in ALWAYS else [pytest.mark.long]
                found.append(pytest.param(path, end, marks=marks, id=f"{name}-{end}"))
    return found


def drawn(field: HeaderField, source: random.Random) -> Any:
    """A value of its, in SI units, that its rules allow."""
    spec = field.value
    if spec.enum:
        return source.choice([name for name, _ in spec.enum])
    if spec.flags and source.random() < 0.5:
        return sum(1 << bit for _, bit in spec.flags if source.random() < 0.5)
    signed = spec.coding.is_signed
    low = ((spec.coding.name == "sign_magnitude") - (1 << (spec.width - 1))) if signed else 0
    high = (1 << (spec.width - signed)) - 1
    wire = source.choice([low, high, 0, 1, source.randint(low, high)])
    value: Fraction | float | int = wire * spec.scale + spec.offset
    if spec.minimum is not None:
        value = max(value, Fraction(str(spec.minimum)))
    if spec.maximum is not None:
        value = min(value, Fraction(str(spec.maximum)))
    return float(value) if spec.is_scaled else int(value)


def untouched(codec: Codec, sender: End) -> dict[int, dict[str, Any]]:
    """The values of structs that nobody has touched, by the messages' indices; of the messages where all are known."""
    found = {}
    for index, message in enumerate(codec.model.messages):
        values = {f.name: 0 for f in message.fields if f.default is None}
        try:
            codec.encode(message.name, values, sender=sender.value)
        except MessageError:  # of the other end, or a value that is not 0
            continue
        found[index] = values
    return found


def request(codec: Codec, sender: End, source: random.Random, index: int) -> tuple[int, list[int], dict[str, Any]]:
    """A message's index, the numbers of its header, and the values that are not defaults."""
    fields = header_fields(codec.model.format.parts)
    values = {f.name: drawn(f, source) if source.random() < 0.5 else f.default(sender) for f in fields}
    numbers = [f.value.wire_bits(values[f.name]) for f in fields]
    given = {f.name: values[f.name] for f, n in zip(fields, numbers, strict=True) if n != f.default_bits(sender)}
    return index, numbers, given


def decoded(codec: Codec, sender: End, frame: bytes) -> list[Message]:
    decoder = codec.decoder(sender.value)
    return [*decoder.feed(frame), *decoder.finish()]


def bits(codec: Codec, sender: End, header: dict[str, Any]) -> list[int]:
    """The header's values as the wire has them, defaults where it has none."""
    return list(_engine.header_bits(codec.tables.format_for(sender), header))


@pytest.mark.parametrize(("path", "sender"), cases())
def test_generated_code_and_engine_send_the_same_header_values(path: Path, sender: End) -> None:
    codec, source = loaded(path), random.Random(f"{path.stem} {sender}")
    bodies = untouched(codec, sender)
    if not bodies:
        pytest.skip("no message of this end can be sent as it is made")
    requests = [request(codec, sender, source, source.choice([*bodies])) for _ in range(MESSAGES)]
    program = build_headers(codec.model, sender)
    fields = header_fields(codec.model.format.parts)
    sent = refused = 0
    found = answers(program, [(index, numbers) for index, numbers, _ in requests])
    for (index, numbers, given), (frame, received) in zip(requests, found, strict=True):
        name = codec.model.messages[index].name
        try:
            expected = codec.encode(name, bodies[index], header=given, sender=sender.value)
        except MessageError as error:
            refused += 1
            if "which is sent by itself" not in str(error):
                assert frame is None, (name, given)
            elif frame is not None:  # where a value can only be one, generated code writes it over
                (message,) = decoded(codec, sender, frame)
                kept = {
                    n: value
                    for n, value in given.items()
                    if bits(codec, sender, message.header | {n: value}) == received
                }
                assert frame == codec.encode(name, bodies[index], header=kept, sender=sender.value), (name, given)
            continue
        assert frame == expected, (name, given)
        sent += 1
        if received is None:  # nothing but a request tells which message it is
            continue
        (message,) = decoded(codec, sender, frame)
        found_bits = bits(codec, sender, message.header)
        for field, wanted, got, read in zip(fields, numbers, received, found_bits, strict=True):
            if field.name in message.header:
                assert got == read, (name, given, field.name)
                assert got == wanted or field.name not in given, (name, given, field.name)
    assert sent > 20, f"{sent} of {MESSAGES} were sent, {refused} refused"
