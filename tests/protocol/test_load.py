"""A good protocol file is loaded correctly."""

from fractions import Fraction
from pathlib import Path

import pytest

from wirebond.codec import Codec
from wirebond.protocol import (
    BitOrder,
    ByteOrder,
    End,
    FieldKind,
    LengthCounts,
    OnRange,
    PartKind,
    PayloadRule,
    Protocol,
    Queue,
    Recover,
    load,
    loads,
    protocol_hash,
)
from wirebond.protocol.model import SIGN_MAGNITUDE, TWOS_COMPLEMENT
from wirebond.protocol.planning import plan_for

PROTOCOLS = Path(__file__).parents[2] / "protocols"
FILES = sorted(PROTOCOLS.glob("*.yaml"))


def rover(frame: str, *, extra: str = "", fields: str = "", message: str = "id: 1, sender: host") -> Protocol:
    fields = f", fields: {{{fields}}}" if fields else ""
    return loads(f"wirebond: 1\nprotocol: rover\n{extra}\nframe: [{frame}]\nmessages: {{one: {{{message}{fields}}}}}\n")


SIMPLE = "magic: 0x01, id: u8, payload: by_id, check: crc-16/modbus"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_protocol_of_the_project_loads_and_can_be_lowered_for_both_ends(path: Path) -> None:
    protocol = load(path)
    assert protocol.name == path.stem
    assert protocol.path == str(path)
    for end in (End.HOST, End.MCU):
        assert plan_for(protocol, end).max_payload == protocol.format.max_payload_from(end)


def test_diffdrive_is_what_its_specification_says() -> None:
    protocol = load(PROTOCOLS / "diffdrive.yaml")
    kinds = [part.kind.value for part in protocol.format.parts]
    assert kinds == ["magic", "id", "payload", "reserved", "check", "tail"]
    assert protocol.max_wire_bytes() == 11
    assert protocol.format.max_payload == 4
    assert not protocol.format.deliver_unknown
    check = protocol.format.parts[4]
    assert check.algorithm is not None
    assert (check.algorithm.name, check.ranges, check.size) == ("xor8", ((0, 3),), 1)
    linear = protocol.message("velocity").fields[0]
    assert (linear.coding, linear.size, linear.scale) == (TWOS_COMPLEMENT, 2, Fraction(1, 1000))
    assert (linear.minimum, linear.maximum, linear.on_range, linear.unit) == (-2.0, 2.0, OnRange.CLAMP, "m/s")
    assert protocol.message("velocity").every == 0.05
    assert protocol.message("status_query").reply == "status"
    assert dict(protocol.message("status").fields[1].flags)["encoder"] == 4
    assert [(d.message, d.at, d.after, d.then) for d in protocol.deadlines][1] == (
        "velocity",
        End.MCU,
        3.0,
        "safe_mode",
    )
    assert protocol.deadlines[1].recover == Recover.EXPLICIT
    by = protocol.deadlines[1].recover_by
    assert by is not None and by.message == "parameter" and dict(by.values) == {"name": "clear_safe_mode", "value": 0.0}
    (stop,) = protocol.emergency_stop
    assert dict(stop.values) == {"linear": 0.0, "angular": 0.0}


def test_a_stop_of_several_messages_keeps_its_order_and_is_not_in_the_hash() -> None:
    text = (PROTOCOLS / "diffdrive.yaml").read_text()
    stop = "emergency_stop: {message: velocity, linear: 0, angular: 0}"
    several = loads(
        text.replace(stop, "emergency_stop:\n  - message: status_query\n  - {message: velocity, linear: 0, angular: 0}")
    )
    assert [stop.message for stop in several.emergency_stop] == ["status_query", "velocity"]
    assert protocol_hash(several) == protocol_hash(loads(text))


def test_enterprize_checks_its_header_before_its_whole() -> None:
    protocol = load(PROTOCOLS / "enterprize.yaml")
    header, whole = (part for part in protocol.format.parts if part.kind == PartKind.CHECK)
    assert (header.name, header.ranges) == ("header_check", ((0, 2),))
    assert (whole.name, whole.ranges) == ("check", ((0, 4),))
    assert protocol.format.deliver_unknown
    assert protocol.format.max_payload == 41
    assert protocol.link.bits_per_byte == 11


