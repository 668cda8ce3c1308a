"""The header fields of frames as C: their struct, and what the functions and handlers are called that take it."""

from __future__ import annotations

from dataclasses import dataclass

from wirebond.generate.code.c_names import Names
from wirebond.generate.code.c_struct import Declarations, Declarer
from wirebond.generate.code.cpp_header import address_type, address_view, ends_differ, header_shape
from wirebond.generate.code.names import namespace
from wirebond.protocol.model import End, Protocol
from wirebond.protocol.names import code_name


@dataclass(frozen=True)
class HeaderView:
    """The struct ``<protocol>_header_t``."""

    type_name: str
    cpp: str
    declared: Declarations
    inits: tuple[tuple[str, str], ...]  # function, the C++ expression of the defaults


def header_view(protocol: Protocol, names: Names, declarer: Declarer) -> HeaderView | None:
    """Return the view of the header; None if frames have no header field."""
    shape = header_shape(protocol)
    if shape is None:
        return None
    cpp = f"{namespace(protocol.name)}::{shape.path}"
    if ends_differ(protocol):
        inits = tuple(
            (names.claim("init", "header", f"from_{end.value}"), f"{cpp}(wirebond::End::{end.value})")
            for end in (End.HOST, End.MCU)
        )
    else:
        inits = ((names.claim("init", "header"), f"{cpp}{{}}"),)
    type_name = declarer.struct(shape, "header")
    return HeaderView(type_name, cpp, declarer.take(), inits)


def c_address_type(protocol: Protocol) -> str:
    """Return the type of an address in C; empty where the header has none."""
    return address_type(protocol).removeprefix("std::")


def names_receiver(protocol: Protocol, sender: End) -> bool:
    """Do frames of ``sender`` say for whom they are?"""
    view = address_view(protocol, sender)
    return view is not None and view.receiver is not None


def names_asked(protocol: Protocol, sender: End) -> bool:
    """Do frames of ``sender`` say which of several MCUs answers?"""
    view = address_view(protocol, sender)
    return view is not None and view.asked is not None


def handlers_with_header(prefix: str, messages: list[str]) -> dict[str, str]:
    """Return the member of a table of functions that takes a message and its header: ``on_velocity_with_header``. None
    of them is another message's member."""
    taken = {f"{prefix}_{code_name(name)}" for name in messages}
    found = {}
    for name in messages:
        base = member = f"{prefix}_{code_name(name)}_with_header"
        number = 1
        while member in taken:
            number += 1
            member = f"{base}_{number}"
        taken.add(member)
        found[name] = member
    return found
