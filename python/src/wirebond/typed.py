"""The base of generated Python modules: checks that they belong to the file, and converts engine values to typed
ones."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Mapping
from enum import IntEnum, IntFlag
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

from wirebond.arguments import shown
from wirebond.codec import Codec, Message, load
from wirebond.errors import ProtocolMismatchError, UsageError
from wirebond.protocol.names import code_name

_Enum = TypeVar("_Enum", bound=IntEnum)
_Flags = TypeVar("_Flags", bound=IntFlag)
_Typed = TypeVar("_Typed")


_Reply_co = TypeVar("_Reply_co", covariant=True)


class TypedMessage(Protocol):
    """A message of a generated module."""

    NAME: ClassVar[str]

    def values(self) -> dict[str, Any]:
        """Return its fields as ``Codec.encode`` takes them."""


class TypedRequest(TypedMessage, Protocol[_Reply_co]):
    """A message of a generated module that has a reply."""

    def reply_of(self, message: Message) -> _Reply_co:
        """Return the reply to it, with its type."""


def load_matching(module: str, file: str | os.PathLike[str], expected: int) -> Codec:
    """Return the protocol of ``file``, which is at this place as seen from the ``module``'s folder.

    :raises ProtocolFileError: the file is not there, or wrong.
    :raises ProtocolMismatchError: its bytes have another meaning than when the module was generated.
    """
    path = Path(os.path.normpath(Path(module).parent / file))
    codec = load(path)
    if codec.hash != expected:
        raise ProtocolMismatchError(
            f"{module} was generated from another {path}: its protocol hash was {expected:016x} and is "
            f"{codec.hash:016x} now; run `wirebond gen {path} --lang python --out {Path(module).parent}`"
        )
    return codec


def name_and_values(
    message: str | TypedMessage, values: Mapping[str, Any] | None, fields: dict[str, Any]
) -> tuple[str, dict[str, Any]]:
    """Return a message that a caller gave by its name and values, or as one object.

    :raises UsageError: neither a name nor such an object; or an object and values as well.
    """
    if isinstance(message, str):
        return message, {**values, **fields} if values else fields
    if not isinstance(getattr(message, "NAME", None), str) or isinstance(message, type):
        raise UsageError(
            f"the message is {shown(message)}; expected a message's name, or an object of a generated module's class"
        )
    if values is not None or fields:
        raise UsageError(f"{type(message).__name__} has its values already; change them with dataclasses.replace")
    return message.NAME, message.values()


def message_class(kind: type) -> Any:
    """Return the class of a generated module that this one is or comes from.

    :raises UsageError: there is none.
    """
    for base in kind.__mro__ if isinstance(kind, type) else ():
        if isinstance(vars(base).get("NAME"), str):
            return base
    given = kind.__name__ if isinstance(kind, type) else shown(kind)
    raise UsageError(f"{given} is not a message of a generated module; give a message's name or its class")


def maker_of(kind: type) -> Callable[[Message], Any]:
    """Return a function that makes objects of this class from received messages of its name."""
    name, make = message_class(kind).NAME, kind.from_values  # type: ignore[attr-defined]
    return lambda message: decoded({name: make}, message)


def received(kind: type[_Typed], message: Message) -> _Typed:
    """Return a received message as an object of this class, of a generated module."""
    made: _Typed = maker_of(kind)(message)
    return made


def from_message_of(kind: type) -> Callable[[Message], Any]:
    """Return ``from_message`` of the generated module that has this class; if none has, the message stays as it is."""
    module = sys.modules.get(message_class(kind).__module__)
    return getattr(module, "from_message", lambda message: message)


# ---- values of the engine ---------------------------------------------------------------------------------------


def decoded(kinds: Mapping[str, Callable[[Mapping[str, Any]], _Typed]], message: Message) -> _Typed | None:
    """Return a received message by the maker of its name; None for a frame that no message of the protocol has.

    :raises ProtocolMismatchError: the message was decoded with another protocol file than the module's.
    """
    make = kinds.get(message.name)
    if make is None:
        return None
    fields = message.fields
    try:
        made = make(fields)
        if hasattr(type(made), "header"):
            object.__setattr__(made, "header", message.header)  # the received header; not a value to give
        if message.stamp is not None and hasattr(type(made), "stamp_error"):
            object.__setattr__(made, "stamp", message.stamp)
            object.__setattr__(made, "stamp_error", message.stamp_error)
        return made
    except KeyError as error:
        raise ProtocolMismatchError(
            f"{message.name} has no {error.args[0]!r}; it has {', '.join(fields) or 'no field'}: it was decoded with "
            "another protocol file than this module was generated from"
        ) from None


def enum_of(kind: type[_Enum], value: str | int) -> _Enum | int:
    """Return the member of this name; a number that has none stays a number."""
    return kind[code_name(value).upper()] if isinstance(value, str) else value


def flags_of(kind: type[_Flags], value: Iterable[str | int]) -> _Flags:
    """Return names, and numbers for bits without a name."""
    bits = kind(0)
    for one in value:
        bits |= kind[code_name(one).upper()] if isinstance(one, str) else kind(one)
    return bits
