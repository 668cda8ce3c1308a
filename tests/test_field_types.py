"""Every way in which fields lie on the wire: the engine against packing by hand, the generated C++ against it."""

from __future__ import annotations

import random
import re
import struct
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crccheck.crc import CrcModbus
from hypothesis import given
from hypothesis import strategies as st

import wirebond
from tests.compilers import CXX, SANITIZE
from tests.conformance.fields import UNREADABLE
from tests.shared import ROOT
from tests.streams import damaged, random_values
from wirebond import MessageError
from wirebond.generate.code import generate_cpp
from wirebond.generate.code.cpp_names import struct_names
from wirebond.protocol import loads
from wirebond.protocol.model import Protocol

SHAPES = wirebond.load(ROOT / "tests" / "generate" / "code" / "every_shape.yaml")
# What C++ does not validate: its bool and text take any byte, its flags any bit.
ONLY_IN_PYTHON = (" is not UTF-8", ", a bool is 0 or 1", " has unnamed bits set: ")


def payload_of(message: str, values: dict[str, Any]) -> bytes:
    frame = SHAPES.encode(message, values)
    return frame[4:-2]


def received(message: str, payload: bytes) -> wirebond.Message:
    number = SHAPES.model.message(message).id
    body = b"\xaa" + struct.pack("<HB", len(payload), number) + payload
    (found,) = SHAPES.decoder("host" if message in ("magnitudes", "defaults") else "mcu").feed(
        body + struct.pack("<H", CrcModbus.calc(body))
    )
    assert found.name == message
    return found


# ---- bits, counted by hand in one big integer


