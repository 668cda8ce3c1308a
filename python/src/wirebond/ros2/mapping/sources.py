"""Values of a mapping: where each comes from, and whether it fits where it goes. What is wrong is a sentence."""

from __future__ import annotations

import math
from typing import Any

from wirebond.protocol.model import Message
from wirebond.protocol.problems import Place, Problems, suggestion
from wirebond.ros2.mapping.filler import word_of
from wirebond.ros2.mapping.grammar import Source
from wirebond.ros2.mapping.paths import Getter, Leaf, PathError, What, misfit, ros_getter, ros_place, wire_leaf
from wirebond.ros2.types import RosType


class Sources:
    """Looks sources up. What is wrong is added to ``problems``."""

    def __init__(self, problems: Problems) -> None:
        self.problems = problems

    def of_message(
        self, source: Source, message: Message, target: Leaf, constants: dict[str, Any], place: Place
    ) -> Getter | None:
        """Return how to read the source from the message; None for a constant."""
        if not source.path:
            self._constant(source.constant, target, place)
            return None
        try:
            given, getter = wire_leaf(message, source.path)
        except PathError as error:
            self.problems.add(place, str(error))
            return None
        if source.choose:
            self._choices(source, given, target, constants, place)
            return getter
        self._compare(source, given, target, place)
        return getter

    def of_topic(self, source: Source, type_: RosType, target: Leaf, place: Place) -> Getter | None:
        """Return how to read the source from a message of this type, or None if that is not possible."""
        if not source.path:
            self._constant(source.constant, target, place)
            return lambda _: source.constant
        try:
            found = ros_place(type_, source.path)
        except PathError as error:
            self.problems.add(place, str(error))
            return None
        getter = ros_getter(found.steps)
        if source.choose:
            if found.leaf.what != What.BOOL or found.leaf.is_list:
                self.problems.add(
                    place, f"{source.path} is {found.leaf.described}; `values` needs one that is true or false here"
                )
                return None
            self._choices(source, found.leaf, target, {name: name for name in target.choices}, place)
            return lambda values: source.choose.get(word_of(getter(values)))
        self._compare(source, found.leaf, target, place)
        if source.scale != 1.0 or source.offset != 0.0:
            return lambda values: getter(values) * source.scale + source.offset
        return getter

    def _compare(self, source: Source, given: Leaf, target: Leaf, place: Place) -> None:
        is_linear = source.scale != 1.0 or source.offset != 0.0
        if is_linear and (given.what not in (What.NUMBER, What.INTEGER) or given.is_list):
            self.problems.add(place, f"{source.path} is {given.described}; `scale` and `offset` need a number")
            return
        shown = Leaf(given.path, What.NUMBER) if is_linear else given
        fault = misfit(target, shown)
        if fault:
            self.problems.add(place, f"{fault}; map another field, or give a number for each value with `values`")

    def _choices(self, source: Source, given: Leaf, target: Leaf, constants: dict[str, Any], place: Place) -> None:
        possible = ("true", "false") if given.what == What.BOOL else given.choices
        if not possible or given.is_list:
            self.problems.add(place, f"{source.path} is {given.described}; `values` needs a flag, a bool or an enum")
            return
        if missing := [word for word in possible if word not in source.choose]:
            self.problems.add(place, f"`values` says nothing of {', '.join(missing)}; write a value for each")
        for word, value in source.choose.items():
            if word not in possible:
                self.problems.add(place, f"{source.path} is never `{word}`; {suggestion(word, possible)}")
            if isinstance(value, str) and target.what != What.TEXT and value not in constants:
                names = suggestion(value, list(constants)) if constants else "its type has none: write a number"
                self.problems.add(place, f"there is no constant `{value}` for {target.path}; {names}")
            else:
                self._constant(constants.get(value, value) if isinstance(value, str) else value, target, place)

    def _constant(self, value: Any, target: Leaf, place: Place) -> None:
        fits = {
            What.BOOL: isinstance(value, bool),
            What.NUMBER: isinstance(value, int | float) and not isinstance(value, bool),
            What.INTEGER: isinstance(value, int) and not isinstance(value, bool),
            What.FLAGS: isinstance(value, int) and not isinstance(value, bool),
            What.TEXT: isinstance(value, str),
            What.NAME: isinstance(value, str) and value in target.choices,
        }.get(target.what, False)
        if target.is_list or not fits:
            self.problems.add(place, f"{value!r:.40} is not possible for {target.path}; write {target.described}")
        elif isinstance(value, int | float) and not math.isnan(value) and not target.minimum <= value <= target.maximum:
            low, high = f"{target.minimum:.0f}", f"{target.maximum:.0f}"
            self.problems.add(place, f"{value!r:.40} is out of the range of {target.path}; write {low} to {high}")
