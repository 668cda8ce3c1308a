"""A host's link in WebAssembly beside the native one, under virtual time: the same bytes leave at the same moments."""

from __future__ import annotations

import random
import shutil
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import pytest

from tests.link.protocol import manipulator
from tests.link.test_together import drawn_step
from tests.shared import codec, few_or_many
from tests.streams import damaged, random_values
from tests.wasm.module import Module
from tests.wasm.test_module import same, seen
from wirebond import Codec, _engine
from wirebond.link.settings import engine_settings
from wirebond.protocol.model import End

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(shutil.which("node") is None, reason="Node is not there"),
]

START = 1_000_000  # µs
ARM = manipulator(", max_age: 40 ms")


@pytest.fixture(scope="module")
def module() -> Iterator[Module]:
    with Module() as opened:
        yield opened


class Pair:
    """Both links; every answer of the one must be that of the other."""

    def __init__(self, module: Module, protocol: Codec, baud: int) -> None:
        self.codec = protocol
        count = len(protocol.model.messages) + 1  # unknown ones, too
        self.all_messages = np.arange(count, dtype=np.uint16).tobytes()
        self.module = module
        settings = engine_settings(protocol, baud)
        receive = protocol.tables.format_for(End.MCU)
        self.core = _engine.LinkCore(protocol.tables.protocol, receive, settings, START)
        module.open(protocol)
        module.call("link_open", START, data=settings.table())

    def raw(self, name: str, *args: float, data: bytes = b"") -> Any:
        return self.module.raw(name, *args, data=data)[0]

    def port(self, is_up: bool, now: int) -> None:
        if is_up:
            self.core.port_up(now)
            self.raw("port_up", now)
        else:
            self.core.port_down(now, "unplugged")
            self.raw("port_down", now, data=b"unplugged")

    def send(self, message: str, values: dict[str, Any], now: int, hold: float = 0.0) -> None:
        index, model = self.codec.tables.indices[message], self.codec.model.message(message)
        reply = -1 if model.reply is None else self.codec.tables.indices[model.reply]
        frame = self.codec.encode(message, values)
        if hold:
            expected = self.core.repeat(index, frame, hold, reply, now)
        else:
            expected = self.core.send(index, frame, reply, now)
        asked = (index, values, {}, reply, True, 0, float(hold))
        assert self.module.call("send", now, data=msgspec.msgpack.encode(asked)) == expected

    def act(self, name: str, now: int) -> None:
        match name:
            case "stop":
                self.core.stop(now)
                self.raw("stop", now)
            case "release":
                self.core.release_stop()
                self.raw("release_stop")
            case "end_motion":
                self.core.end_motion()
                self.raw("end_motion")

    def read(self, data: bytes, now: int) -> None:
        if data:
            self.core.received(data, now - 100, now)
            self.raw("received", now - 100, now, data=data)
        else:
            self.core.idle(now)
            self.raw("link_idle", now)
        native = [seen(message) for message in self.core.receive()]
        assert same(self.module.call("receive", data=self.all_messages), native)

    def write(self, room: int, now: int) -> bytes:
        """Return the bytes that leave with this much room, and when the link wants to be called again."""
        self.core.poll(now)
        self.raw("poll", now)
        taken = b""
        while True:
            data = self.core.to_write(now)
            assert self.module.raw("to_write", now, 0)[1] == data
            size = min(room - len(taken), len(data))
            if not data:
                break
            self.core.written(size, now)
            self.raw("written", size, now)
            taken += data[:size]
            if size == 0:
                break
        due, native = self.raw("next_due", now), self.core.next_due(now)
        assert due == ("Infinity" if native == 2**64 - 1 else native)
        assert ["down", "stale", "up"][self.raw("state", now)] == self.core.state(now)
        return taken

    def settle(self) -> None:
        assert same(self.module.call("link_account"), self.core.stats())


def frames_of(protocol: Codec, source: random.Random) -> bytes:
    """Return the frames of an MCU, sometimes damaged."""
    messages = [message for message in protocol.model.messages if message.sent_by(End.MCU)]
    out = b""
    for message in source.choices(messages, k=source.randrange(4)):
        frame = protocol.encode(message.name, random_values(message, source), sender="mcu")
        out += damaged(frame, source) if source.random() < 0.2 else frame
    return out


@few_or_many(5, 200)
@pytest.mark.parametrize("baud", [9600, 2_000_000])
def test_whatever_happens_the_same_bytes_leave(module: Module, baud: int, number: int) -> None:
    for seed in range(number):
        source = random.Random(f"{baud} {seed}")
        pair, now = Pair(module, ARM, baud), START
        pair.port(True, now)
        left = b""
        for _ in range(60):
            now += source.choice((50, 900, 12_000, 60_000))
            kind, given = drawn_step(source)
            if kind == "send":
                for name, values in given:
                    pair.send(name, values, now)
            elif kind == "repeat":
                pair.send("lamp", {"level": given}, now, hold=0.05)
            elif kind == "unplug":
                pair.port(False, now)
                pair.port(True, now)
            elif kind != "wait":
                pair.act(kind, now)
            pair.read(frames_of(ARM, source), now)
            left += pair.write(source.choice((0, 1, 7, 40, 5000)), now)
        pair.settle()
        assert len(left) > 100


def test_a_lease_ends_with_its_safe_value_and_nothing_leaves_late(module: Module) -> None:
    """A page's worker stands still while it drives: what leaves afterwards is the safe value, once."""
    protocol = codec("diffdrive")
    safe = protocol.encode("velocity", {"linear": 0.0, "angular": 0.0})
    for pause in (2_000_000, 10_000_000, 60_000_000):
        pair = Pair(module, protocol, 115200)
        pair.port(True, START)
        pair.send("velocity", {"linear": 1.0, "angular": 0.0}, START, hold=0.25)
        driven = protocol.encode("velocity", {"linear": 1.0, "angular": 0.0})
        assert pair.write(5000, START + 1000) == driven
        assert pair.write(5000, START + pause) == safe
        assert pair.write(5000, START + pause + 1_000_000) == b""


def test_a_stop_leaves_before_a_full_queue(module: Module) -> None:
    protocol = codec("diffdrive")
    pair = Pair(module, protocol, 9600)
    pair.port(True, START)
    for _ in range(50):
        pair.send("parameter", {"name": "clear_safe_mode", "value": 1.0}, START)
    pair.act("stop", START + 10)
    stop = protocol.model.emergency_stop[0]
    first = protocol.encode(stop.message, stop.fields)
    assert pair.write(len(first), START + 20) == first
