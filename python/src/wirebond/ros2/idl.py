"""Types of ROS 2 as the Python package of Cyclone DDS declares them, so that other programs find the same type."""

from __future__ import annotations

from functools import cache
from typing import Any

from cyclonedds.idl import IdlStruct, make_idl_struct, types

from wirebond.ros2.types import Kind, RosField, RosType

_BASES: dict[str, Any] = {
    "bool": bool, "byte": types.uint8, "char": types.uint8, "int8": types.int8, "uint8": types.uint8,
    "int16": types.int16, "uint16": types.uint16, "int32": types.int32, "uint32": types.uint32, "int64": types.int64,
    "uint64": types.uint64, "float32": types.float32, "float64": types.float64, "string": str,
}  # fmt: skip


_Types: Any = types  # its arrays and sequences are indexed, which their types do not say


@cache
def idl_type(type_: RosType) -> type[IdlStruct]:
    """Return the declaration of this type. Its samples are never made: the bytes come from `cdr`."""
    fields = {f"{field.name}": _annotation(field) for field in type_.fields}
    return make_idl_struct(type_.name.replace("/", "_"), type_.dds_name.replace("::", "."), fields)


def _annotation(field: RosField) -> Any:
    element: Any = idl_type(field.of) if field.of is not None else _BASES[field.base]
    if field.base == "string" and field.limit and field.kind == Kind.ONE:
        return _Types.bounded_str[field.limit]
    if field.kind == Kind.ARRAY:
        return _Types.array[element, field.count]
    if field.kind == Kind.SEQUENCE:
        return _Types.sequence[element, field.limit] if field.limit else _Types.sequence[element]
    return element
