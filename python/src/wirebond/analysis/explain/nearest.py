"""The search for the nearest explanation of refused bytes: which guesses are tried, and which are worth telling.

A guess is shown with the chance that one of its kind fits bytes that have nothing to do with it. Kinds are ranked by
prior / (prior + chance), where the prior says how often such a thing is what really happened. A change to the file is
judged by all the bytes together: what fits most frames comes first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from wirebond.analysis.explain.guesses import check, damage, format
from wirebond.analysis.explain.guesses.guess import (
    Case,
    Fitting,
    Guess,
    Guesses,
    Text,
    constants_as_found,
    evidence,
    look,
    reading,
    test,
)
from wirebond.analysis.explain.layout import (
    check_value,
    covered_bytes,
    found_check,
    same_check,
    shown_check,
    spans,
    with_check,
)
from wirebond.analysis.explain.report import Changes, FittingGuess
from wirebond.analysis.explain.solve import LEAST_SAMPLES
from wirebond.analysis.explain.stuffing import stuff
from wirebond.analysis.explain.together import ALONE, Stream, Together, chance_of
from wirebond.analysis.explain.verdict import Outcome, Question, Verdict
from wirebond.protocol.model import PartKind

_MOST_SEARCHES = 8  # refused stretches for which everything is tried
_QUICK_SEARCHES = LEAST_SAMPLES
MOST_GUESSES = 2
LEAST_PLAUSIBLE = 0.3
_MOST_JUDGED = 48  # guesses that are tried on all the bytes
_CHANCE = 0.05  # maximum chance of a guess that fits only some of many frames
# Bytes that one search may examine. Some 5 million take a second; a frame of 64 bytes needs a fifth of it.
BUDGET_BYTES = 5_000_000
_FIXED_COST_BYTES = 150  # of an examination, beside its bytes


@dataclass(frozen=True)
class _Family:
    """``beside``: the prior where the constants differ as well; without one it is not tried then."""

    prior: float
    guesses: Callable[[Case], Guesses]
    changes: Changes = Changes.FORMAT
    beside: float | None = None


_FAMILIES = (  # if two fit equally well, the first in this list is shown first
    _Family(0.30, format.other_protocols),
    _Family(0.25, format.unknown_message, Changes.NOTHING),
    _Family(0.25, format.unlisted_seed, Changes.NOTHING),
    _Family(0.30, format.other_sender, Changes.SENDER),
    _Family(0.30, check.as_peers_check, Changes.CHECK, beside=0.10),
    _Family(0.20, check.near_ranges, Changes.CHECK, beside=0.05),
    _Family(0.20, check.byte_orders, Changes.CHECK, beside=0.05),
    _Family(0.20, check.seeds, Changes.CHECK),
    _Family(0.20, format.lengths, beside=0.05),
    _Family(0.20, format.payload_sizes),
    _Family(0.20, format.other_byte_order),
    _Family(0.15, format.other_constants),
    _Family(0.15, check.algorithms_of_its_kind, Changes.CHECK, beside=0.05),
    _Family(0.02, check.algorithms_of_other_kinds, Changes.CHECK, beside=0.01),
    _Family(0.10, damage.terminal_driver, Changes.NOTHING),
    _Family(0.10, damage.lost_constants, Changes.NOTHING),
    _Family(0.05, check.all_ranges, Changes.CHECK, beside=0.02),
    _Family(0.05, damage.one_bit, Changes.NOTHING),
    _Family(0.03, damage.extra_byte, Changes.NOTHING),
    _Family(0.02, check.all_algorithms_and_ranges, Changes.CHECK),
    _Family(0.02, damage.lost_byte, Changes.NOTHING),
)
# Further differences, once the constants are taken as received.
_WITH_OTHER_CONSTANTS = tuple(replace(one, prior=one.beside) for one in _FAMILIES if one.beside is not None)


_SOLVED = _Family(0.05, lambda _: iter(()), Changes.CHECK)  # its guesses follow from several cases


@dataclass(frozen=True)
class Search:
    """The result of a search, best first. ``complete``: nothing was skipped for lack of time."""

    guesses: tuple[FittingGuess, ...]
    tried: int
    complete: bool


def search_all(cases: Sequence[Case], stream: Stream, *, quick: bool) -> list[Search]:
    """Try everything on the first refused candidates, and what fits several of them on the others.

    Some seconds at most for each, whatever the bytes; the same each time.

    :param stream: all the bytes.
    """
    most = _QUICK_SEARCHES if quick else _MOST_SEARCHES
    hunts = [_Hunt(case) for case in cases[:most]]
    for hunt in hunts:
        hunt.run_all(_FAMILIES, _WITH_OTHER_CONSTANTS)
    _solve(hunts, thorough=not quick)
    judged = _judge(hunts, stream)
    found = [hunt.result(judged) for hunt in hunts]
    shared = {advice for advice, together in judged.items() if together.fits > 1}
    families = {hit.family for hunt in hunts for hit in hunt.hits if hit.advice in shared}
    spent = 0
    for case in cases[most:]:
        hunt = _Hunt(case)
        if families and spent < BUDGET_BYTES:
            hunt.run_all(*([f for f in known if f in families] for known in (_FAMILIES, _WITH_OTHER_CONSTANTS)))
            hunt.hits = [hit for hit in hunt.hits if hit.advice in shared]
            spent += hunt.spent
        found.append(Search(hunt.result(judged).guesses, 0, False))
    return found


def search_sender(case: Case) -> Search:
    """Check whether the other end sends such a frame. For one whose checks hold and whose message is not known."""
    hunt = _Hunt(case)
    hunt.run(_Family(0.30, format.other_sender, Changes.SENDER), case)
    known = tuple(guess for guess in hunt.result().guesses if guess.reading)
    return Search(known, 1, True)


def search_unstuffed(case: Case) -> Search:
    """Return the guesses about stuffing, for which the block is all that was given."""
    hunt = _Hunt(case)
    hunt.run(_Family(0.30, damage.without_delimiters, Changes.NOTHING), case)
    return hunt.result()


def join(first: Search, second: Search) -> Search:
    guesses = (*first.guesses, *second.guesses)[:MOST_GUESSES]
    return Search(guesses, first.tried + second.tried, first.complete and second.complete)


def repaired(case: Case) -> str:
    """Return the reading of the frame with corrected check values, and those values. Empty if its checks are not the
    only fault."""
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
        value = check_value(part, covered_bytes(case.parts, index, data, places), case.verdict.seed)
        if not same_check(part, value, found_check(case.parts, index, data, places)):
            right.append(f"{part.name} {shown_check(part, value)}")
        data = with_check(case.parts, index, data, places, value)
    found = look(case.protocol, stuff(case.protocol.format, data), case.sender)
    if found is None or not found[0].is_frame:
        return ""
    name = reading(*found) or f"a frame with the unknown id 0x{found[0].id or 0:02X}"
    return f"with {' and '.join(right)} this is {name}"


@dataclass(frozen=True)
class _Hit:
    """A guess that fits. ``tried``: those of its family; a wrong one fits in 1 of ``values`` cases."""

    family: _Family
    guess: Guess
    what: str
    remedy: str
    reading: str
    tried: int
    values: int
    keeps_stream: bool  # it changes only bytes of this candidate

    @property
    def advice(self) -> str:
        """Equal for guesses that say the same of different frames."""
        return self.guess.key or self.remedy or self.what


def _solve(hunts: Sequence[_Hunt], *, thorough: bool) -> None:
    """Work out a check from all the candidates whose check fails, where nothing else fits them all."""
    failing = [hunt for hunt in hunts if hunt.case.failed_check is not None]
    counts = Counter(advice for hunt in failing for advice in {hit.advice for hit in hunt.hits if hit.family.changes})
    if len(failing) < LEAST_SAMPLES or max(counts.values(), default=0) == len(failing):
        return
    solved = check.solved([hunt.case for hunt in failing], thorough=thorough)
    if solved is not None:
        tried, values = 1 << solved.solution.freedom, 1 << solved.solution.evidence
        for index, guess in solved.guesses.items():
            failing[index].add(_SOLVED, guess, tried, values)


def _judge(hunts: Sequence[_Hunt], stream: Stream) -> dict[str, Together]:
    """Test on all bytes each change to the file that fits a frame; those that fit most candidates come first."""
    hits: dict[str, _Hit] = {}
    counts: Counter[str] = Counter()
    for hunt in hunts:
        own = {hit.advice: hit for hit in hunt.hits if hit.family.changes}
        counts.update(own.keys())
        hits = own | hits
    judged = {}
    for rank, (advice, count) in enumerate(counts.most_common()):
        alone = Together(count, len(hunts))
        hit = hits[advice]
        if rank >= _MOST_JUDGED or hit.keeps_stream:
            judged[advice] = alone
            continue
        judged[advice] = max(stream.by(hit.guess), alone, key=lambda one: (one.fits, one.of))
    return judged


@dataclass
class _Hunt:
    case: Case
    hits: list[_Hit] = field(default_factory=list)
    spent: int = 0
    tried: int = 0
    complete: bool = True

    def run_all(self, families: Iterable[_Family], with_other_constants: Iterable[_Family]) -> None:
        for family in families:
            self.run(family, self.case)
        changed = constants_as_found(self.case)
        if changed is not None and changed.verdict is not None and not changed.verdict.is_frame:
            for family in with_other_constants:
                self.run(family, changed)

    def run(self, family: _Family, case: Case) -> None:
        tried = 0
        found: list[tuple[Guess, Fitting]] = []
        for guess in family.guesses(case):
            if self.spent >= BUDGET_BYTES:
                self.complete = False
                break
            tried += 1
            if guess is None:
                self.spent += _FIXED_COST_BYTES // 2 + len(case.block) // 2
                continue
            self.spent += _FIXED_COST_BYTES + len(guess.block)
            fitting = test(guess)
            if fitting is not None:
                found.append((guess, fitting))
        self.tried += tried
        before = case.verdict if case.verdict is not None and not case.verdict.is_frame else None
        for guess, fitting in found:
            self._take(family, guess, case, fitting, tried, evidence(fitting[0], before))

    def add(self, family: _Family, guess: Guess, tried: int, values: int) -> None:
        """Add one that was found otherwise, if it fits. ``tried``, ``values``: as of a hit."""
        fitting = test(guess)
        if fitting is not None:
            self._take(family, guess, self.case, fitting, tried, values)

    def _take(self, family: _Family, guess: Guess, case: Case, fitting: Fitting, tried: int, values: int) -> None:
        verdict, data = fitting
        what, remedy = _sentence(case.preface, guess.what, verdict), _sentence("", guess.remedy, verdict)
        keeps = guess.block != case.block or (guess.protocol is case.protocol and guess.sender == case.sender)
        self.hits.append(_Hit(family, guess, what, remedy, reading(verdict, data), tried, values, keeps))

    def result(self, judged: Mapping[str, Together] | None = None) -> Search:
        """Return the result. ``judged``: how changes to the file fit all the bytes; without it, each is judged by this
        candidate alone."""
        told: list[tuple[float, FittingGuess]] = []
        missing = _what_is_missing(self.case)
        if missing is not None:
            told.append((0.5, missing))
        seen: set[str] = set()
        for family in dict.fromkeys(hit.family for hit in self.hits):
            own = [hit for hit in self.hits if hit.family == family]
            by_advice = {hit.advice: (judged or {}).get(hit.advice, ALONE) for hit in own if family.changes}
            most = max((one.fits for one in by_advice.values()), default=1)
            best = [hit for hit in own if by_advice.get(hit.advice, ALONE).fits == most]
            hit = next((hit for hit in best if hit.reading), best[0])
            together = by_advice.get(hit.advice, ALONE)
            chance = chance_of(hit.values, hit.tried, together)
            if hit.advice in seen or (together.of > 1 and chance > _CHANCE):
                continue  # a family may contain another's guesses; the more plausible one is run before
            seen.add(hit.advice)
            others = len({hit.advice for hit in best}) - 1
            guess = FittingGuess(
                hit.what,
                hit.remedy,
                hit.reading,
                hit.tried,
                chance,
                others,
                together.fits,
                together.of,
                family.changes,
            )
            told.append((family.prior / (family.prior + chance), guess))
        return Search(_worth_telling(told), self.tried, self.complete)


def _worth_telling(found: list[tuple[float, FittingGuess]]) -> tuple[FittingGuess, ...]:
    """Select guesses to report. ``found``: in the order of the families, which decides between equally likely ones."""
    ranked = sorted(found, key=lambda entry: (-entry[1].fits, -round(entry[0], 2)))
    plausible = [guess for rank, guess in ranked if rank >= LEAST_PLAUSIBLE]
    # A check that holds as the file has it is no reason to change it.
    surest = min((g.chance for g in plausible if g.chance is not None and g.changes != Changes.CHECK), default=1.0)
    told = [g for g in plausible if g.changes != Changes.CHECK or g.chance is None or g.chance < surest]
    if told and told[0].fits > 1:  # an explanation of many frames is no accident of one of them
        told = [g for g in told if g.fits > 1 or g.chance is None]
    if any(guess.reading for guess in told):  # a guess that gives the bytes a meaning is nearer than one that does not
        told = [guess for guess in told if guess.reading or guess.chance is None]
    return tuple(told[:MOST_GUESSES])


def _what_is_missing(case: Case) -> FittingGuess | None:
    """Report an incomplete frame: not a guess, it is good as far as it goes."""
    verdict = case.verdict
    if verdict is None or verdict.outcome != Outcome.INCOMPLETE:
        return None
    missing = verdict.extent - len(case.data)
    least = "" if any(rule.question == Question.LENGTH for rule in verdict.rules) else "at least "
    what = f"The bytes end too soon: {least}{missing} more byte{'s' * (missing != 1)} must come."
    if verdict.message is not None:
        what = what[:-1] + f" before this is a frame of {verdict.message.name}."
    return FittingGuess(what, "", "", 1, None)


def _sentence(preface: str, text: Text, verdict: Verdict) -> str:
    full = preface + (text if isinstance(text, str) else text(verdict))
    return full[:1].upper() + full[1:] + "." if full else ""