def low_first(numbers: list[int], width: int) -> bytes:
    bits = sum((n % 2**width) << (width * i) for i, n in enumerate(numbers))
    return bits.to_bytes((width * len(numbers) + 7) // 8, "little")


def high_first(numbers: list[int], width: int) -> bytes:
    text = "".join(f"{n % 2**width:0{width}b}" for n in numbers)
    text += "0" * (-len(text) % 8)
    return int(text, 2).to_bytes(len(text) // 8, "big")


def magnitude(number: int, width: int) -> int:
    return abs(number) + (2 ** (width - 1) if number < 0 else 0)


def ints(low: int, high: int, count: int) -> st.SearchStrategy[list[int]]:
    return st.lists(st.integers(low, high), min_size=count, max_size=count)


@given(
    mode=st.sampled_from([0, 1, 2]), gain=st.integers(0, 24), trim=st.integers(-8, 7), armed=st.booleans(),
    kind=st.sampled_from([-1, 1]), wide=st.integers(0, 2**13 - 1), amount=st.integers(-31, 31),
    flags=st.sampled_from([0, 1, 4, 5]), whole=st.integers(0, 2**64 - 1), a=st.integers(-(2**32) + 1, 2**32 - 1),
    b=st.integers(-64, 63),
)  # fmt: skip
def test_bit_fields_lie_as_integers_shifted_by_hand(
    mode: int, gain: int, trim: int, armed: bool, kind: int, wide: int, amount: int, flags: int, whole: int, a: int,
    b: int,
) -> None:  # fmt: skip
    values = {
        "low": {"mode": ["off", "slow", "fast"][mode], "gain": gain / 2, "trim": trim, "armed": armed},
        "high": {
            "kind": "minus" if kind < 0 else "plus",
            "wide": wide,
            "amount": amount,
            "flags": [name for name, bit in (("first", 1), ("last", 4)) if flags & bit],
        },
        "whole": {"all": whole},
        "much": {"a": a, "b": b / 10},
    }
    low = mode | gain << 3 | (trim & 15) << 10 | armed << 14
    high = (kind & 3) << 22 | wide << 9 | magnitude(amount, 6) << 3 | flags
    much = magnitude(a, 33) | (b & 127) << 33
    expected = low.to_bytes(2, "little") + high.to_bytes(3, "big") + whole.to_bytes(8, "little")
    expected += much.to_bytes(5, "little")
    assert payload_of("bits", values) == expected
    message = received("bits", expected)
    assert message.fields == values
    assert message.violations == []


@given(
    channels=ints(0, 2047, 16), angles=ints(-4096, 4095, 5), switches=ints(0, 1, 11), levels=ints(-15, 15, 3),
    modes=st.lists(st.sampled_from([0, 1, 3]), min_size=5, max_size=5), huge=ints(0, 2**63 - 1, 3),
)  # fmt: skip
def test_packed_streams_lie_as_one_big_integer(
    channels: list[int], angles: list[int], switches: list[int], levels: list[int], modes: list[int], huge: list[int]
) -> None:
    values = {
        "channels": channels,
        "angles": [n / 100 for n in angles],
        "switches": [bool(n) for n in switches],
        "levels": levels,
        "modes": ["ab?c"[n] for n in modes],
        "huge": huge,
    }
    expected = low_first(channels, 11) + bytes(2) + high_first(angles, 13) + low_first(switches, 1)
    expected += high_first([magnitude(n, 5) for n in levels], 5) + low_first(modes, 2) + high_first(huge, 63)
    assert payload_of("streams", values) == expected
    message = received("streams", expected)
    assert message.fields == values
    assert message.violations == []


@given(
    s8=st.integers(-127, 127), s16=st.integers(-(2**15) + 1, 2**15 - 1), s24=ints(-(2**23) + 1, 2**23 - 1, 2),
    s64=st.integers(-(2**63) + 1, 2**63 - 1), scaled=st.integers(-(10**6), 10**6), u40=st.integers(0, 2**40 - 1),
    i40=st.integers(-(2**39), 2**39 - 1), u48=st.integers(0, 2**48 - 1), i56=st.integers(-(2**55), 2**55 - 1),
)  # fmt: skip
def test_sign_and_amount_and_odd_widths_lie_as_integers_packed_by_hand(
    s8: int, s16: int, s24: list[int], s64: int, scaled: int, u40: int, i40: int, u48: int, i56: int
) -> None:
    values = {"s8": s8, "s16": s16, "s24": s24, "s64": s64, "scaled": scaled / 1000}
    values |= {"u40": u40, "i40": i40, "u48": u48 / 1000, "i56": i56}
    expected = bytes([magnitude(s8, 8)]) + magnitude(s16, 16).to_bytes(2, "big")
    expected += b"".join(magnitude(n, 24).to_bytes(3, "little") for n in s24) + magnitude(s64, 64).to_bytes(8, "little")
    expected += (
        magnitude(scaled, 32).to_bytes(4, "big") + u40.to_bytes(5, "little") + i40.to_bytes(5, "big", signed=True)
    )
    expected += u48.to_bytes(6, "big") + i56.to_bytes(7, "little", signed=True)
    assert payload_of("magnitudes", values) == expected
    assert received("magnitudes", expected).fields == values


def of_fields(fields: str) -> Protocol:
    """A protocol with one message."""
    frame = "wirebond: 1\nprotocol: p\nframe: [magic: 0xAA, id: u8, payload: by_id]\n"
    return loads(f"{frame}messages: {{m: {{id: 1, sender: mcu, fields: {{{fields}}}}}}}\n")


def digits(number: int, size: int) -> bytes:
    return bytes.fromhex(f"{number:0{2 * size}}")


@given(
    one=st.integers(0, 99), meters=st.integers(0, 999_999), many=st.integers(0, 10**14 - 1),
    near=st.integers(100, 2000), mode=st.sampled_from([0, 10, 99]), packed=ints(0, 999, 3),
    number=st.integers(0, 10**7 - 1),
)  # fmt: skip
def test_decimal_digits_lie_as_their_number_is_written(
    one: int, meters: int, many: int, near: int, mode: int, packed: list[int], number: int
) -> None:
    values = {"one": one, "meters": meters / 100, "many": many, "mode": {0: "off", 10: "slow", 99: "fast"}[mode]}
    values |= {"near": near, "packed": packed, "bits": {"start": 15, "number": number}}
    values |= {"apart": {"a": 1, "number": 7, "b": 2, "c": 3}, "three": {"x": 0.5, "f": False, "y": 0}}
    expected = digits(one, 1) + digits(meters, 3) + digits(many, 7)[::-1] + digits(mode, 1) + digits(near, 2)[::-1]
    expected += bytes.fromhex("".join(f"{n:03}" for n in packed) + "0") + bytes.fromhex(f"f{number:07}")
    expected += bytes.fromhex("10 02 00 00 07 03") + b"\1\0\0\0"
    assert payload_of("digits", values) == expected
    message = received("digits", expected)
    assert message.fields == values
    assert message.violations == []


def test_an_invalid_decimal_digit_is_refused() -> None:
    values = {"one": 12, "meters": 0.5, "many": 3, "mode": "slow", "near": 200, "packed": [1, 2, 3]}
    values["bits"] = {"start": 0, "number": 4}
    values |= {"apart": {"a": 0, "number": 7, "b": 0, "c": 0}, "three": {"x": -1.5, "f": False, "y": 9}}
    payload = bytearray(payload_of("digits", values))
    for place, path in ((0, "one"), (3, "meters"), (5, "many"), (11, "mode"), (12, "near"), (14, "packed[0]")):
        wrong = bytearray(payload)
        wrong[place] |= 0x0F
        (fault,) = received("digits", bytes(wrong)).violations
        assert fault.startswith(f"digits.{path} has the digits 0x")
    columns = SHAPES.decode_columns(SHAPES.encode("digits", values), "mcu")["digits"]
    assert [columns[name][0] for name in ("one", "meters", "many", "near", "bits.number")] == [12, 0.5, 3, 200, 4]


@given(number=st.integers(0, 10**7 - 1), x=st.integers(-256, 255), f=st.booleans(), y=st.integers(0, 4095))
def test_a_value_whose_bits_lie_apart_is_gathered_from_its_pieces(number: int, x: int, f: bool, y: int) -> None:
    values = {"one": 0, "meters": 0.0, "many": 0, "mode": "off", "near": 100, "packed": [0, 0, 0]}
    values["bits"] = {"start": 0, "number": 0}
    values["apart"] = {"a": 1, "number": number, "b": 2, "c": 3}
    values["three"] = {"x": x / 2, "f": f, "y": y}
    all_digits, bits = f"{number:07}", x % 512
    three = bits & 7 | f << 3 | (y & 31) << 4 | (bits >> 3 & 15) << 9 | (y >> 5) << 13 | (bits >> 7) << 20
    expected = bytes.fromhex(f"1{all_digits[0]}02{all_digits[1:]}03") + three.to_bytes(4, "little")
    payload = payload_of("digits", values)
    assert payload[-10:] == expected
    assert received("digits", payload).fields == values
    columns = SHAPES.decode_columns(SHAPES.encode("digits", values), "mcu")["digits"]
    assert [columns[name][0] for name in ("apart.number", "three.x", "three.f", "three.y")] == [number, x / 2, f, y]


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ("a: u4, b: {type: u4, continues: c}", "no value before this one is called `c`; "),
        ("b: {type: u4, continues: a}, a: u4", "no value before this one is called `a`; the value comes first"),
        ("a: u4, b: {type: i4, continues: a}", "`a` is `u4`; write `u4` here, too"),
        ("a: bcd4, b: {type: u8, continues: a}", "`a` is `bcd4`; write `bcd8` here, too"),
        ("a: u4, b: {type: u4, continues: a, scale: 2}", "these are bits of `a`; write `scale` there"),
        ("a: bool, b: {type: bool, continues: a}", "`a` is not a whole number of its own, so nothing continues it; "),
        ("a: {type: u4, constant: 3}, b: {type: u4, continues: a}", "so nothing continues it"),
        ("a: bcd32, b: {type: bcd32, continues: a}", "`a` has 64 bits in all; it can have 60 at most"),
        ("a: u40, b: {type: u32, continues: a}", "`a` has 72 bits in all; it can have 64 at most"),
        ("a: u4, b: {type: u61, continues: a}", "`a` has 65 bits in all"),
        ("a: u4, b: {type: u4, continues: a}, c: {type: u4, continues: b}", "no value before this one is called `b`"),
    ],
)
def test_fields_that_cannot_continue_a_value(fields: str, sentence: str) -> None:
    with pytest.raises(wirebond.ProtocolFileError, match=re.escape(sentence)):
        of_fields(f"x: {{bits: {{type: u64, fields: {{{fields}}}}}}}")


