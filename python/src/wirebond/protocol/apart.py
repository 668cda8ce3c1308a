"""Finds out whether a receiver can distinguish the forms of a frame, by the bytes before the payload and by its
size."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, product

from wirebond.protocol.model import End, Part, PayloadRule
from wirebond.protocol.model.forms import Intervals, meet, some_value
from wirebond.protocol.plan import Form
from wirebond.protocol.planning import forms


def alike(parts: tuple[Part, ...], sender: End) -> tuple[Form, Form] | None:
    """Find two forms of a sender that some bytes can both be."""
    pairs = combinations(forms(parts, sender), 2)
    return next(((one, other) for one, other in pairs if not told_apart(one, other)), None)


def ends_look_alike(parts: tuple[Part, ...]) -> bool:
    """Do the ends' frames differ, and can the same bytes be a frame of either?"""
    mine, theirs = forms(parts, End.HOST), forms(parts, End.MCU)
    if mine == theirs:
        return False
    return any(one != other and not told_apart(one, other) for one in mine for other in theirs)


def told_apart(one: Form, other: Form) -> bool:
    """Check that no bytes can be a frame of both forms."""
    for here, there in product(one.constants[: one.prefix_constants], other.constants[: other.prefix_constants]):
        if here.at == there.at and (here.value ^ there.value) & here.mask & there.mask:
            return True
    for mine in one.choices:
        for theirs in other.choices:
            first, second = mine.number, theirs.number
            if first is None or second is None or replace(first, mask=0) != replace(second, mask=0):
                continue
            if some_value((mine.choice, theirs.choice), 64) is None:
                return True
    return _sizes_differ(one, other)


def _sizes_differ(one: Form, other: Form) -> bool:
    """Check whether the payload's size distinguishes two forms, as far as a receiver knows it before the form."""
    if one.payload == PayloadRule.BY_ID:  # a message has one size, and each form reads the same id
        return one.id == other.id and not meet(_sizes(one), _sizes(other))
    if one.payload != PayloadRule.BY_LENGTH or one.trims_zeros or one.length is None or one.length != other.length:
        return False
    return not meet(_lengths(one), _lengths(other))


def _sizes(form: Form) -> Intervals:
    sizes: Intervals = ((0, 0xFFFF),)
    for held in form.choices:
        if held.number is None:
            sizes = meet(sizes, held.choice.allowed)
    return sizes


def _lengths(form: Form) -> Intervals:
    """Return the numbers that the length of such a frame can be."""
    unit, bias = form.length_unit, form.length_bias
    found = [(max(0, -(-(low - bias) // unit)), (high - bias) // unit) for low, high in _sizes(form)]
    return tuple((low, high) for low, high in found if low <= high)