def test_native_is_between_zeros_and_names_its_services() -> None:
    protocol = load(PROTOCOLS / "native.yaml")
    assert (protocol.format.delimiter, protocol.format.stuffing, protocol.format.max_payload) == (b"\x00", "cobs", 64)
    assert [service.name for service in protocol.services] == ["hello", "ping", "clock", "log", "parameter"]
    parameter = protocol.service("parameter")
    assert parameter is not None
    assert parameter.message("value") == "parameter_value"
    (stop,) = protocol.emergency_stop
    assert dict(stop.values) == {"speed": 0.0, "mode": "idle"}


def test_a_high_byte_of_a_sum_is_one_byte_and_too_weak_to_deliver_unknown_messages() -> None:
    check = load(PROTOCOLS / "pid_tuner.yaml").format.parts[4]
    assert (check.size, check.shift, check.ranges) == (1, 8, ((1, 3),))
    assert not load(PROTOCOLS / "pid_tuner.yaml").format.deliver_unknown


def test_missing_keys_have_the_documented_defaults() -> None:
    protocol = rover(SIMPLE)
    assert (protocol.link.baud, protocol.link.data_bits, protocol.link.parity) == (115200, 8, "none")
    assert protocol.link.stop_bits == 1
    assert (protocol.link.max_run, protocol.link.max_age) == (0.001, None)
    assert {message.queue for message in protocol.messages} == {Queue.NORMAL}
    assert protocol.format.parts[3].order == ByteOrder.LITTLE
    assert (protocol.idle, protocol.description, protocol.emergency_stop) == (None, "", ())
    assert protocol.path == "<text>"


@pytest.mark.parametrize(
    ("frame", "extra", "delivered"),
    [
        ("magic: 0x01, length: u8, id: u8, payload: by_length, check: crc-16/modbus", "", True),
        ("magic: 0x01, length: u8, id: u8, payload: by_length, check: sum16", "", True),
        ("magic: 0x01, length: u8, id: u8, payload: by_length, check: crc-8", "", False),
        ("magic: 0x01, length: u8, id: u8, payload: by_length, check: {type: crc-32, byte: low}", "", False),
        (
            "magic: 0x01, length: u8, id: u8, payload: by_length, check: {type: crc-32, over: payload}",
            "",
            False,
        ),
        ("magic: 0x01, length: u8, id: u8, check: crc-32, payload: by_length", "", False),
        ("magic: 0x01, id: u8, payload: by_id, check: crc-32", "", False),
        (
            "magic: 0x01, {field: flags, type: u8}, id: u8, length: u8, payload: by_length, "
            "{check: sum16, when: flags & 0x01}",  # other frames have none
            "",
            False,
        ),
        (
            "magic: 0x01, id: u8, length: u8, payload: by_length, {check: sum16, when: sender == host}, "
            "{check: crc-32, name: theirs, when: sender == mcu}",
            "",
            True,
        ),
        (
            "magic: 0x01, id: u8, length: u8, payload: by_length, {check: sum16, when: sender == host}, "
            "{check: {type: crc-32, over: length..payload}, name: theirs, when: sender == mcu}",
            "",
            False,
        ),
        (
            "magic: 0x01, length: u8, id: u8, payload: by_length, check: {type: sum16, mask: 0x7FFF}",
            "",
            False,
        ),
        ("magic: 0x01, length: u8, id: u8, payload: by_length, check: crc-8", "unknown: deliver", True),
        ("magic: 0x01, length: u8, id: u8, payload: by_length, check: crc-32", "unknown: reject", False),
    ],
)
def test_unknown_frames_are_delivered_where_a_strong_check_covers_them(frame: str, extra: str, delivered: bool) -> None:
    assert rover(frame, extra=extra).format.deliver_unknown is delivered


def test_the_files_byte_order_holds_where_a_type_names_none() -> None:
    frame = (
        "magic: 0x01, length: u16le, id: u16, payload: by_length, check: {type: crc-32, "
        "byte_order: little}, check: crc-32"
    )
    protocol = rover(frame, extra="byte_order: big", fields="a: {type: i24}, b: {type: f64le}")
    assert [part.order.value for part in protocol.format.parts if part.kind != PartKind.PAYLOAD][1:] == [
        "little", "big", "little", "big",
    ]  # fmt: skip
    a, b = protocol.messages[0].fields
    assert (a.size, a.order, b.size, b.order) == (3, ByteOrder.BIG, 8, ByteOrder.LITTLE)


