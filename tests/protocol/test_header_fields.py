"""Header fields: what the file may say of them, what they mean, and the sentence for each mistake."""

from __future__ import annotations

import pytest

from wirebond.errors import ProtocolFileError
from wirebond.protocol import loads, protocol_hash
from wirebond.protocol.model import TWOS_COMPLEMENT, Address, End, HeaderField, Protocol
from wirebond.protocol.planning import plan_for
from wirebond.protocol.spelling import part_text

RICH = (
    "{field: servo, type: u8, default: 1, address: mcu, broadcast: 254}",
    "{field: temperature, type: i16be, scale: 0.1, unit: K, range: [-40, 200]}",
    "{field: state, type: u8, flags: {voltage: 0, angle: 1}, default: [angle]}",
    "{field: system, type: u8, default: {host: 255, mcu: 1}}",
    "{field: stamp, type: u64}",
    "{bits: u64be, fields: {kind: {bits: 3, enum: {ping: 1, read: 2}, default: ping}, hops: i5, time: 56}}",
)


def protocol(*parts: str, head: str = "wirebond: 1\nprotocol: bus\n") -> Protocol:
    lines = "".join(f"  - {part}\n" for part in ("magic: 0xFF", *parts, "id: u8", "payload: 4", "check: xor8"))
    return loads(f"{head}frame:\n{lines}messages: {{m: {{id: 1, sender: both}}}}\n")


def fields(*parts: str) -> dict[str, HeaderField]:
    return {field.name: field for field in plan_for(protocol(*parts), End.HOST).header}


def test_all_options_of_a_number_reach_the_model() -> None:
    found = fields(*RICH)
    assert list(found) == ["servo", "temperature", "state", "system", "stamp", "kind", "hops", "time"]
    servo, temperature = found["servo"], found["temperature"]
    assert (servo.address, servo.broadcast, servo.default(End.MCU)) == (Address.MCU, (254,), 1)
    assert (temperature.value.coding.is_signed, temperature.value.scale.denominator) == (True, 10)
    assert (temperature.value.unit, temperature.value.minimum, temperature.value.maximum) == ("K", -40, 200)
    assert found["state"].default(End.HOST) == 2
    assert (found["system"].default(End.HOST), found["system"].default(End.MCU)) == (255, 1)
    assert found["kind"].default(End.HOST) == "ping"
    assert (found["hops"].value.width, found["hops"].value.coding) == (5, TWOS_COMPLEMENT)
    assert (found["stamp"].value.width, found["time"].value.width) == (64, 56)


def test_the_words_of_a_part_load_as_the_same_part() -> None:
    model = protocol(*RICH)
    texts = [part_text(model.format.parts, index) for index in range(1, 1 + len(RICH))]
    assert protocol(*texts).format == model.format


def test_every_form_takes_its_values_from_one_list() -> None:
    model = protocol(
        "{field: flags, type: u8}", "{field: stamp, type: u16, when: flags & 0x80}", "{field: hops, type: u8}"
    )
    plan = plan_for(model, End.HOST)
    assert [field.name for field in plan.header] == ["flags", "stamp", "hops"]
    places = [{entry.name: entry.place for entry in form.header} for form in plan.forms]
    assert places == [{"flags": 0, "hops": 2}, {"flags": 0, "stamp": 1, "hops": 2}]
    assert [(form.header[0].fixed_mask, form.header[0].fixed_value) for form in plan.forms] == [(128, 0), (128, 128)]


def test_each_end_has_its_own_defaults_and_the_forms_that_follow_from_them() -> None:
    model = protocol("{field: flags, type: u8, default: {host: 1, mcu: 0}}", "{reserved: 2, when: flags & 0x01}")
    first = {end: plan_for(model, end).forms[0] for end in (End.HOST, End.MCU)}
    assert [(form.prefix, form.header[0].default) for form in first.values()] == [(5, 1), (3, 0)]


@pytest.mark.parametrize(
    ("part", "end", "address", "peer"),
    [
        ("{field: servo, type: u8, address: mcu}", End.HOST, 0, None),
        ("{field: servo, type: u8, address: mcu}", End.MCU, None, 0),
        ("{field: to, type: u8, address: receiver}", End.HOST, 0, None),
        ("{field: to, type: u8, address: receiver}", End.MCU, 0, None),
        ("{field: source, type: u8, address: sender}", End.MCU, None, 0),
    ],
)
def test_the_plan_has_receiver_and_sender_of_a_frame(
    part: str, end: End, address: int | None, peer: int | None
) -> None:
    plan = plan_for(protocol(part), end)
    assert (plan.address, plan.peer) == (address, peer)


