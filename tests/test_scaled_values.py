"""Scaled numbers whose product or offset is wide: both ends decode, judge, clamp and encode them the same.

The generated C++ runs under the undefined-behaviour sanitizer, so that arithmetic which is too narrow shows even where
the result looks right.
"""

from __future__ import annotations

import random
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest

from tests.conformance.build import BUILD
from tests.conformance.fields import difference
from tests.conformance.formats import Answer, Chunk, Job, build_formats, decode_all
from wirebond import Codec, Message
from wirebond.analysis.explain.values import faults_of, read_fields, values_of
from wirebond.protocol import loads
from wirebond.protocol.model import BitOrder, End, Field

FIELDS = (
    "{type: u24, scale: 0.000298023, unit: V}",
    "{type: u16, offset: 4000000}",
    "{type: u16, scale: 0.001, offset: 4000000}",
    "{type: u16, scale: 0.001, offset: 2200000}",
    "{type: u8, scale: 123456789}",
    "{type: i8, scale: -123456789, offset: 0.5}",
    "{type: i16, scale: 98765.4321}",
    "{type: s16, scale: 98765.4321, offset: -70000.25}",
    "{type: i24, scale: 0.000298023, offset: -17.5}",
    "{type: s24, scale: -0.000298023}",
    "{type: u32, scale: 0.000000298023}",
    "{type: i32, scale: 1.0e-7, offset: 90}",
    "{type: s32, scale: 0.25, offset: -1000000000}",
    "{type: u40, scale: 0.000298023}",
    "{type: i40, scale: -0.125, offset: 3000000000}",
    "{type: u24, count: 2, scale: 0.000298023}",
    "{type: u22, count: 4, packed: low_first, scale: 0.000298023}",
    "{type: i21, count: 3, packed: high_first, scale: 12345.678, offset: 4000000}",
    "{bits: {type: u32, fields: {a: {type: u22, scale: 0.000298023}, b: {type: i10, scale: 4000000, offset: 0.5}}}}",
    "{bits: {type: u64be, fields: {a: {type: s33, scale: 0.001}, b: {type: u31, scale: 5, offset: 4000000000}}}}",
    "{type: u24, scale: 0.000298023, range: [2000.000000298, 4000], on_range: clamp}",
    "{type: u16, scale: 0.001, offset: 4000000, range: [4000010, 4000020], on_range: clamp}",
    "{type: u16, scale: 0.001, offset: 4000000, range: [4000010, 4000020]}",
    "{type: i32, scale: 0.001, offset: -3000000, range: [-4000000, -2000000.5]}",
    "{type: u24, scale: 0.000298023, default: 4000.000035}",
    "{type: u8, scale: 1.0e-50}",
    "{type: u8, scale: 1.0e+100}",
    "{type: i8, scale: -1.0e-300}",
)
FLOATS = (
    "{type: f32}",
    "{type: f64}",
    "{type: f32, scale: 0.5}",
    "{type: f64, scale: -0.25}",
    "{type: f32, scale: 4}",
    "{type: f64, scale: 2, offset: 1}",
    "{type: f32, range: [0, 1], on_range: clamp}",
)
ALL = FIELDS + FLOATS


def protocol_text(fields: tuple[str, ...]) -> str:
    lines = ["wirebond: 1", "protocol: scaled", "frame:", "  - magic: 0xA5", "  - id: u8", "  - payload: by_id"]
    lines += ["  - check: crc-16/mcrf4xx", "messages:"]
    lines += [
        f"  m{number}: {{id: {number}, sender: mcu, fields: {{value: {field}}}}}" for number, field in enumerate(fields)
    ]
    return "\n".join(lines) + "\n"


def frames(codec: Codec, message: str, source: random.Random) -> list[bytes]:
    """Payloads at both ends of the wire's numbers, around zero, and between, as raw bytes: no encoder is asked."""
    described = codec.model.message(message)
    size = described.max_payload
    payloads = [bytes(size), b"\xff" * size, b"\x7f" + b"\xff" * (size - 1), b"\xff" * (size - 1) + b"\x7f"]
    payloads += [b"\x80" + bytes(size - 1), bytes(size - 1) + b"\x80", b"\x01" + bytes(size - 1)]
    payloads += [source.randbytes(size) for _ in range(40)]
    raw = Codec(loads(raw_text(size, described.id)))
    return [raw.encode("raw", {"raw": payload}) for payload in payloads]


