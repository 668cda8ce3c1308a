"""A host link's account closes after every step, whatever the steps; what the wire carries follows the rules."""

from __future__ import annotations

from collections import deque
from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from tests.link.drivers import VirtualDriver, balances
from tests.link.protocol import manipulator
from wirebond.errors import LinkDownError, QueueFullError, StoppedError

CODEC = manipulator(", max_age: 400 ms")
STOPPED = ("arm", "drive")
NAMES = ("drive", "arm", "lamp", "note", "query")
REPEATED = ("drive", "lamp")


class AnyLife(RuleBasedStateMachine):
    """A link that is driven by chance. Each value that is sent has a number of its own, so that the far end knows."""

    def __init__(self) -> None:
        super().__init__()
        self.link = VirtualDriver(CODEC)
        self.number = 0
        self.waits: dict[str, deque[dict[str, Any]]] = {name: deque() for name in NAMES}
        self.repeated: dict[str, list[dict[str, Any]]] = {name: [] for name in REPEATED}
        self.seen = 0
        self.is_stopped = False
        self.bytes_before = 0  # sent before the port was plugged in
        self.handed_over = 0  # of the bytes since then: those that a stop could not call back any more

    def _values(self, name: str, size: int = 0) -> dict[str, Any]:
        self.number += 1
        number = self.number
        return {
            "drive": {"speed": 1 + number % 30_000, "turn": number // 30_000},
            "arm": {"torque": 1 + number % 30_000},
            "lamp": {"level": number % 256},
            "note": {"number": number, "text": bytes(size)},
            "query": {},
        }[name]

    @rule(name=st.sampled_from(NAMES), count=st.integers(1, 60), size=st.integers(0, 200))
    def send(self, name: str, count: int, size: int) -> None:
        for _ in range(count):
            values = self._values(name, size)
            try:
                self.link.send(name, **values)
            except StoppedError:
                assert self.is_stopped and name in STOPPED
            except LinkDownError:
                assert not self.link.is_plugged
            except QueueFullError:
                assert self.link.stats()["send"]["queued"] > 100
            else:
                assert self.link.is_plugged and not (self.is_stopped and name in STOPPED)
                self.waits[name].append(values)

    @rule(name=st.sampled_from(REPEATED), hold=st.sampled_from([0.001, 0.05, 0.5, 60]))
    def repeat(self, name: str, hold: float) -> None:
        values = self._values(name)
        try:
            self.link.repeat(name, hold, **values)
        except StoppedError:
            assert self.is_stopped and name in STOPPED
        else:
            self.repeated[name].append(values)

    @rule(name=st.sampled_from(REPEATED))
    def stop_repeating(self, name: str) -> None:
        self.link.stop_repeating(name)

    @rule()
    def stop(self) -> None:
        self.handed_over = self.link.stats()["send"]["sent_bytes"] - self.bytes_before
        self.link.emergency_stop()
        self.is_stopped = True
        for name in STOPPED:
            self.waits[name].clear()
        self.repeated["drive"].clear()

    @rule()
    def release(self) -> None:
        self.link.release_stop()
        self.is_stopped = False

    @rule(seconds=st.sampled_from([0.0001, 0.003, 0.02, 0.2, 1.0]))
    def run(self, seconds: float) -> None:
        self.link.run(seconds)

    @precondition(lambda self: self.link.is_plugged)
    @rule()
    def unplug(self) -> None:
        self.link.unplug()
        for waiting in self.waits.values():
            waiting.clear()

    @precondition(lambda self: not self.link.is_plugged)
    @rule()
    def plug(self) -> None:
        self.bytes_before = self.link.stats()["send"]["sent_bytes"]
        self.handed_over = 0
        self.link.plug()
        self.seen = 0

    @invariant()
    def the_account_closes(self) -> None:
        assert balances(self.link.stats()["send"])

    @invariant()
    def no_more_than_5_ms_or_one_frame_lies_in_the_driver(self) -> None:
        longest = max(5_000, 215 * self.link.byte_us + 1_000)
        assert self.link.buffered * self.link.byte_us <= longest + self.link.byte_us

    def teardown(self) -> None:
        self.link.close()
        stats = self.link.stats()["send"]
        assert stats["queued"] == 0
        assert balances(stats)


class WhatArrives(AnyLife):
    """With the far end: each producer's frames come in order, and none that a stop dropped comes at all."""

    @invariant()
    def what_arrives_was_sent_and_not_overruled(self) -> None:
        if not self.link.is_plugged:
            return
        found = CODEC.decoder("host").feed(self.link.arrived())
        for message in found[self.seen :]:
            name, values = message.name, dict(message.fields)
            if name in REPEATED and values in self.repeated[name]:
                continue
            if name in STOPPED and not any(values.values()):
                continue
            if values in self.waits[name]:
                while self.waits[name].popleft() != values:
                    pass  # expired, or dropped with a lease
                continue
            assert name in STOPPED
            assert message.offset < self.handed_over
        self.seen = len(found)


TestAccount = AnyLife.TestCase
TestAccount.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)
TestArrivals = WhatArrives.TestCase
TestArrivals.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)
