"""The module finds the same places of parts and values in a frame as `wirebond explain`, which has code of its own."""

from __future__ import annotations

import random
import shutil
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest

from tests.shared import few_or_many, loaded, rejected_vectors
from tests.streams import random_values
from tests.test_against_reference import FORMATS, can_be_told
from tests.wasm.module import MODULE, Module, sender_number
from wirebond import Codec
from wirebond.explain import Row, explain
from wirebond.protocol.model import End, PartKind
from wirebond.protocol.model.forms import parts_of_forms

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(shutil.which("node") is None, reason="Node is not there"),
]
Place = tuple[str, int, int, int]  # name, level, place, size


@pytest.fixture(scope="module")
def module() -> Iterator[Module]:
    assert MODULE.is_file(), "make build/wasm.stamp"
    with Module() as opened:
        yield opened


def names_in(value: Any) -> set[str]:
    """The names of all values in a message's fields."""
    if isinstance(value, dict):
        return set(value).union(*map(names_in, value.values()))
    return set().union(*map(names_in, value)) if isinstance(value, list) else set()


def places_of(rows: tuple[Row, ...], payload: int) -> Counter[Place]:
    """Values that have bytes, from the payload's first one on."""
    values = (row for row in rows if row.level and row.wire and row.meaning != "constant")
    return Counter((row.name, row.level, row.offset - payload, len(row.wire)) for row in values)


def assert_same_values(frame: bytes, rows: tuple[Row, ...], found: dict[str, Any]) -> None:
    payload, size = found["payload"]
    ours = Counter(
        (path.rpartition(".")[2], level, at, length)
        for path, level, at, length in found["spans"]
        if length and at + length <= size  # zeros at the end may be left out
    )
    theirs = places_of(rows, payload)
    assert ours - theirs == Counter(), frame.hex()
    # Reserved bytes and padding are not values of the message.
    others = {name.partition("[")[0] for name, *_ in theirs - ours}
    assert not others & names_in(found["message"]["fields"]), frame.hex()


def assert_same_parts(codec: Codec, end: End, rows: tuple[Row, ...], found: dict[str, Any]) -> None:
    """A page adds up the sizes of the form's parts, before the payload and after it."""
    parts = parts_of_forms(codec.model.format.parts, end)[found["form"]].parts
    payload, size = found["payload"]
    sizes = [size if part.kind == PartKind.PAYLOAD else part.size for part in parts]
    at = payload - sum(sizes[: [part.kind for part in parts].index(PartKind.PAYLOAD)])
    ours = []
    for part, length in zip(parts, sizes, strict=True):
        if length:
            ours.append((part.name, at, length))
        at += length
    theirs = [(row.name, row.offset, len(row.wire)) for row in rows if not row.level]
    assert [row for row in theirs if row[0] != "delimiter"] == ours


@few_or_many(3, 100)
@pytest.mark.parametrize("name", sorted(FORMATS))
def test_values_and_parts_have_the_same_places(module: Module, name: str, number: int) -> None:
    codec, source = loaded(FORMATS[name]), random.Random(number)
    module.open(codec)
    for message in codec.model.messages:
        end = End.HOST if message.sent_by(End.HOST) else End.MCU
        if not can_be_told(codec, end):
            continue
        for _ in range(number):
            frame = codec.encode(message.name, random_values(message, source), sender=end)
            found = module.call("explain", sender_number(end), -1, data=frame)
            (stretch,) = (one for one in explain(codec.model, frame, end).stretches if one.kind != "fill")
            if "message" not in found:
                assert stretch.kind != "frame" or message.name not in stretch.summary, frame.hex()
                continue
            assert stretch.summary.startswith(found["message"]["name"])
            if found["payload"] is None:
                assert codec.model.format.stuffing
                continue
            assert_same_values(frame, stretch.rows, found)
            assert_same_parts(codec, end, stretch.rows, found)


@pytest.mark.parametrize("vector", rejected_vectors(), ids=str)
def test_bytes_that_are_no_frame_have_a_cause(module: Module, vector: Any) -> None:
    module.open(loaded(FORMATS[vector.protocol]))
    for end in (End.MCU, End.HOST):
        found = module.call("explain", sender_number(end), -1, data=vector.frame)
        assert "message" not in found and found["account"]["discarded_bytes"]