def raw_text(size: int, message_id: int) -> str:
    text = protocol_text((f"{{type: bytes, size: {size}}}",))
    return text.replace("m0: {id: 0,", f"raw: {{id: {message_id},").replace("value:", "raw:")


@pytest.fixture(scope="module")
def ends(tmp_path_factory: pytest.TempPathFactory) -> tuple[Codec, list[Message], Answer]:
    """Return the results of the engine and of the generated C++ for the same frames."""
    codec = Codec(loads(protocol_text(ALL)))
    source = random.Random(1)
    stream = b"".join(b"".join(frames(codec, message.name, source)) for message in codec.model.messages)
    decoder = codec.decoder("mcu")
    messages = decoder.feed(stream, 0.0) + decoder.finish()
    program = build_formats([codec.model], [], BUILD, sanitize=True)
    answers = decode_all(program, [Job(0, End.MCU, [Chunk(0, stream)])], tmp_path_factory.mktemp("scaled"))
    return codec, messages, answers.jobs[0]


@pytest.mark.live
@pytest.mark.parametrize("number", range(len(ALL)), ids=ALL)
def test_both_ends_read_and_write_the_same_value(ends: tuple[Codec, list[Message], Answer], number: int) -> None:
    codec, messages, answer = ends
    found = [(place, message) for place, message in enumerate(messages) if message.name == f"m{number}"]
    assert len(found) == 47
    for place, message in found:
        fault = difference(codec, message, answer.handed[place])
        assert not fault, f"{message.payload.hex()}: {fault}"


@pytest.mark.live
@pytest.mark.parametrize("number", [n for n, field in enumerate(FIELDS) if "bits:" not in field])
def test_the_engine_gives_the_double_nearest_to_the_exact_value(
    ends: tuple[Codec, list[Message], Answer], number: int
) -> None:
    codec, messages, _ = ends
    (field,) = codec.model.message(f"m{number}").fields
    for message in messages:
        if message.name != f"m{number}":
            continue
        values = message.fields["value"] if field.count else [message.fields["value"]]
        for wire, value in zip(wire_numbers(field, message.payload), values, strict=True):
            exact = wire * field.scale + field.offset
            error = abs(Fraction(value) - exact)
            assert error <= Fraction(1, 2**51) * max(abs(exact), abs(field.offset)), (wire, value, float(exact))


def wire_numbers(field: Field, payload: bytes) -> list[int]:
    """The field's numbers, taken from the payload as one big integer."""
    count, width = field.count or 1, field.width
    if field.packed == BitOrder.HIGH:
        whole = int.from_bytes(payload, "big") >> (8 * len(payload) - width * count)
        raws = [whole >> (width * (count - 1 - i)) & (2**width - 1) for i in range(count)]
    else:
        whole = int.from_bytes(payload, "little")
        raws = [whole >> (width * i) & (2**width - 1) for i in range(count)]
    if field.is_unsigned:
        return raws
    top = 1 << (width - 1)
    if field.coding.name == "sign_magnitude":
        return [-(raw - top) if raw & top else raw for raw in raws]
    return [raw - 2 * top if raw & top else raw for raw in raws]


@pytest.mark.live
def test_columns_hold_the_values_of_single_messages(ends: tuple[Codec, list[Message], Answer]) -> None:
    codec, messages, _ = ends
    columns = codec.decode_columns(b"".join(message.raw for message in messages), sender="mcu")
    for number, text in enumerate(ALL):
        single = [message.fields["value"] for message in messages if message.name == f"m{number}"]
        if "bits:" in text:
            for name in ("a", "b"):
                found = columns[f"m{number}"][f"value.{name}"].tolist()
                assert found == [value[name] for value in single], text
        else:
            found = columns[f"m{number}"]["value"].tolist()
            assert str(found) == str(single), text  # as text: NaN is NaN, and -0.0 is not 0.0


@pytest.mark.live
def test_explain_reads_the_same_values_as_the_engine(ends: tuple[Codec, list[Message], Answer]) -> None:
    codec, messages, _ = ends
    for message in messages:
        readings = read_fields(codec.model.message(message.name), message.payload)
        assert str(values_of(readings)) == str(message.fields)  # as text: NaN is NaN, and -0.0 is not 0.0
        assert bool(faults_of(readings)) == bool(message.violations), (message.fields, message.violations)