@pytest.mark.parametrize("first", ["low", "high"])
@pytest.mark.parametrize(("order", "expected"), [("le", "34 12"), ("be", "12 34")])
def test_a_value_may_be_all_pieces_of_its_number(first: str, order: str, expected: str) -> None:
    pieces = "{low: u8, high: {type: u8, continues: low}}"
    model = of_fields(f"x: {{bits: {{type: u16{order}, first: {first}, fields: {pieces}}}}}")
    assert wirebond.Codec(model).encode("m", x={"low": 0x1234}) == bytes.fromhex(f"aa 01 {expected}")


def test_a_value_in_pieces_counts_nothing() -> None:
    bits = "{bits: {type: u16, fields: {n: u4, o: u4, m: {type: u4, continues: n}}}}"
    with pytest.raises(wirebond.ProtocolFileError, match=re.escape("`b.n` cannot count")):
        of_fields(f"b: {bits}, l: {{type: u8, count: b.n, max: 9}}")


def test_a_constant_of_decimal_digits_is_its_digits() -> None:
    model = of_fields(
        "version: {type: bcd16be, constant: 210}, x: {bits: {type: u8, fields: {low: {type: bcd4, constant: 7}}}}"
    )
    assert wirebond.Codec(model).encode("m") == bytes.fromhex("aa 01 02 10 07")


