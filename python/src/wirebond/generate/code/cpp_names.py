"""The C++ names of a file's messages: their structs, their ids."""

from __future__ import annotations

from wirebond.generate.code import names
from wirebond.generate.code.cpp_field import hex_literal
from wirebond.generate.code.cpp_header import generated_types
from wirebond.generate.code.cpp_shape import Shape, named_shapes, shape_of
from wirebond.protocol.model import BitRole, End, PartKind, Protocol
from wirebond.protocol.planning import plan_for


def shapes(protocol: Protocol) -> tuple[dict[str, Shape], dict[str, Shape]]:
    """Return the structs of the file's types and those of the messages, each by the file's name."""
    scope = names.Scope(generated_types(protocol))
    named = named_shapes(protocol, scope)
    structs = {m.name: scope.claim(names.type_name(m.name), "Message") for m in protocol.messages}
    return named, {m.name: shape_of(structs[m.name], m.layout, named) for m in protocol.messages}


def message_shapes(protocol: Protocol) -> dict[str, Shape]:
    """Return the struct of each message and its inner types, by the message's name."""
    return shapes(protocol)[1]


def struct_names(protocol: Protocol) -> dict[str, str]:
    """Return the struct of each message, by the message's name."""
    return {name: shape.path for name, shape in message_shapes(protocol).items()}


def id_literal(protocol: Protocol, value: int) -> str:
    sizes = [
        part.size
        for part in protocol.format.parts
        if part.kind == PartKind.ID or any(run.role == BitRole.ID for run in part.bits)
    ]
    return hex_literal(value, max(sizes, default=1))


def no_id_literal(protocol: Protocol) -> str:
    """Return the literal for the id of a message without one."""
    no_id = plan_for(protocol, End.HOST).no_id
    return hex_literal(no_id, 4) if no_id else id_literal(protocol, 0)