@pytest.mark.parametrize(
    ("field", "raw", "value"),
    [
        ("{type: f32}", "00000080", -0.0),
        ("{type: f64}", "0000000000000080", -0.0),
        ("{type: f32, scale: 0.5}", "00000080", -0.0),
        ("{type: f32, scale: -0.5}", "00000000", -0.0),
        ("{type: f32, scale: -0.5}", "00000080", 0.0),
        ("{type: i8, scale: -0.5}", "00", 0.0),
        ("{type: i8, scale: -1.0e-300}", "00", 0.0),
        ("{type: s8, scale: 0.1}", "80", 0.0),
        ("{type: s8, scale: 0.1}", "00", 0.0),
    ],
)
def test_the_zero_of_a_float_has_a_sign_and_that_of_an_integer_has_none(field: str, raw: str, value: float) -> None:
    codec = Codec(loads(protocol_text((field,))))
    payload = bytes.fromhex(raw)
    frame = Codec(loads(raw_text(len(payload), 0))).encode("raw", {"raw": payload})
    (message,) = codec.decoder("mcu").feed(frame, 0.0)
    assert str(message.fields["value"]) == str(value)
    assert str(codec.decode_columns(frame, sender="mcu")["m0"]["value"][0]) == str(value)
    if "s8" not in field or raw == "00":
        assert codec.encode("m0", {"value": value}) == frame
    for zero in (0.0, -0.0):
        (message,) = codec.decoder("mcu").feed(codec.encode("m0", {"value": zero}), 0.0)
        assert str(message.fields["value"]) == str(zero if "f" in field[:8] else 0.0)


BOUNDED = (
    "{type: f32, range: [-0.3, 0.3]}",
    "{type: f32, range: [1.1, 16777.217]}",
    "{type: f64, range: [-0.3, 0.3]}",
    "{type: f32, range: [1.0e-50, 1]}",
    "{type: f32, scale: 1.0e+30, range: [1.04e-15, 1]}",
    "{type: f32, scale: 0.1, range: [-0.7, 0.3]}",
    "{type: f32, scale: 0.001, range: [-0.033, 12.3457]}",
    "{type: f32, scale: -7, offset: 0.1, range: [-0.9, 1.7]}",
    "{type: f64, scale: 0.1, range: [-0.7, 0.3]}",
)


@pytest.mark.live
def test_a_bound_that_a_float_does_not_hold_breaks_no_rule_as_it_arrives(tmp_path: Path) -> None:
    """0.3 arrives as 0.30000001. Beyond it by a thousandth both ends find it outside."""
    codec = Codec(loads(protocol_text(BOUNDED)))
    sent = []
    for message in codec.model.messages:
        (field,) = message.fields
        assert field.minimum is not None
        assert field.maximum is not None
        step = (field.maximum - field.minimum) / 1000
        free = Codec(replace(codec.model, messages=(replace(message, fields=(replace(field, minimum=None),)),)))
        sent += [codec.encode(message.name, value=bound) for bound in (field.minimum, field.maximum)]
        sent += [free.encode(message.name, value=value) for value in (field.minimum - step, field.maximum + step)]
    decoder = codec.decoder("mcu")
    messages = decoder.feed(b"".join(sent)) + decoder.finish()
    assert [message.violations != [] for message in messages] == [False, False, True, True] * len(BOUNDED)
    for message, frame in zip(messages, sent, strict=True):
        described = codec.model.message(message.name)
        assert len(faults_of(read_fields(described, message.payload))) == len(message.violations)
        if not message.violations:
            (again,) = codec.decoder("mcu").feed(codec.encode(message.name, message.fields))
            assert again.violations == [], message.fields
            assert again.raw == frame or described.fields[0].is_scaled
    program = build_formats([codec.model], [], BUILD, sanitize=True)
    (answer,) = decode_all(program, [Job(0, End.MCU, [Chunk(0, b"".join(sent))])], tmp_path).jobs
    for place, message in enumerate(messages):
        assert answer.handed[place].rejected == bool(message.violations), (message.name, message.fields)
        if not codec.model.message(message.name).fields[0].is_scaled:  # these lose some last digits on the way back
            assert not difference(codec, message, answer.handed[place])