@pytest.mark.parametrize(("counts", "bias"), [("payload", 0), ("rest", -3), ("self_and_rest", -5), ("frame", -6)])
def test_a_length_may_count_more_than_the_payload(counts: str, bias: int) -> None:
    frame = f"magic: 0x01, length: {{type: u16, counts: {counts}, offset: 1}}, id: u8, payload: by_length, check: sum16"
    protocol = rover(frame)
    part = protocol.format.parts[1]
    assert (part.counts, part.length_offset, part.size) == (LengthCounts(counts), 1, 2)
    assert plan_for(protocol, None).forms[0].length_bias == bias - 1


def test_a_check_may_cover_named_parts_and_be_a_crc_of_ones_own() -> None:
    frame = (
        "magic: 0x01, {constant: 0xC0, name: version}, id: u8, payload: by_id, "
        "check: {type: crc, width: 16, poly: 0x1021, init: 0xFFFF, refin: true, refout: true, "
        "xorout: 1, over: version..id}"
    )
    part = rover(frame).format.parts[4]
    a = part.algorithm
    assert a is not None
    assert (part.ranges, part.size) == (((1, 2),), 2)
    assert (a.kind, a.width, a.poly, a.init, a.refin, a.refout, a.xorout) == (
        "crc",
        16,
        0x1021,
        0xFFFF,
        True,
        True,
        1,
    )


def test_a_check_over_one_part_names_it_alone() -> None:
    part = rover("magic: 0x01, id: u8, payload: by_id, check: {type: xor8, over: payload}").format.parts[3]
    assert part.ranges == ((2, 2),)


def test_parts_without_a_name_are_numbered() -> None:
    frame = "constant: 0x01, {constant: 0x02, name: constant_2}, constant: 0x03, id: u8, payload: by_id"
    names = [part.name for part in rover(frame).format.parts]
    assert names == ["constant", "constant_2", "constant_3", "id", "payload"]


def test_a_frame_without_an_id_carries_one_message_from_each_end() -> None:
    protocol = loads(
        "wirebond: 1\nprotocol: rover\nframe: [magic: 0x01, payload: 2, check: xor8]\n"
        "messages: {command: {sender: host, fields: {a: {type: u16}}}, answer: {sender: mcu}}\n"
    )
    assert [(m.name, m.id) for m in protocol.messages] == [("command", 0), ("answer", 0)]
    assert protocol.format.part(PartKind.ID) is None


def test_a_fixed_payload_is_the_greatest_one() -> None:
    protocol = rover("magic: 0x01, id: u8, payload: 20, check: xor8", fields="a: {type: u8}")
    assert protocol.format.max_payload == 20
    payload = protocol.format.part(PartKind.PAYLOAD)
    assert payload is not None
    assert (payload.payload, payload.fixed_payload) == (PayloadRule.FIXED, 20)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("50 ms", 0.05),
        ("1 s", 1.0),
        ("200 us", 200e-6),
        ("1.5 s", 1.5),
        ("20ms", 0.02),
        ("20 Hz", 0.05),
        ("0.5 Hz", 2.0),
    ],
)
def test_a_period_is_a_duration_or_a_rate(text: str, seconds: float) -> None:
    assert rover(SIMPLE, message=f"id: 1, sender: host, every: {text}").messages[0].every == seconds


def test_a_scale_is_the_decimal_as_written() -> None:
    fields = "a: {type: i16, scale: 0.1, offset: -273.15}, b: {type: i16, scale: 1e-7}, c: {type: i16, scale: 3}"
    a, b, c = rover(SIMPLE, fields=fields).messages[0].fields
    assert (a.scale, a.offset) == (Fraction(1, 10), Fraction(-27315, 100))
    assert (b.scale, c.scale) == (Fraction(1, 10**7), Fraction(3))


@pytest.mark.parametrize(
    ("field", "default"),
    [
        ("{type: u8, default: 3}", 3),
        ("{type: i16, scale: 0.1, default: 3}", 3.0),
        ("{type: f32, default: -1.5}", -1.5),
        ("{type: bool, default: true}", True),
        ("{type: u8, enum: {off: 0, on: 1}, default: on}", "on"),
        ("{type: u8, enum: {off: 0, on: 1}, default: 1}", 1),
        ("{type: u8, flags: {a: 0, b: 3}, default: 9}", 9),
        ("{type: text, size: 4, default: abcd}", "abcd"),
        ("{type: i16, scale: 0.001, range: [-3.14, 3.14], default: 3.14}", 3.14),
    ],
)
def test_a_default_is_kept_as_the_api_takes_it(field: str, default: object) -> None:
    found = rover(SIMPLE, fields=f"a: {field}").messages[0].fields[0].default
    assert found == default
    assert type(found) is type(default)


