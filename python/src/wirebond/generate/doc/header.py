"""Describes the frame's own named fields: a table for people who write the other end."""

from __future__ import annotations

from wirebond.generate.doc.messages import names_of, value_of
from wirebond.generate.doc.table import table
from wirebond.protocol.decimals import decimal_text
from wirebond.protocol.model import Address, Field, HeaderDefault, HeaderField, Protocol
from wirebond.protocol.model.forms import header_fields
from wirebond.protocol.spelling import field_type, sequence_text

_ADDRESSES = {
    Address.MCU: "the MCU's address: in frames to it and in frames from it",
    Address.RECEIVER: "the address of the end that the frame is for",
    Address.SENDER: "the address of the end that sends the frame",
}


def header_chapter(protocol: Protocol) -> list[str]:
    """Write the chapter on header fields; empty if frames have none."""
    fields = header_fields(protocol.format.parts)
    if not fields:
        return []
    rows = [
        (
            field.name,
            field_type(field.value),
            field.value.unit,
            value_of(field.value),
            _range(field.value),
            _default(field),
            _meaning(field),
        )
        for field in fields
    ]
    lines = [
        "## Header fields",
        "",
        *table(("field", "type", "unit", "value", "range", "sent by default", "meaning"), rows),
    ]
    lines.append("")
    for field in fields:
        lines += names_of(field.value)
    return lines + _addresses(fields)


def _range(field: Field) -> str:
    if field.minimum is None or field.maximum is None:
        return ""
    return f"{decimal_text(field.minimum, 10)} to {decimal_text(field.maximum, 10)}"


def _default(field: HeaderField) -> str:
    host, mcu = _shown(field.host_default), _shown(field.mcu_default)
    return host if host == mcu else f"{host} by the host, {mcu} by the MCU"


def _shown(value: HeaderDefault) -> str:
    return decimal_text(value, 10) if isinstance(value, float) else str(value)


def _meaning(field: HeaderField) -> str:
    told = [field.value.description.rstrip(".")] if field.value.description else []
    if field.is_sequence:
        told.append(sequence_text(field))
    if field.address is not None:
        told.append(_ADDRESSES[field.address])
    return "; ".join(told)


def _addresses(fields: tuple[HeaderField, ...]) -> list[str]:
    listed = [f for f in fields if f.address in (Address.MCU, Address.RECEIVER)]
    if not listed:
        return []
    field = listed[0]
    lines = [
        f"A receiver takes frames whose `{field.name}` is its own address. An intact frame with another address is not "
        "for it: it does not act on it, does not answer, and does not look through its bytes for another frame."
    ]
    if field.broadcast:
        values = " or ".join(map(_shown, field.broadcast))
        lines.append(f"`{field.name}` {values} is a broadcast: every receiver acts on it, and none answers.")
    return [*lines, ""]
