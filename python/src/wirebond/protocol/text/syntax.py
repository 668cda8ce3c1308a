"""Converts a file's tree of values to the grammar's models, with every error at its place in the file."""

from __future__ import annotations

from typing import Any, TypeVar

from pydantic import ConfigDict, TypeAdapter, ValidationError

from wirebond.protocol.problems import Place, Problems
from wirebond.protocol.text.envelope_grammar import Part
from wirebond.protocol.text.grammar import File
from wirebond.protocol.text.wording import Syntax
from wirebond.protocol.text.yaml_tree import Mapping, Node, Sequence, plain

_Model = TypeVar("_Model", bound=Syntax)
_PART: TypeAdapter[Syntax] = TypeAdapter(Part, config=ConfigDict(defer_build=True))


def validate_syntax(root: Node, problems: Problems, grammar: type[Syntax] = File) -> None:
    """Report everything in the tree that the grammar does not allow."""
    try:
        grammar.model_validate(plain(root))
    except ValidationError as error:
        for line in error.errors(include_url=False):
            loc = line["loc"]
            at_key = line["type"] == "wrong_key" or (bool(loc) and loc[-1] == "[key]")
            problems.add(_locate(root, loc, at_key), line["ctx"]["sentence"])


def readable(model: type[_Model], node: Node) -> _Model | None:
    """Return this piece of the file by itself, or None if its syntax is wrong (`validate_syntax` reports it)."""
    try:
        return model.model_validate(plain(node))
    except ValidationError:
        return None


def readable_part(node: Node) -> Syntax | None:
    """Read a part of a frame, as `readable`."""
    try:
        return _PART.validate_python(plain(node))
    except ValidationError:
        return None


def _locate(root: Node, loc: tuple[Any, ...], at_key: bool) -> Place:
    """Follow an error's location. What the tree has not (a missing key, a union's tag) is passed over."""
    node, owner = root, root.place
    place = root.place
    for step in loc:
        if isinstance(node, Mapping) and step in node.entries:
            entry = node.entries[step]
            node, owner, place = entry.value, entry.key_place, entry.value.place
        elif isinstance(node, Sequence) and isinstance(step, int) and step < len(node.items):
            node = node.items[step]
            owner = place = node.place
    return owner if at_key else place
