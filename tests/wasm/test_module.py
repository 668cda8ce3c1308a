"""The engine in WebAssembly does what the native one does: the same sources, for another machine."""

from __future__ import annotations

import math
import random
import re
import shutil
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from tests.shared import accepted_vectors, codec, few_or_many, loaded, rejected_vectors
from tests.streams import Speaker, chunks, hard_pieces, random_values
from tests.test_against_reference import FORMATS, can_be_told, stream_for
from tests.test_random_formats import drawn_format
from tests.wasm.module import MODULE, Module, sender_number
from wirebond import Codec, Message, MessageError
from wirebond.protocol.model import End

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(shutil.which("node") is None, reason="Node is not there"),
]


@pytest.fixture(scope="module")
def module() -> Iterator[Module]:
    assert MODULE.is_file(), "make build/wasm.stamp"
    with Module() as opened:
        yield opened


def same(one: Any, other: Any) -> bool:
    """Equal, and NaN like NaN."""
    if isinstance(one, float) and isinstance(other, float):
        return one == other or (math.isnan(one) and math.isnan(other))
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other) and type(one) is type(other)


def seen(message: Message) -> dict[str, Any]:
    """A native message as the module gives one."""
    found = {
        name: getattr(message, name)
        for name in ("t", "offset", "id", "raw", "header", "name", "sender", "fields", "violations")
    }
    if message.sender is None:
        del found["sender"]
    return found


def decode_both(module: Module, codec: Codec, stream: list[bytes], sender: End | None) -> list[Message]:
    """Messages and accounts of both, compared."""
    number = sender_number(sender)
    decoder = codec.decoder(sender)
    native, in_wasm = [], []
    module.call("restart", number)
    for at, chunk in enumerate(stream):
        native += decoder.feed(chunk, at / 8)
        in_wasm += module.call("feed", number, at * 125_000.0, data=chunk)
    native += decoder.finish()
    in_wasm += module.call("finish", number)
    assert same(in_wasm, [seen(message) for message in native])
    assert same(module.call("account", number), decoder.engine.stats())
    return native


def without_value(sentence: str) -> str:
    """A refusal without the value and its type, which each language shows in its way."""
    path, _, rest = sentence.partition(" ")
    return path + re.sub(r"^.*?(?= does not fit|; expected)", "", rest).partition("; expected")[0]


def encode_both(module: Module, codec: Codec, source: random.Random, count: int) -> None:
    """Messages with drawn values, some of them refused: the same bytes, or the same sentence."""
    for _ in range(count):
        message = source.choice(codec.model.messages)
        end = End.HOST if message.sent_by(End.HOST) else End.MCU
        fields = random_values(message, source)
        if fields and source.random() < 0.3:
            name = source.choice(list(fields))
            field = next(field for field in message.fields if field.name == name)
            large = 0.5 if field.enum or field.flags else 1e300  # a whole float is an integer there in JavaScript
            several = [1] if field.flags else {"x": 1}  # Python takes the keys of a dict for names of flags
            fields[name] = source.choice([10**12, -1, large, "word", [1], several, None, 0.5, True])
        try:
            expected: bytes | str = codec.encode(message.name, fields)
        except MessageError as error:
            expected = str(error)
        try:
            found: bytes | str = module.encode(codec, message.name, fields, {}, end)
        except MessageError as error:
            found = str(error)
        if isinstance(expected, str) and isinstance(found, str):
            expected, found = without_value(expected), without_value(found)
        assert found == expected, (message.name, fields)


def drawn_stream(codec: Codec, source: random.Random) -> list[bytes]:
    """Frames of a drawn format and damaged ones, as they are read. Where silence ends a frame, each is one read."""
    speaker = Speaker(codec)
    drawn = [piece for piece in hard_pieces(lambda: speaker.any(source), source, 20) if piece]
    return drawn if codec.model.format.ends_by_silence else chunks(b"".join(drawn), source)


def known_stream(codec: Codec, source: random.Random) -> list[bytes]:
    return chunks(stream_for(codec, source, 30), source)


def compare(
    module: Module, codec: Codec, source: random.Random, stream: Callable[[Codec, random.Random], list[bytes]]
) -> None:
    module.open(codec)
    for sender in (None, End.HOST, End.MCU):
        if can_be_told(codec, sender):
            decode_both(module, codec, stream(codec, source), sender)
    encode_both(module, codec, source, 20)


def test_vectors_come_out_and_rejected_ones_do_not(module: Module) -> None:
    for vector in accepted_vectors():
        of = codec(vector.protocol)
        module.open(of)
        assert module.encode(of, vector.message, vector.fields, {}, End(vector.sender)) == vector.frame
        (message,) = module.call("feed", sender_number(End(vector.sender)), 1.5e6, data=vector.frame)
        assert (message["name"], message["fields"], message["t"]) == (vector.message, vector.fields, 1.5)
    for rejected in rejected_vectors():
        of = codec(rejected.protocol)
        module.open(of)
        for sender in (None, End.HOST, End.MCU):
            if can_be_told(of, sender):
                decode_both(module, of, [rejected.frame], sender)


@pytest.mark.parametrize("name", sorted(FORMATS))
@few_or_many(1, 20)
def test_every_format_is_decoded_and_encoded_alike(module: Module, name: str, number: int) -> None:
    for seed in range(number):
        compare(module, loaded(FORMATS[name]), random.Random(f"{name} {seed}"), known_stream)


@few_or_many(40, 10_000)
def test_random_formats_are_decoded_and_encoded_alike(module: Module, number: int) -> None:
    for seed in range(number):
        drawn = drawn_format(seed)
        try:
            compare(module, drawn.codec, random.Random(seed), drawn_stream)
        except AssertionError as error:
            raise AssertionError(str(drawn)) from error


def test_rows_are_the_columns_of_the_native_engine(module: Module) -> None:
    compared = 0
    for name in sorted(FORMATS):
        codec = loaded(FORMATS[name])
        if codec.model.format.ends_by_silence or not can_be_told(codec, End.MCU):
            continue
        module.open(codec)
        stream = stream_for(codec, random.Random(name))
        native = codec.decode_columns(stream, End.MCU)
        names = [message.name for message in codec.model.messages]
        of_messages = module.call("columns")
        half = len(stream) // 2
        words = module.follow(End.MCU, [(5e6, stream[:half]), (5e6, stream[half:])])
        while words:
            index, rows, times, _offsets, _sizes, *words = words
            if index == len(names):  # unknown ones have no columns
                continue
            table = native[names[index]]
            assert set(module.numbers(times, rows)) == {5.0}
            for column, elements in of_messages[index]:
                found = module.numbers(words.pop(0), rows * elements)
                expected = np.asarray(table.fields[column]).astype(np.float64).reshape(-1)
                expected = expected[: len(found)]  # a follower still waits for what the end of a capture settles
                np.testing.assert_array_equal(found, expected, f"{name} {column}")
                compared += len(found)
    assert compared > 1000
