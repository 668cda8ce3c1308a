"""Chinese sentences beside the English ones that the code makes.

Pairs of sentences are in the files of ``translations/zh``. A pair is two lines, and an empty one follows it. ``{name}``
stands for the words that differ from one sentence to the next, which are copied; ``{~name}`` for words that may have a
pair of their own, and are translated if they have; ``{#name}`` for a whole number, and nothing else. Nothing is
guessed: a sentence that has no pair stays English.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

LONGEST = 2000  # characters of a sentence; a longer one is a text of a person or of a file
TWIN = "_zh"  # after the key of a sentence
#: The tables of the sentences that the page shows.
SENTENCES = ("link", "server", "values", "recordings", "system")
_KEPT = 512
_DEEPEST = 12  # sentences within one another
_PLACE = re.compile(r"\{([~#]?\w+)\}")
_FOLDER = Path(__file__).parent / "translations" / "zh"


@dataclass(frozen=True)
class Pair:
    """An English sentence, cut at its places, and the Chinese one."""

    literals: tuple[str, ...]  # one more than names
    names: tuple[str, ...]
    chinese: str

    def values(self, text: str) -> dict[str, str] | None:
        """Return the texts at the placeholders; None: it is another sentence. Linear in the size of the text."""
        first, last = self.literals[0], self.literals[-1]
        if not self.names:
            return {} if text == first else None
        if not text.startswith(first) or not text.endswith(last) or len(text) < len(first) + len(last):
            return None
        at, end = len(first), len(text) - len(last)
        found = {}
        for name, behind in zip(self.names[:-1], self.literals[1:-1], strict=True):
            stop = text.find(behind, at, end)
            if stop < 0:
                return None
            found[name] = text[at:stop]
            at = stop + len(behind)
        found[self.names[-1]] = text[at:end]
        if any(name.startswith("#") and not (value.isascii() and value.isdigit()) for name, value in found.items()):
            return None
        return found


def read_pairs(text: str) -> list[Pair]:
    """Read the pairs of a table.

    :raises ValueError: it is not a table, or a pair is incomplete.
    """
    pairs = []
    for number, block in enumerate(re.split(r"\n\s*\n", text.strip()), 1):
        lines = [line for line in block.splitlines() if not line.startswith("#")]
        if not lines:
            continue
        if len(lines) != 2:
            raise ValueError(f"pair {number} has {len(lines)} lines; expected the English and the Chinese one: {lines}")
        english, chinese = lines
        names = tuple(_PLACE.findall(english))
        literals = tuple(_PLACE.split(english)[::2])
        if set(_PLACE.findall(chinese)) - set(names) or len(set(names)) != len(names) or "" in literals[1:-1]:
            raise ValueError(f"the places of this pair do not fit: {english}")
        pairs.append(Pair(literals, names, chinese))
    return pairs


def text_of(*names: str) -> str:
    """Return the text of tables.

    :param names: of the files in the folder ``translations/zh``, without their ending.
    """
    return "\n\n".join((_FOLDER / f"{name}.txt").read_text(encoding="utf-8").strip() for name in names)


class Table:
    """:param names: as for `text_of`."""

    def __init__(self, *names: str) -> None:
        self.pairs = read_pairs(text_of(*names))
        self._whole = {pair.literals[0]: pair.chinese for pair in self.pairs if not pair.names}
        self._open: Mapping[str, list[Pair]] = _by_begin(pair for pair in self.pairs if pair.names)

    def find(self, text: str) -> str | None:
        """Translate a sentence; None if no pair matches it."""
        return self._find(text, 0)

    def _find(self, text: str, depth: int) -> str | None:
        if len(text) > LONGEST or depth > _DEEPEST:
            return None
        if text in self._whole:
            return self._whole[text]
        for begin in (text[:1], ""):
            for pair in self._open.get(begin, ()):
                values = pair.values(text)
                if values is not None:
                    return self._filled(pair, values, depth)
        return None

    def _filled(self, pair: Pair, values: Mapping[str, str], depth: int) -> str:
        def at(place: re.Match[str]) -> str:
            name = place[1]
            value = values[name]
            return (self._find(value, depth + 1) or value) if name.startswith("~") else value

        return _PLACE.sub(at, pair.chinese)


def _by_begin(pairs: Iterable[Pair]) -> dict[str, list[Pair]]:
    """Sort the pairs with the most words of their own first: they are the most specific."""
    found = defaultdict(list)
    for pair in sorted(pairs, key=lambda pair: -sum(map(len, pair.literals))):
        found[pair.literals[0][:1]].append(pair)
    return found


@cache
def _table() -> Table:
    return Table(*SENTENCES)


def chinese(sentence: str) -> str | None:
    """Return the sentence in Chinese; None: there is no Chinese for it, such as text of a person or of a firmware."""
    return _kept(sentence) if len(sentence) <= LONGEST else None


@lru_cache(_KEPT)
def _kept(sentence: str) -> str | None:
    return _table().find(sentence)


def with_chinese(told: dict[str, Any], *keys: str) -> dict[str, Any]:
    """Return the same with a key ``…_zh`` for each sentence, or list of sentences, that has a Chinese form."""
    twins: dict[str, Any] = {}
    for key in keys:
        said = told.get(key)
        if isinstance(said, list | tuple):
            twins[key + TWIN] = [chinese(each) or each for each in said]
        elif isinstance(said, str) and (found := chinese(said)) is not None:
            twins[key + TWIN] = found
    return {**told, **twins}