@pytest.mark.parametrize(
    ("field", "sentence"),
    [
        ("{type: bcd64}", "`bcd64` is not a type here"),
        ("{type: bcd10}", "`bcd10` is not a type here"),
        ("{type: bcd8, range: [0, 100]}", "100 does not fit"),
        ("{type: bcd8, flags: {a: 0}}", "`flags` is for unsigned whole numbers"),
        ("{type: bcd8, enum: {a: 100}}", "100 does not fit bcd8 (from 0 to 99)"),
        ("{type: bcd8, default: 100}", "100 does not fit `x`, which takes values from 0 to 99"),
        ("{type: bcd32, clock: mcu, unit: us}", "`clock` is for one unsigned number"),
    ],
)
def test_keys_that_decimal_digits_cannot_have(field: str, sentence: str) -> None:
    with pytest.raises(wirebond.ProtocolFileError, match=re.escape(sentence)):
        of_fields(f"x: {field}")


def test_minus_zero_is_zero() -> None:
    payload = bytes([0x80]) + bytes(SHAPES.model.message("magnitudes").min_payload - 1)
    assert received("magnitudes", payload).fields["s8"] == 0


# ---- structs, groups, counted strings


def point(x: int, y: int) -> bytes:
    return struct.pack("<h", x) + struct.pack(">h", y)


SCAN = {
    "origin": {"at": {"x": 1.0, "y": -2.0}, "mode": "moving"},
    "points": [{"x": 0.001, "y": 0.002}, {"x": -0.003}],
    "echoes": [0x0102, 0x0304],
    "corners": [{"pose": {"at": {"x": 0.0}}, "far": 1.5}, {"pose": {"at": {"x": 0.0}}, "far": -1.0}],
    "name": "né",
    "own": {"raw": b"\x09\x08"},
    "legs": [{"steps": [{"size": -1, "on": {"it": True}}]}, {"steps": []}],
}
SCAN_BYTES = b"".join(
    (
        b"\x02", point(1000, -2000), b"\x01", point(1, 2), point(-3, 0), b"\x01\x02\x03\x04", b"\x03\x00",
        point(0, 0), b"\x00", struct.pack("<f", 1.5), point(0, 0), b"\x00", struct.pack("<f", -1.0), "né".encode(),
        b"\x07\x02\x09\x08", b"\x01\xff\x01", b"\x00",
    )
)  # fmt: skip


