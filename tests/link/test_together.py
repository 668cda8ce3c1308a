"""Frames that leave with one write: the bytes and the account are those of frames that leave one by one."""

from __future__ import annotations

import random
from typing import Any

import pytest

from tests.link.drivers import balances
from tests.link.protocol import manipulator
from wirebond import Codec, _engine
from wirebond.link.settings import engine_settings
from wirebond.protocol.model import End

PLAIN = manipulator(", max_age: 40 ms")


def make_core(codec: Codec, baud: int) -> _engine.LinkCore:
    core = _engine.LinkCore(
        codec.tables.protocol, codec.tables.format_for(End.MCU), engine_settings(codec, baud), 1_000_000
    )
    core.port_up(1_000_000)
    return core


def carry(core: _engine.LinkCore, room: int, now: int, together: bool) -> tuple[bytes, int]:
    """Return the bytes that a port with this much room accepts, and the number of writes."""
    taken, writes = b"", 0
    while data := core.to_write(now, together):
        writes += 1
        size = min(room - len(taken), len(data))
        core.written(size, now)
        taken += data[:size]
        if size == 0:
            break
    return taken, writes


def do(core: _engine.LinkCore, codec: Codec, step: tuple[str, Any], now: int) -> None:
    kind, given = step
    if kind == "send":
        for name, values in given:
            model = codec.model.message(name)
            reply = -1 if model.reply is None else codec.tables.indices[model.reply]
            core.send(codec.tables.indices[name], codec.encode(name, values), reply, now)
    elif kind == "repeat":
        core.repeat(codec.tables.indices["lamp"], codec.encode("lamp", level=given), 0.05, -1, now)
    elif kind == "stop":
        core.stop(now)
    elif kind == "release":
        core.release_stop()
    elif kind == "unplug":
        core.port_down(now)
        core.port_up(now)


def drawn_step(draw: random.Random) -> tuple[str, Any]:
    kind = draw.choices(("send", "repeat", "stop", "release", "unplug", "wait"), (12, 2, 1, 1, 1, 4))[0]
    if kind == "repeat":
        return kind, draw.randrange(256)
    values: dict[str, Any] = {"drive": {"speed": 1, "turn": 2}, "arm": {"torque": 3}, "query": {}}
    names = draw.choices(("drive", "arm", "note", "query"), (4, 4, 4, 1), k=draw.randrange(1, 12))
    long = {"number": 7, "text": bytes(draw.randrange(200))}
    return kind, [(name, values.get(name, long)) for name in names]


@pytest.mark.parametrize("baud", [115200, 2_000_000])
def test_whatever_happens(baud: int) -> None:
    draw, writes = random.Random(baud), [0, 0]
    for _ in range(40):
        cores, now, out = [make_core(PLAIN, baud), make_core(PLAIN, baud)], 1_000_000, [b"", b""]
        for _ in range(60):
            step, room = drawn_step(draw), draw.choice((0, 1, 7, 40, 500, 5000))
            now += draw.choice((0, 50, 900, 12_000))
            for which, core in enumerate(cores):
                core.poll(now)
                do(core, PLAIN, step, now)
                taken, count = carry(core, room, now, together=bool(which))
                out[which] += taken
                writes[which] += count
            one, several = (core.stats()["send"] for core in cores)
            assert out[0] == out[1]
            assert one == several and balances(one)
            assert cores[0].next_due(now) == cores[1].next_due(now)
    assert writes[1] < writes[0]


def test_many_small_frames_need_few_writes() -> None:
    core = make_core(PLAIN, 2_000_000)
    for _ in range(20):
        core.send(PLAIN.tables.indices["arm"], PLAIN.encode("arm", torque=1), -1, 1_000_000)
    taken, writes = carry(core, 5000, 1_000_000, together=True)
    assert len(taken) == 20 * len(PLAIN.encode("arm", torque=1))
    assert writes == 1
