"""Received messages as bytes for another process: they come back as they were, and bytes that no engine wrote are
refused."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

import wirebond
from tests.shared import ROOT, few_or_many
from wirebond import _engine

FILES = [ROOT / "protocols" / f"{name}.yaml" for name in ("diffdrive", "native", "enterprize", "pid_tuner")]
FILES += [ROOT / "tests" / "formats" / "servo_options.yaml"]


def messages_of(codec: wirebond.Codec) -> list[wirebond.Message]:
    """One of each that can be sent with zeros, and an unknown one where the format has them."""
    found: list[wirebond.Message] = []
    for model in codec.model.messages:
        decoder = codec.decoder(model.sender if model.sender != "both" else "mcu")
        values = {f.name: 0 for f in model.fields if not isinstance(f.default, int | float | bool)}
        try:
            frame = codec.encode(model.name, values, sender="mcu" if model.sender == "both" else None)
        except wirebond.WirebondError:
            continue
        found += [*decoder.feed(frame, 1.5), *decoder.finish()]
    assert found
    return found


def unpack(codec: wirebond.Codec, records: bytes, shift: float = 0.0) -> list[wirebond.Message]:
    return _engine.unpack_messages(codec.tables.protocol, codec.tables.format_for("host"), records, shift)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_messages_come_back_as_they_were(path: Path) -> None:
    codec = wirebond.load(path)
    messages = [m for m in messages_of(codec) if m.sender == "host"]
    again = unpack(codec, _engine.pack_messages(messages), 2.0)
    for name in ("name", "fields", "header", "raw", "payload", "id", "offset", "violations"):
        assert [getattr(m, name) for m in again] == [getattr(m, name) for m in messages]
    assert [m.t for m in again] == [m.t + 2.0 for m in messages]
    assert _engine.pack_messages(unpack(codec, _engine.pack_messages(messages))) == _engine.pack_messages(messages)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda data: data[:-1], "is cut short"),
        (lambda data: data[:20], "is cut short"),
        (lambda data: data + b"\0", "is cut short"),
        (lambda data: b"\xff" * 4 + data[4:], "has another size than its parts"),
        (lambda data: data[:24] + b"\xff\x7f" + data[26:], "is of a message that the protocol does not have"),
        (lambda data: data[:26] + b"\x63" + data[27:], "has a form that the frames of this protocol do not have"),
    ],
)
def test_records_that_cannot_be_are_refused(change: object, why: str) -> None:
    codec = wirebond.load(FILES[0])
    data = _engine.pack_messages(messages_of(codec)[:1])
    with pytest.raises(ValueError, match=rf"the record at byte \d+ {why}"):
        unpack(codec, change(data))  # type: ignore[operator]


@few_or_many(3000, 100_000)
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_any_bytes_are_messages_or_refused(path: Path, number: int) -> None:
    codec = wirebond.load(path)
    good = _engine.pack_messages([m for m in messages_of(codec) if m.sender == "host"])
    source = random.Random(path.stem)
    for _ in range(number):
        data = bytearray(good)
        for _ in range(source.choice([1, 1, 2, 8])):
            data[source.randrange(len(data))] = source.choice([0, 1, 255, source.randrange(256)])
        try:
            messages = unpack(codec, bytes(data[: source.choice([len(data), source.randrange(len(data))])]))
        except ValueError:
            continue
        for message in messages:
            assert isinstance(message.fields, dict)
            assert isinstance(message.header, dict)
            assert all(isinstance(v, str) for v in message.violations)
