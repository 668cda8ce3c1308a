"""Parses a condition: ``kind in [ping, 3..5] and not (size > 255)``. The meaning of its names is not known here."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field, PlainValidator

from wirebond.protocol.text.scalars import describe, hex_bytes, wrong
from wirebond.protocol.text.yaml_tree import MAX_NUMBER_LENGTH

MAX_LENGTH = 400
_ADVICE = (
    "write for example `flags & 0x01` (these bits are set), `kind == 3`, `kind in [1, 4..7]`, `magic == 0xFD`, "
    "`size > 255` or `sender == host`, joined by `and`, negated with `not (...)`"
)
_TOKEN = re.compile(r"\s*(0x[0-9A-Fa-f]+|0|[1-9][0-9]*|[A-Za-z_][A-Za-z0-9_]*|==|!=|<=|>=|\.\.|[<>&\[\](),-])")
_NUMBER = re.compile(r"0x[0-9A-Fa-f]+|0|[1-9][0-9]*")
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_WORDS = ("and", "not", "in", "or")
_MOST_DEEP = 8
_ENDLESS = 2**64 - 1


@dataclass(frozen=True)
class ValueText:
    """A number or a name; of several bytes in a row (``0xAA 0x55``) each one."""

    words: tuple[str, ...]

    @property
    def is_name(self) -> bool:
        return _NAME.fullmatch(self.words[0]) is not None

    @property
    def number(self) -> int:
        return int(self.words[0], 0)

    def __str__(self) -> str:
        return " ".join(self.words)


@dataclass(frozen=True)
class ComparisonText:
    """``NAME & mask in ranges``; ``mask`` is None where all bits count. ``operator`` as it was written."""

    name: str
    operator: str
    mask: int | None = None
    ranges: tuple[tuple[ValueText, ValueText], ...] = ()


@dataclass(frozen=True)
class ConditionText:
    """All of ``terms`` hold; ``negated``: not all of them."""

    terms: tuple[ComparisonText | ConditionText, ...]
    negated: bool = False


def parse(text: str) -> ConditionText:
    """Parse a condition. Raises the error of a wrong value."""
    return _Parser(text).whole()


def parse_values(text: str) -> tuple[tuple[ValueText, ValueText], ...]:
    """Parse the text after `in`: a value, a range, or a list of these. Raises the error of a wrong value."""
    return _Parser(text).values()


class _Parser:
    def __init__(self, text: str) -> None:
        self._text = text
        self._tokens: list[str] = []
        at = 0
        rest = text.rstrip()
        while at < len(rest):
            match = _TOKEN.match(rest, at)
            if match is None:
                raise self._wrong(f"{rest[at:].strip()[0]!r} has no meaning here")
            if len(match[1]) > MAX_NUMBER_LENGTH and match[1][0].isdigit():
                raise self._wrong(f"it has a number of {len(match[1])} characters")
            self._tokens.append(match[1])
            at = match.end()
        self._at = 0

    def _wrong(self, why: str = "") -> Exception:
        return wrong(f"{describe(self._text)} is not a condition{': ' + why if why else ''}; {_ADVICE}")

    def _peek(self) -> str:
        return self._tokens[self._at] if self._at < len(self._tokens) else ""

    def _take(self, *wanted: str) -> str:
        """Return the next token if it is one of these; else empty."""
        if self._peek() not in wanted or not self._peek():
            return ""
        self._at += 1
        return self._tokens[self._at - 1]

    def whole(self) -> ConditionText:
        found = self._all(0)
        if self._peek() == "or":
            raise self._wrong("`or` is not possible; write a list (`kind in [1, 2]`) or `not (... and ...)`")
        if self._peek():
            raise self._wrong(f"`{self._peek()}` is not expected there")
        return found

    def values(self) -> tuple[tuple[ValueText, ValueText], ...]:
        found = self._list()
        if self._peek():
            raise self._wrong(f"`{self._peek()}` is not expected there")
        return found

    def _all(self, depth: int) -> ConditionText:
        terms = [self._term(depth)]
        while self._take("and"):
            terms.append(self._term(depth))
        return ConditionText(tuple(terms))

    def _term(self, depth: int) -> ComparisonText | ConditionText:
        if depth > _MOST_DEEP:
            raise self._wrong("it is nested too deep")
        is_negated = bool(self._take("not"))
        if self._take("("):
            inner = self._all(depth + 1)
            if not self._take(")"):
                raise self._wrong("a `)` is missing")
            return ConditionText(inner.terms, is_negated)
        if is_negated:
            raise self._wrong("`not` must be followed by `(`")
        return self._comparison()

    def _comparison(self) -> ComparisonText | ConditionText:
        name = self._peek()
        if not _NAME.fullmatch(name) or name in _WORDS:
            raise self._wrong(f"a name is expected {f'where `{name}` stands' if name else 'at its end'}")
        self._at += 1
        mask = None
        if self._take("&"):
            mask = self._number()
            if mask == 0:
                raise self._wrong("a mask of 0 selects no bit")
        return self._behind(name, mask)

    def _behind(self, name: str, mask: int | None) -> ComparisonText | ConditionText:
        if name == "magic" and self._peek() in ("==", "!=") and self._at + 1 < len(self._tokens):
            self._validate_magic(self._at + 1)
        operator = self._take("==", "!=", "<", "<=", ">", ">=", "in")
        if not operator and self._peek() == "not":
            self._at += 1
            if not self._take("in"):
                raise self._wrong("after a name, `not` must be followed by `in`")
            operator = "not in"
        if operator in ("==", "!="):
            value = self._value()
            found = ComparisonText(name, operator, mask, ((value, value),))
        elif operator in ("in", "not in"):
            found = ComparisonText(name, operator, mask, self._list())
        elif operator:
            found = ComparisonText(name, operator, mask, (self._bound(operator),))
        elif mask is not None:
            whole = ValueText((str(mask),))
            return ComparisonText(name, "&", mask, ((whole, whole),))
        else:
            raise self._wrong(f"`{name}` is compared with nothing")
        return ConditionText((found,), negated=True) if operator in ("!=", "not in") else found

    def _validate_magic(self, at: int) -> None:
        """Check that bytes follow."""
        stop = at
        while stop < len(self._tokens) and _NUMBER.fullmatch(self._tokens[stop]):
            stop += 1
        if stop > at:
            hex_bytes(4)(" ".join(self._tokens[at:stop]))

    def _bound(self, operator: str) -> tuple[ValueText, ValueText]:
        number = self._number()
        low, high = {
            "<": (0, number - 1),
            "<=": (0, number),
            ">": (number + 1, _ENDLESS),
            ">=": (number, _ENDLESS),
        }[operator]
        if low > high:
            raise self._wrong(f"nothing is {operator} {number}")
        return ValueText((str(low),)), ValueText((str(high),))

    def _list(self) -> tuple[tuple[ValueText, ValueText], ...]:
        if not self._take("["):
            return (self._range(),)
        found = [self._range()]
        while self._take(","):
            found.append(self._range())
        if not self._take("]"):
            raise self._wrong("a `]` is missing")
        return tuple(found)

    def _range(self) -> tuple[ValueText, ValueText]:
        low = self._value()
        high = self._value() if self._take("..") else low
        if not low.is_name and not high.is_name and len(low.words) == len(high.words) == 1 and low.number > high.number:
            raise self._wrong(f"the range {low}..{high} is empty; write the smaller bound first")
        return low, high

    def _value(self) -> ValueText:
        words = [self._peek()]
        if not words[0] or words[0] in _WORDS or not (_NUMBER.fullmatch(words[0]) or _NAME.fullmatch(words[0])):
            where = f"where `{words[0]}` stands" if words[0] else "at its end"
            raise self._wrong(f"a value is expected {where}")
        self._at += 1
        while _NUMBER.fullmatch(words[0]) and _NUMBER.fullmatch(self._peek()):
            words.append(self._peek())
            self._at += 1
        return ValueText(tuple(words))

    def _number(self) -> int:
        value = self._value()
        if value.is_name or len(value.words) != 1 or value.number > _ENDLESS:
            raise self._wrong(f"`{value}` is not one number")
        return value.number


def _when(value: object) -> ConditionText:
    if not isinstance(value, str):
        raise wrong(f"{describe(value)} is not a condition; {_ADVICE}")
    if len(value) > MAX_LENGTH:
        raise wrong(f"a condition has at most {MAX_LENGTH} characters, and this one has {len(value)}; shorten it")
    return parse(value)


_validate: Callable[[object], ConditionText] = _when
_PATTERN = r"^(not *\()?[( ]*[A-Za-z_][A-Za-z0-9_]* *(&|==|!=|<|>|in |not in )[A-Za-z0-9_ &=!<>.,()\[\]]+$"
When = Annotated[
    ConditionText,
    PlainValidator(_validate, json_schema_input_type=Annotated[str, Field(pattern=_PATTERN, max_length=MAX_LENGTH)]),
]