def test_a_text_reaches_to_the_payloads_end_or_has_a_fixed_size() -> None:
    frame = "magic: 0x01, length: u8, id: u8, payload: by_length"
    fixed, rest = rover(frame, fields="a: {type: bytes, size: 3}, b: {type: text, max: 9}").messages[0].fields
    assert (fixed.kind, fixed.size, fixed.is_variable) == (FieldKind.BYTES, 3, False)
    assert (rest.kind, rest.max_size, rest.is_variable) == (FieldKind.TEXT, 9, True)


def test_fields_within_fields_are_expanded() -> None:
    protocol = load(Path(__file__).parents[1] / "generate" / "code" / "every_shape.yaml")
    low, high, *_ = protocol.message("bits").fields
    assert (low.kind, low.size, low.first, [f.width for f in low.fields]) == (
        FieldKind.BITS, 2, BitOrder.LOW, [3, 5, 2, 4, 1],
    )  # fmt: skip
    assert (high.order, high.first, high.fields[2].coding) == (ByteOrder.BIG, BitOrder.HIGH, SIGN_MAGNITUDE)
    channels, gap, *_ = protocol.message("streams").fields
    assert (channels.packed, channels.bits, channels.count, channels.min_wire_bytes) == (BitOrder.LOW, 11, 16, 22)
    assert (gap.kind, gap.size) == (FieldKind.PADDING, 2)
    scan = {f.name: f for f in protocol.message("scan").fields}
    assert (scan["points"].type_name, scan["points"].max_count, scan["points"].counted_by) == ("point", 5, "n")
    assert [f.name for f in scan["points"].fields] == ["x", "y"]
    assert (scan["name"].counted_by, scan["name"].max_size, scan["name"].size) == ("name_size", 9, 0)
    assert (scan["corners"].count, scan["corners"].element_min_bytes) == (2, 9)
    assert [name for name, f in scan.items() if f.reaches_end] == ["legs"]
    defaults = {f.name: f.default for f in protocol.message("defaults").fields}
    assert defaults["numbers"] == (1, -2, 3)
    assert defaults["yes"] == (True, True)
    assert defaults["modes"] == ("on", "off")
    assert (defaults["faults"], defaults["key"], defaults["later"]) == (9, b"\x01\x02", (7, 8))


def test_words_that_older_yaml_took_for_truth_values_are_names() -> None:
    field = rover(SIMPLE, fields="a: {type: u8, enum: {off: 0, on: 1, yes: 2, no: 3}}").messages[0].fields[0]
    assert dict(field.enum) == {"off": 0, "on": 1, "yes": 2, "no": 3}


def test_an_alias_repeats_what_it_names() -> None:
    protocol = rover(SIMPLE, fields="a: &gain {type: f32, unit: V}, b: *gain")
    a, b = protocol.messages[0].fields
    assert (a.name, b.name, b.unit, b.size) == ("a", "b", "V", 4)


def test_two_loads_of_one_file_are_equal_in_any_folder(tmp_path: Path) -> None:
    copy = tmp_path / "copy.yaml"
    copy.write_bytes((PROTOCOLS / "native.yaml").read_bytes())
    assert load(copy) == load(str(PROTOCOLS / "native.yaml"))


def test_a_run_that_is_a_length_may_count_words() -> None:
    """As in the frames of the UM7, whose registers have four bytes."""
    frame = (
        "magic: 0x73, {bits: u8, fields: {spare: 2, length: 4, flags: 2}, unit: 4}, id: u8, payload: by_length, "
        "check: {type: sum16, byte_order: big}"
    )
    codec = Codec(rover(frame, fields="x: u32, y: u32"))
    raw = codec.encode("one", x=1, y=2)
    assert raw[1] >> 2 & 0x0F == 2
    assert [dict(message.fields) for message in codec.decoder("host").feed(raw)] == [{"x": 1, "y": 2}]


def test_eight_constant_bits_identify_a_frame() -> None:
    codec = Codec(
        rover("{bits: u8, fields: {a: {bits: 8, constant: 0xA5}}}, payload: 4", fields="x: u32", message="sender: host")
    )
    raw = codec.encode("one", x=0xA5A5A5)
    assert raw.hex() == "a5a5a5a500"
    assert [message["x"] for message in codec.decoder("host").feed(b"\x00" + raw + raw)] == [0xA5A5A5] * 2