def test_structs_and_groups_lie_as_packed_by_hand() -> None:
    assert payload_of("scan", SCAN) == SCAN_BYTES
    message = received("scan", SCAN_BYTES)
    assert message.violations == []
    assert message.fields["points"] == [{"x": 0.001, "y": 0.002}, {"x": -0.003, "y": 0.0}]
    assert message.fields["own"] == {"a": 7, "counted": 2, "raw": b"\x09\x08"}
    assert message.fields["legs"][0] == {"many": 1, "steps": [{"size": -1, "on": {"it": True}}]}
    assert (message.fields["n"], message.fields["name"], message.fields["echoes"]) == (2, "né", [0x0102, 0x0304])
    assert payload_of("scan", message.fields) == SCAN_BYTES


def test_missing_values_take_their_default() -> None:
    payload = payload_of("defaults", {})
    assert payload == struct.pack("<3h2f", 1, -2, 3, 0.5, 0.5) + b"\x01\x01\x01\x00\x09\x01\x02\x00\x09\x07\x08"
    assert received("defaults", payload).fields["place"] == {"x": 9}
    assert payload_of("samples", {"values": []}) == b"\x05\x00\x00\x00"


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"points": [{"x": 1}, {"x": 31}]}, "scan.points[1].x = 31 m is outside -30 ... 30 m"),
        ({"points": [{"y": 1}, {"x": 1}]}, "scan.points[0] needs x, which has no default"),
        ({"points": [{"x": 1, "z": 1}]}, "scan.points[0] has no field 'z'; it has x, y"),
        ({"points": [5]}, "scan.points[0] is 5 (int); expected a dict of x, y"),
        ({"points": {"x": 1}}, "scan.points is {'x': 1} (dict); expected a list of at most 5"),
        ({"points": [{"x": 0}] * 6}, "scan.points has 6 elements; expected at most 5"),
        ({"points": [{"x": 0}]}, "scan.n is 1, and scan.echoes, which it counts, has 2 elements"),
        ({"n": 3}, "scan.n is 3, and scan.points, which it counts, has 2 elements; leave n out, it is counted"),
        ({"n": 300}, "scan.n = 300 does not fit its 8-bit wire type, which holds 0 ... 255"),
        ({"corners": []}, "scan.corners has 0 elements; expected 2"),
        ({"name": "0123456789"}, "scan.name has 10 bytes; it holds at most 9"),
        ({"own": {"raw": "x"}}, "scan.own.raw is 'x' (str); expected bytes"),
        ({"own": 3}, "scan.own is 3 (int); expected a dict of a, counted, raw"),
        ({"legs": [{"steps": [{"size": 1, "on": {"it": 2}}]}]}, "scan.legs[0].steps[0].on.it is 2 (int); expected"),
    ],
)  # fmt: skip
def test_wrong_value_within_a_struct_is_refused_with_its_path(change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(MessageError) as caught:
        SHAPES.encode("scan", SCAN | change)
    assert sentence in str(caught.value)


def changed(at: int, value: int) -> bytes:
    return SCAN_BYTES[:at] + bytes([value]) + SCAN_BYTES[at + 1 :]


@pytest.mark.parametrize(
    ("payload", "sentence"),
    [
        (changed(0, 200), "scan.n says 200 elements, and scan.points has at most 5"),
        (SCAN_BYTES[:28], "scan.n says 2 elements, and scan.points has 0 in this payload"),
        (changed(18, 200), "scan.name_size says 200 bytes, and scan.name has at most 9"),
        (changed(len(SCAN_BYTES) - 4, 3), "scan.legs[0].many says 3 elements, and scan.legs[0].steps has 1 in this"),
        (changed(5, 7), "scan.origin.mode is 7, which is not an enumerator"),
        (changed(7, 0x7F), "scan.points[0].x = 32.513 m is outside -30 ... 30 m"),
        (changed(len(SCAN_BYTES) - 1, 9), "scan.legs[1].many says 9 elements"),
    ],
    ids=range(7),
)
def test_payload_that_contradicts_itself_is_delivered_with_its_violation(payload: bytes, sentence: str) -> None:
    message = received("scan", payload)
    assert [text for text in message.violations if sentence in text]
    assert set(message.fields) >= set(SCAN)


def flat(values: Any, name: str = "") -> dict[str, Any]:
    """A message's values by the names of their columns. Lists of plain values stay."""
    if isinstance(values, dict):
        return {k: v for key, value in values.items() for k, v in flat(value, f"{name}.{key}" if name else key).items()}
    if isinstance(values, list) and values and isinstance(values[0], dict):
        return {k: v for i, value in enumerate(values) for k, v in flat(value, f"{name}[{i}]").items()}
    return {name: values}


def test_every_element_of_a_group_has_its_columns() -> None:
    source = random.Random(7)
    frames = [SHAPES.encode("scan", random_values(SHAPES.model.message("scan"), source)) for _ in range(200)]
    stream = b"".join(frames)
    rows = [flat(m.fields) for m in SHAPES.decoder("mcu").feed(stream)]
    scan = SHAPES.decode_columns(stream, "mcu")["scan"]
    assert {"points[0].x", "points[4].y", "corners[1].pose.at.x", "legs[3].steps[2].size"} <= set(scan)
    assert "points" not in scan
    assert {len(column) for column in scan.fields.values()} == {200}
    lacking = 0
    for name in (name for name in scan if "[" in name):
        for value, row in zip(scan[name], rows, strict=True):
            wanted = row.get(name)
            if name not in row:
                lacking += 1
                assert value is None or np.isnan(value), name
            elif isinstance(wanted, str):  # of an enum: columns have its number
                assert float(value).is_integer()
            else:
                assert (list(value) if isinstance(wanted, list) else value) == wanted, name
    assert lacking > 200


def test_an_element_of_an_array_has_a_name() -> None:
    source = random.Random(6)
    frame = SHAPES.encode("streams", random_values(SHAPES.model.message("streams"), source))
    table = SHAPES.decode_columns(frame, "mcu")["streams"]
    assert table["channels[15]"].tolist() == table["channels"][:, 15].tolist()
    assert "channels[15]" in table
    for name in ("channels[16]", "channels[x]", "channels[0", "gap[0]", "x[0]"):
        assert name not in table
        with pytest.raises(KeyError, match="the table has no column"):
            table[name]


def test_columns_have_dotted_names_and_lists_where_elements_vary() -> None:
    source = random.Random(5)
    frames = [SHAPES.encode("scan", random_values(SHAPES.model.message("scan"), source)) for _ in range(200)]
    frames += [SHAPES.encode("bits", random_values(SHAPES.model.message("bits"), source)) for _ in range(50)]
    stream = b"".join(frames)
    messages = SHAPES.decoder("mcu").feed(stream)
    columns = SHAPES.decode_columns(stream, "mcu")
    rows = [m.fields for m in messages if m.name == "scan"]
    scan = columns["scan"]
    assert scan["origin.at.x"].tolist() == [row["origin"]["at"]["x"] for row in rows]
    assert scan["own.a"].tolist() == [row["own"]["a"] for row in rows]  # behind what varies
    assert scan["own.raw"] == [row["own"]["raw"] for row in rows]
    assert scan["n"].tolist() == [row["n"] for row in rows]
    for name in ("echoes", "name"):
        assert scan[name] == [row[name] for row in rows]
    bits = [m.fields for m in messages if m.name == "bits"]
    assert columns["bits"]["low.gain"].tolist() == [row["low"]["gain"] for row in bits]
    assert columns["bits"]["much.a"].tolist() == [row["much"]["a"] for row in bits]
    assert columns["bits"]["high.amount"].dtype == "int8"


def test_columns_of_packed_streams_have_a_row_for_each_message() -> None:
    source = random.Random(6)
    frames = [SHAPES.encode("streams", random_values(SHAPES.model.message("streams"), source)) for _ in range(20)]
    table = SHAPES.decode_columns(b"".join(frames), "mcu")["streams"]
    fields = [m.fields for m in SHAPES.decoder("mcu").feed(b"".join(frames))]
    assert table["channels"].shape == (20, 16)
    assert table["channels"].tolist() == [f["channels"] for f in fields]
    assert table["angles"].tolist() == [f["angles"] for f in fields]
    assert table["switches"].tolist() == [f["switches"] for f in fields]
    assert "gap" not in table


# ---- the generated C++


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Reads lines of an index and a payload; answers with violations and the payload written again."""
    folder = tmp_path_factory.mktemp("fields")
    generate_cpp(SHAPES.model, folder)
    cases = "\n".join(
        f"    case {index}: answer<shapes::{struct_name}>(bytes); break;"
        for index, struct_name in enumerate(struct_names(SHAPES.model).values())
    )
    (folder / "main.cpp").write_text(
        """
        #include <cstdio>
        #include <iostream>
        #include <memory>
        #include <sstream>
        #include <string>
        #include <vector>
        #include "shapes.hpp"
        template <class Message> void answer(const std::vector<std::uint8_t>& bytes) {
          Message message;
          const std::unique_ptr<std::uint8_t[]> exact(new std::uint8_t[bytes.size()]);  // so that overruns are seen
          std::copy(bytes.begin(), bytes.end(), exact.get());
          if (!decode(exact.get(), bytes.size(), message)) { std::puts("refused"); return; }
          std::vector<std::uint8_t> out(payload_bytes(message), 0xEE);
          const bool written = write_payload(message, out.data());
          std::printf("%u ", static_cast<unsigned>(violations(message)));
          for (const std::uint8_t byte : out) std::printf("%02x", byte);
          std::puts(written ? "" : "-");
        }
        int main() {
          std::string line;
          while (std::getline(std::cin, line)) {
            std::istringstream words(line);
            int index = 0;
            std::string hex;
            words >> index >> hex;
            std::vector<std::uint8_t> bytes;
            for (std::size_t i = 0; i + 1 < hex.size(); i += 2) {
              bytes.push_back(static_cast<std::uint8_t>(std::stoi(hex.substr(i, 2), nullptr, 16)));
            }
            switch (index) {
        """
        + cases
        + "\n    }\n  }\n}\n",
        encoding="utf-8",
    )
    made = folder / "fields"
    command = [CXX, "-std=c++17", "-O0", "-Wall", "-Wextra", "-Werror", *SANITIZE, f"-I{folder}"]
    command += [str(folder / "main.cpp"), "-o", str(made)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return made


def answers(program: Path, payloads: list[tuple[int, bytes]]) -> list[str]:
    text = "".join(f"{index} {payload.hex()}\n" for index, payload in payloads)
    done = subprocess.run([str(program)], input=text, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.live
def test_generated_code_writes_what_the_engine_writes(program: Path) -> None:
    source = random.Random(7)
    messages = SHAPES.model.messages
    payloads = [
        (index, payload_of(message.name, random_values(message, source)))
        for index, message in enumerate(messages)
        for _ in range(200)
    ]
    assert answers(program, payloads) == [f"0 {payload.hex()}" for _, payload in payloads]


@pytest.mark.live
def test_generated_code_and_engine_validate_any_payload_alike(program: Path) -> None:
    source = random.Random(8)
    messages = SHAPES.model.messages
    payloads = []
    while len(payloads) < 4000:
        index = source.randrange(len(messages))
        message = messages[index]
        payload = damaged(payload_of(message.name, random_values(message, source)), source)
        if len(payload) >= message.min_payload:
            payloads.append((index, payload))
    refused = passed = 0
    for (index, payload), answer in zip(payloads, answers(program, payloads), strict=True):
        name = messages[index].name
        message = received(name, payload)
        violations_told = [text for text in message.violations if not any(mark in text for mark in ONLY_IN_PYTHON)]
        contradicts = any(mark in text for text in violations_told for mark in UNREADABLE)
        assert (answer == "refused") == contradicts, (name, payload.hex(), violations_told)
        if contradicts:
            refused += 1
            continue
        violations, _, written = answer.partition(" ")
        assert (violations != "0") == bool(violations_told), (name, payload.hex(), violations_told)
        if not message.violations:
            passed += 1
            assert written == payload_of(name, message.fields).hex(), (name, payload.hex())
    assert refused > 100
    assert passed > 500
