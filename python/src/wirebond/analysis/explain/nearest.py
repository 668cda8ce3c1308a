"""The search for the nearest explanation of refused bytes: which guesses are tried, and which are worth telling.

A guess is shown with the chance that one of its kind fits bytes that have nothing to do with it. Kinds are ranked by
prior / (prior + chance), where the prior says how often such a thing is what really happened.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from wirebond.analysis.explain.guesses import check, damage, format
from wirebond.analysis.explain.guesses.guess import (
    Case,
    Guess,
    Guesses,
    Text,
    constants_as_found,
    evidence,
    look,
    reading,
    test,
)
from wirebond.analysis.explain.layout import check_value, same_check, shown_check, spans
from wirebond.analysis.explain.report import FittingGuess
from wirebond.analysis.explain.stuffing import stuff
from wirebond.analysis.explain.verdict import Outcome, Question, Verdict
from wirebond.protocol.model import PartKind

MOST_GUESSES = 2
LEAST_PLAUSIBLE = 0.3
# Bytes that one search may examine. Some 5 million take a second; a frame of 64 bytes needs a fifth of it.
BUDGET_BYTES = 5_000_000
_FIXED_COST_BYTES = 150  # of an examination, beside its bytes


@dataclass(frozen=True)
class _Family:
    prior: float
    guesses: Callable[[Case], Guesses]
    changes_check: bool = False  # its guesses would have the file compute its check in another way


_FAMILIES = (
    _Family(0.25, format.unknown_message),
    _Family(0.25, format.unlisted_seed),
    _Family(0.30, format.other_sender),
    _Family(0.30, format.other_protocols),
    _Family(0.30, check.as_peers_check, changes_check=True),
    _Family(0.20, check.near_ranges, changes_check=True),
    _Family(0.20, check.byte_orders, changes_check=True),
    _Family(0.20, check.seeds, changes_check=True),
    _Family(0.20, format.lengths),
    _Family(0.20, format.other_byte_order),
    _Family(0.15, format.other_constants),
    _Family(0.15, check.algorithms_of_its_kind, changes_check=True),
    _Family(0.02, check.algorithms_of_other_kinds, changes_check=True),
    _Family(0.10, damage.terminal_driver),
    _Family(0.10, damage.lost_constants),
    _Family(0.05, check.all_ranges, changes_check=True),
    _Family(0.05, damage.one_bit),
    _Family(0.03, damage.extra_byte),
    _Family(0.02, check.all_algorithms_and_ranges, changes_check=True),
    _Family(0.02, damage.lost_byte),
)
# Once the constants are taken as they stand, what else may differ.
_WITH_OTHER_CONSTANTS = (
    _Family(0.10, check.as_peers_check, changes_check=True),
    _Family(0.05, check.near_ranges, changes_check=True),
    _Family(0.05, check.byte_orders, changes_check=True),
    _Family(0.05, check.algorithms_of_its_kind, changes_check=True),
    _Family(0.01, check.algorithms_of_other_kinds, changes_check=True),
    _Family(0.05, format.lengths),
    _Family(0.02, check.all_ranges, changes_check=True),
)


@dataclass(frozen=True)
class Search:
    """What was found, best first. ``complete``: nothing was left out for want of time."""

    guesses: tuple[FittingGuess, ...]
    tried: int
    complete: bool


def search(case: Case) -> Search:
    """Try everything on one refused candidate. Some seconds at most, whatever the bytes; the same each time."""
    hunt = _Hunt()
    hunt.add_what_is_missing(case)
    for family in _FAMILIES:
        hunt.run(family, case)
    changed = constants_as_found(case)
    if changed is not None and changed.verdict is not None and not changed.verdict.is_frame:
        for family in _WITH_OTHER_CONSTANTS:
            hunt.run(family, changed)
    return hunt.result()


def search_sender(case: Case) -> Search:
    """For a frame whose checks hold and whose message is not known: does the other end send such a one?"""
    hunt = _Hunt()
    hunt.run(_Family(0.30, format.other_sender), case)
    known = tuple(guess for guess in hunt.result().guesses if guess.reading)
    return Search(known, 1, True)


def search_unstuffed(case: Case) -> Search:
    """The guesses about stuffing, for which the block is all that was given."""
    hunt = _Hunt()
    hunt.run(_Family(0.30, damage.without_delimiters), case)
    return hunt.result()


def join(first: Search, second: Search) -> Search:
    guesses = (*first.guesses, *second.guesses)[:MOST_GUESSES]
    return Search(guesses, first.tried + second.tried, first.complete and second.complete)


def repaired(case: Case) -> str:
    """What the frame would say if only its check values were wrong, and those values; empty where that is not so."""
    if case.failed_check is None or case.verdict is None or case.verdict.payload is None:
        return ""
    data = case.data
    places = spans(case.parts, case.verdict.payload_size or 0)
    if places[-1][1] > len(data):
        return ""
    right = []
    for index, part in enumerate(case.parts):
        if part.kind != PartKind.CHECK:
            continue
        start, stop = places[index]
        value = check_value(part, data[places[part.first][0] : places[part.last][1]], case.verdict.seed)
        if not same_check(part, value, data[start:stop]):
            right.append(f"{part.name} {shown_check(part, value)}")
        data = data[:start] + value + data[stop:]
    found = look(case.protocol, stuff(case.protocol.format, data), case.sender)
    if found is None or not found[0].is_frame:
        return ""
    name = reading(*found) or f"a frame with the unknown id 0x{found[0].id or 0:02X}"
    return f"with {' and '.join(right)} this is {name}"


class _Hunt:
    def __init__(self) -> None:
        self._ranked: list[tuple[float, FittingGuess]] = []
        self._changing_check: list[FittingGuess] = []
        self._seen: set[str] = set()
        self._spent = 0
        self._tried = 0
        self._complete = True

    def result(self) -> Search:
        ranked = sorted(self._ranked, key=lambda entry: -entry[0])
        told = [guess for rank, guess in ranked if rank >= LEAST_PLAUSIBLE]
        # A check that holds as the file has it is no reason to change it.
        surest = min((g.chance for g in told if g.chance is not None and g not in self._changing_check), default=1.0)
        told = [g for g in told if g not in self._changing_check or g.chance is None or g.chance < surest]
        if any(guess.reading for guess in told):  # what gives the bytes a meaning is nearer than what gives none
            told = [guess for guess in told if guess.reading or guess.chance is None]
        return Search(tuple(told[:MOST_GUESSES]), self._tried, self._complete)

    def run(self, family: _Family, case: Case) -> None:
        tried = 0
        hits: list[tuple[Guess, Verdict, bytes]] = []
        for guess in family.guesses(case):
            if self._spent >= BUDGET_BYTES:
                self._complete = False
                break
            tried += 1
            if guess is None:
                self._spent += _FIXED_COST_BYTES // 2 + len(case.block) // 2
                continue
            self._spent += _FIXED_COST_BYTES + len(guess.block)
            found = test(guess)
            if found is not None:
                hits.append((guess, *found))
        self._tried += tried
        if hits:
            self._add(family, case, tried, hits)

    def _add(self, family: _Family, case: Case, tried: int, hits: list[tuple[Guess, Verdict, bytes]]) -> None:
        guess, verdict, data = hits[0]
        before = case.verdict if case.verdict is not None and not case.verdict.is_frame else None
        values = evidence(verdict, before)
        chance = 1 - (1 - 1 / values) ** tried
        fitting = FittingGuess(
            what=_sentence(case.preface, guess.what, verdict),
            remedy=_sentence("", guess.remedy, verdict),
            reading=reading(verdict, data),
            tried=tried,
            chance=chance,
            others=len(hits) - 1,
        )
        advice = fitting.remedy or fitting.what
        if advice not in self._seen:  # a family may contain another's guesses; the more plausible one is run before
            self._seen.add(advice)
            self._ranked.append((family.prior / (family.prior + chance), fitting))
            if family.changes_check:
                self._changing_check.append(fitting)

    def add_what_is_missing(self, case: Case) -> None:
        """Not a guess: the frame is good as far as it goes."""
        verdict = case.verdict
        if verdict is None or verdict.outcome != Outcome.INCOMPLETE:
            return
        missing = verdict.extent - len(case.data)
        least = "" if any(rule.question == Question.LENGTH for rule in verdict.rules) else "at least "
        what = f"The bytes end too soon: {least}{missing} more byte{'s' * (missing != 1)} must come."
        if verdict.message is not None:
            what = what[:-1] + f" before this is a frame of {verdict.message.name}."
        self._ranked.append((0.5, FittingGuess(what, "", "", 1, None)))


def _sentence(preface: str, text: Text, verdict: Verdict) -> str:
    full = preface + (text if isinstance(text, str) else text(verdict))
    return full[:1].upper() + full[1:] + "." if full else ""