def test_sixteen_fields_are_possible() -> None:
    assert len(fields(*(f"{{field: h{i}, type: u8}}" for i in range(16)))) == 16
    with pytest.raises(ProtocolFileError, match="17 fields in its header; at most 16 are possible"):
        fields(*(f"{{field: h{i}, type: u8}}" for i in range(17)))


@pytest.mark.parametrize(
    ("part", "sentence"),
    [
        ("{field: x, type: f32}", "5:22: `f32` is not a type of a header field; possible: u8, i8 and s8 to u64"),
        ("{field: x, type: uint64_t}", "`uint64_t` is not a type here; write `u64`"),
        ("{field: x, type: u8le}", "`u8le` has no byte order to choose; write `u8`"),
        ("{field: x, type: u8, default: 256}", "5:35: 256 does not fit `x`, which takes values from 0 to 255"),
        (
            "{field: x, type: u8, default: {host: 1}}",
            "this mapping is not a default; write one value, or `{host: 255, mcu",
        ),
        ("{field: x, type: u8, default: {host: 1, mcu: 256}}", "5:50: 256 does not fit `x`"),
        (
            "{field: x, type: u8, enum: {a: 1}}",
            "5:5: `x` cannot be 0, which is sent where the sender gives no value; add",
        ),
        ("{field: x, type: u8, range: [3, 9]}", "add for example `default: 3`"),
        ("{field: x, type: u8, enum: {a: 0, b: 300}}", "300 does not fit u8 (from 0 to 255)"),
        ("{field: x, type: i8, flags: {a: 0}}", "`flags` is for unsigned whole numbers; take u8"),
        ("{field: x, type: u8, scale: 0.1, enum: {a: 0}}", "`scale` has no meaning for named numbers"),
        ("{field: x, type: u8, broadcast: 3}", "`broadcast` belongs to the address of a receiver; add `address: mcu`"),
        ("{field: x, type: u8, address: mcu, broadcast: 300}", "300 does not fit `x`"),
        ("{field: x, type: u8, address: mcu, broadcast: 0}", "the default of `x`, 0, is its broadcast"),
        ("{field: x, type: u8, address: host}", "`host` is not possible here; possible: mcu, receiver, sender"),
        ("{field: x, type: u8, address: mcu, scale: 2}", "`x` is an address, and those are whole numbers"),
        ("{bits: u8, fields: {a: f32}}", "`f32` is not a type of a run of bits; possible: u1 to u64, i2 to i64"),
        (
            "{bits: u8, fields: {a: {default: 1}}}",
            "`a` needs its number of bits; write `bits: 4` or a `type`, not both",
        ),
        ("{bits: u8, fields: {a: {bits: 8, type: u8}}}", "`a` needs its number of bits; write `bits: 4` or a `type`"),
        (
            "{bits: u8, fields: {a: {bits: 8, constant: 1, scale: 2}}}",
            "`scale` is for header fields, and this is a const",
        ),
        ("{bits: u64, fields: {length: 40, x: 24}}", "a run `length` has at most 32 bits; take fewer"),
    ],
)
def test_a_mistake_gets_its_sentence(part: str, sentence: str) -> None:
    with pytest.raises(ProtocolFileError) as refused:
        protocol(part)
    assert sentence in str(refused.value)


def test_two_fields_of_one_name_are_refused() -> None:
    with pytest.raises(
        ProtocolFileError, match=r"6:25: another header field is called `x` .line 5.; take another name"
    ):
        protocol("{field: x, type: u8}", "{bits: u8, fields: {x: 8}}")


def test_a_second_address_is_refused() -> None:
    for one, two in (("mcu", "mcu"), ("mcu", "receiver"), ("sender", "mcu"), ("receiver", "receiver")):
        with pytest.raises(ProtocolFileError, match=f"`a` says `address: {one}` already, and `address: {two}`"):
            protocol(f"{{field: a, type: u8, address: {one}}}", f"{{field: b, type: u8, address: {two}}}")


def test_the_hash_covers_what_a_header_field_means_and_not_its_defaults() -> None:
    plain = protocol_hash(protocol("{field: x, type: u8}"))
    for same in ("default: 3", "default: {host: 1, mcu: 2}", "unit: V", "address: mcu", "range: [0, 9]"):
        assert protocol_hash(protocol(f"{{field: x, type: u8, {same}}}")) == plain, same
    others = {protocol_hash(protocol(f"{{field: x, type: {other}}}")) for other in (
        "i8", "s8", "'u8', scale: 2", "u8, enum: {a: 0}", "u8, enum: {a: 0, b: 1}", "u8, flags: {a: 0}", "u16",
    )}  # fmt: skip
    assert len(others | {plain}) == 8
