"""The frame format in C++: a plan as assignments that the compiler folds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields

from wirebond.generate.code.cpp_field import bool_literal, comment_text
from wirebond.protocol.model import Algorithm, ByteOrder, CheckKind, OddTail
from wirebond.protocol.plan import Exclusion, Form, Framing, HeaderNumber, Number, Plan, Position


def format_sizes(plans: Iterable[Plan]) -> tuple[int, int]:
    """Return the most forms of an end, and the most exclusions: one type for both, or its functions would be there
    twice."""
    sizes = [(len(plan.forms), sum(len(form.exclusions) for form in plan.forms)) for plan in plans]
    return max(forms for forms, _ in sizes), max(1, *(exclusions for _, exclusions in sizes))


def format_lines(plan: Plan) -> list[str]:
    """Return the assignments that fill a ``wirebond::FrameFormat`` named ``format``."""
    lines = [
        f"format.framing = wirebond::Framing::{plan.framing};",
        f"format.stuffing = wirebond::Stuffing::{plan.stuffing};",
    ]
    if plan.framing in (Framing.DELIMITED, Framing.BRACKETED):
        lines += [f"format.opening = {_mark(plan.opening)};", f"format.closing = {_mark(plan.closing)};"]
        lines += [] if plan.sends_opening else ["format.sends_opening = false;"]
    if plan.escapes is not None:
        escapes = plan.escapes
        lines += [
            f"format.escapes.escape = 0x{escapes.escape:02X};",
            f"format.escapes.exclusive_or = 0x{escapes.exclusive_or:02X};",
            f"format.escapes.count = {len(escapes.pairs)};",
        ]
        for i, (plain, code) in enumerate(escapes.pairs):
            lines.append(f"format.escapes.plain[{i}] = 0x{plain:02X};")
            lines.append(f"format.escapes.code[{i}] = 0x{code:02X};")
        lines += [f"format.escapes.starts = {plan.starts};"] if plan.starts else []
    if plan.insertion is not None:
        after = ", ".join(f"0x{byte:02X}" for byte in plan.insertion.after)
        lines.append(
            f"format.insertion = {{{len(plan.insertion.after)}, 0x{plan.insertion.byte:02X}, {{{{{after}}}}}}};"
        )
    if plan.length_on_wire:
        lines.append("format.length_on_wire = true;")
    lines += [
        f"format.form_count = {len(plan.forms)};",
        f"format.algorithm_count = {len(plan.algorithms)};",
        f"format.deliver_unknown = {'true' if plan.deliver_unknown else 'false'};",
        f"format.max_payload = {plan.max_payload};",
    ]
    if plan.no_id:
        lines.append(f"format.no_id = 0x{plan.no_id:X}U;")
    if plan.sequence is not None:
        lines.append(f"format.sequence_place = {plan.sequence};")
        if plan.sequence_per_message:
            lines.append("format.sequence_per_message = true;")
        if plan.peer is not None:
            lines.append(f"format.peer_place = {plan.peer};")
    if plan.own_forms != 1:
        lines.append(f"format.own_forms = {plan.own_forms};")
    if plan.skips_failed:
        lines.append("format.skips_failed = true;")
    for name in ("plain_front", "plain_back", "decimal_bytes"):
        lines += [f"format.{name} = {size};"] if (size := getattr(plan, name)) else []
    for number, algorithm in enumerate(plan.algorithms):
        lines.append(f"format.algorithms[{number}] = {_algorithm(algorithm)};  // {comment_text(algorithm.name)}")
    excluded = 0
    for number, form in enumerate(plan.forms):
        to = f"format.forms[{number}]"
        for exclusion in form.exclusions:
            lines.append(f"format.exclusions[{excluded}] = {_exclusion(exclusion)};")
            excluded += 1
        lines.append(f"{to}.payload_size = wirebond::PayloadSize::{form.payload.value};")
        lines += [f"{to}.{name} = {text};" for name, text in _plain_members(form)]
        counts = {
            "constant_count": len(form.constants),
            "check_count": len(form.checks),
            "header_count": len(form.header),
            "first_exclusion": excluded - len(form.exclusions) if form.exclusions else 0,
            "exclusion_count": len(form.exclusions),
        }
        lines += [f"{to}.{name} = {value};" for name, value in counts.items() if value]
        lines += [
            f"{to}.constants[{i}] = {{{_position(c.at)}, 0x{c.mask:02X}, 0x{c.value:02X}}};"
            for i, c in enumerate(form.constants)
        ]
        lines += [
            f"{to}.header[{i}] = {{{_header_number(f)}}};  // {comment_text(f.name)}" for i, f in enumerate(form.header)
        ]
        for i, c in enumerate(form.checks):
            places = ", ".join(_position(p) for p in (*c.ranges[0], c.at))
            order = f"wirebond::ByteOrder::{c.order.value}"
            flags = ", ".join(bool_literal(flag) for flag in (c.seeded, c.as_hex, c.on_wire))
            rule = f"{c.algorithm}, {places}, {c.bytes}, {order}, {c.shift}, {flags}, {c.continues}"
            lines.append(f"{to}.checks[{i}] = {{{rule}}};")
            for place, ends in enumerate(c.ranges[1:]):
                lines.append(f"{to}.checks[{i}].more[{place}] = {{{', '.join(map(_position, ends))}}};")
            if len(c.ranges) > 1:
                lines.append(f"{to}.checks[{i}].more_count = {len(c.ranges) - 1};")
            if c.run is not None:
                lines.append(f"{to}.checks[{i}].run = {_number(c.run)};")
            if c.covers_run:
                lines.append(f"{to}.checks[{i}].covers_run = true;")
    return lines


def _plain_members(form: Form) -> Iterator[tuple[str, str]]:
    """Yield the numbers of a form by their names in `wirebond::Form`, where they are not what it begins with."""
    begins_with = {"length_unit": 1, "payload_unit": 1}
    for member in fields(form):
        value = getattr(form, member.name)
        if isinstance(value, Number):
            yield member.name, _number(value)
        elif isinstance(value, bool):
            if value:
                yield member.name, bool_literal(value)
        elif isinstance(value, int) and value != begins_with.get(member.name, 0):
            yield member.name, str(value)


def _mark(delimiter: bytes) -> str:
    return f"{{{len(delimiter)}, {', '.join(f'0x{byte:02X}' for byte in delimiter)}}}"


def _position(position: Position) -> str:
    return f"{{{position.offset}, {'true' if position.from_end else 'false'}}}"


def _number(number: Number) -> str:
    order = f"wirebond::ByteOrder::{number.order.value}"
    return f"{{{_position(number.at)}, {number.bytes}, {order}, {number.shift}, 0x{number.mask:X}U}}"


def _exclusion(exclusion: Exclusion) -> str:
    number = "{}" if exclusion.number is None else _number(exclusion.number)
    place, seen = exclusion.place, bool_literal(exclusion.on_receive)
    return f"{{wirebond::Subject::{exclusion.subject}, {place}, {seen}, {number}, {exclusion.low}U, {exclusion.high}U}}"


def _header_number(entry: HeaderNumber) -> str:
    fixed = f", 0x{entry.fixed_mask:X}U, 0x{entry.fixed_value:X}U" if entry.fixed_mask else ""
    fixed += ", true" if entry.is_magic else ""
    return f"{_number(entry.number)}, 0x{entry.default:X}U, {entry.place}{fixed}"


def _check_kind(algorithm: Algorithm) -> str:
    return "wirebond::CheckKind::" + {CheckKind.XOR: "exclusive_or"}.get(algorithm.kind, algorithm.kind)


_ODD_TAILS: dict[str, str] = {OddTail.PAD: "pad", OddTail.XOR: "exclusive_or", OddTail.REFUSE: "refuse"}


def _algorithm(algorithm: Algorithm) -> str:
    flags = ", ".join(bool_literal(flag) for flag in (algorithm.refin, algorithm.refout))
    numbers = ", ".join(f"0x{n:X}U" for n in (algorithm.poly, algorithm.init, algorithm.xorout))
    rest = [
        str(algorithm.modulus),
        bool_literal(algorithm.negate),
        str(algorithm.unit),
        bool_literal(algorithm.unit_order == ByteOrder.LITTLE and algorithm.unit > 1),
        f"wirebond::OddTail::{_ODD_TAILS[algorithm.odd]}",
        bool_literal(algorithm.end_around),
        f"0x{algorithm.plus:X}U",
        f"0x{algorithm.kept:X}U",
        bool_literal(algorithm.bcd),
        str(len(algorithm.avoided)),
        f"0x{algorithm.avoided_plus:X}U",
        f"{{{{{', '.join(f'{{0x{low:X}U, 0x{high:X}U}}' for low, high in algorithm.avoided)}}}}}",
    ]
    every = f"0x{2**algorithm.width - 1:X}U"
    defaults = ["0", "false", "1", "false", "wirebond::OddTail::pad", "false", "0x0U", every]
    defaults += ["false", "0", "0x0U", "{{}}"]
    while rest and rest[-1] == defaults[len(rest) - 1]:
        rest.pop()
    return f"{{{', '.join([_check_kind(algorithm), str(algorithm.width), flags, numbers, *rest])}}}"


def update_call(algorithm: Algorithm, index: int) -> str:
    """Return the call that runs an algorithm's register over bytes."""
    by_parameters = f"format_from_host.algorithms[{index}]"
    if algorithm.kind != CheckKind.CRC:
        return f"wirebond::sum_update({by_parameters}, reg, bytes, size)"
    known = f"{algorithm.width}, 0x{algorithm.poly:X}U, {bool_literal(algorithm.refin)}"
    if algorithm.unit > 1:
        return f"wirebond::crc_words_update<{known}>({by_parameters}, reg, bytes, size)"
    return f"wirebond::crc_update<{known}>(reg, bytes, size)"
