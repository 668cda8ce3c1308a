"""`queue: latest` at the host: of a message only the newest frame waits, and each one that did not leave is counted."""

from __future__ import annotations

import contextlib
import random
from itertools import pairwise

import pytest

import wirebond
from tests.link.drivers import VirtualDriver
from tests.shared import PROTOCOLS
from wirebond import Codec
from wirebond.protocol import loads

NEWEST = wirebond.load(PROTOCOLS / "enterprize.yaml")
COMMANDS = ("gimbal_cmd", "chassis_cmd", "action_cmd", "sentry_gimbal_cmd", "sentry_cv_cmd")
# The same file, whose commands all wait.
TEXT = (PROTOCOLS / "enterprize.yaml").read_text(encoding="utf-8").replace("    queue: latest\n", "")
ARM = """
wirebond: 1
protocol: arm
link: {baud: 9600, max_age: 200 ms}
frame: [{magic: 0x55}, {length: u8}, {id: u8}, {payload: by_length}, {check: crc-16/arc}]
messages:
  move: {id: 1, sender: host, every: 50 ms, queue: latest, fields: {speed: {type: i16}}}
  text: {id: 2, sender: host, fields: {words: {type: text, max: 200}}}
  look: {id: 3, sender: host, reply: seen, queue: latest, fields: {at: {type: u8}}}
  seen: {id: 4, sender: mcu, fields: {at: {type: u8}}}
emergency_stop: [{message: move, fields: {speed: 0}}]
"""


def values(codec: Codec, name: str, number: int) -> dict[str, float]:
    """The message with this number in its first float."""
    fields = codec.model.message(name).fields
    first = next(f.name for f in fields if f.kind == "float")
    return {f.name: number if f.name == first else 0 for f in fields}


def number_in(message: dict[str, float]) -> float:
    return max(message.values())


def test_five_commands_at_111_percent_of_the_line_are_sent_or_counted_as_replaced() -> None:
    driver = VirtualDriver(NEWEST, baud=2_000_000)
    rounds = 1000
    for number in range(1, rounds + 1):  # 2 x 1 kHz each, on 2 Mbaud 8N2: 101 bytes in 500 us
        for name in COMMANDS:
            driver.send(name, **values(NEWEST, name, number))
        driver.run(0.0005)
    driver.run(0.01)
    send = driver.stats()["send"]
    assert send["offered"] == send["accepted"] == rounds * len(COMMANDS)
    assert send["sent"] + send["replaced"] == send["accepted"]
    assert 0.08 < send["replaced"] / send["accepted"] < 0.12
    heard = driver.messages()
    assert len(heard) == send["sent"]
    for name in COMMANDS:
        numbers = [number_in(fields) for heard_name, fields in heard if heard_name == name]
        assert numbers == sorted(set(numbers)) and numbers[-1] == rounds  # in order, once each, and the newest
        assert max(b - a for a, b in pairwise(numbers)) <= 2  # none is left behind by others


def test_without_it_the_same_commands_fill_the_queue() -> None:
    codec = Codec(loads(TEXT))
    driver = VirtualDriver(codec, baud=20_000)
    assert driver.fill_queue("chassis_cmd", **values(codec, "chassis_cmd", 1)) > 1000


@pytest.fixture
def arm() -> VirtualDriver:
    return VirtualDriver(Codec(loads(ARM)), baud=9600)


def filled(arm: VirtualDriver) -> None:
    """The line is taken for 0.12 s."""
    arm.send("text", words="x" * 100)
    arm.send("text", words="behind")


def test_newest_frame_leaves_in_the_place_of_the_first(arm: VirtualDriver) -> None:
    filled(arm)
    for speed in (1, 2, 3):
        arm.send("move", speed=speed)
    arm.send("text", words="last")
    arm.run(1.0)
    heard = [fields.get("speed", fields.get("words", "")[:6]) for _, fields in arm.messages()]
    assert heard == ["xxxxxx", "behind", 3, "last"]
    assert arm.stats()["send"]["replaced"] == 2


def test_stop_drops_what_waits_and_a_lost_port_expires_it(arm: VirtualDriver) -> None:
    filled(arm)
    arm.send("move", speed=9)
    arm.emergency_stop()
    arm.release_stop()
    arm.run(1.0)
    assert [fields["speed"] for name, fields in arm.messages() if name == "move"] == [0]
    assert arm.stats()["send"]["overruled"] == 1
    filled(arm)
    arm.send("move", speed=9)
    waiting = arm.stats()["send"]["queued"]
    assert waiting >= 2
    arm.unplug()
    arm.run(0.1)
    sent = arm.stats()["send"]
    assert (sent["queued"], sent["expired"]) == (0, waiting)
    arm.check()


def test_frame_that_waited_longer_than_max_age_expires(arm: VirtualDriver) -> None:
    for words in ("a", "b"):
        arm.send("text", words=words * 100)
    arm.send("move", speed=1)
    arm.run(0.15)
    arm.send("move", speed=2)  # its place is older than 200 ms when its turn comes, and it is not
    arm.run(0.15)
    assert [fields["speed"] for name, fields in arm.messages() if name == "move"] == [2]
    for words in ("a", "b", "c"):
        arm.send("text", words=words * 200)
    arm.send("move", speed=3)
    arm.run(2.0)
    assert 3 not in [fields.get("speed") for _, fields in arm.messages()]
    assert arm.stats()["send"]["queued"] == 0


def test_value_that_is_repeated_is_not_replaced_by_one_that_is_sent_once(arm: VirtualDriver) -> None:
    arm.repeat("move", hold=0.2, speed=5)
    arm.run(0.06)
    arm.send("move", speed=7)
    arm.run(0.1)
    speeds = [fields["speed"] for _, fields in arm.messages()]
    assert speeds.count(7) == 1 and speeds[-1] == 5


def test_requests_wait_in_turn(arm: VirtualDriver) -> None:
    filled(arm)
    for at in (1, 2):
        arm.send("look", at=at)
    arm.run(1.0)
    assert [fields["at"] for name, fields in arm.messages() if name == "look"] == [1, 2]


def test_any_order_of_calls_keeps_the_account(arm: VirtualDriver) -> None:
    draw = random.Random("latest")
    for number in range(600):
        step = draw.randrange(12)
        if step < 5:
            with contextlib.suppress(wirebond.WirebondError):
                arm.send("move", speed=number)
        elif step == 5 and not arm.core.is_stopped():
            arm.repeat("move", hold=draw.choice((0.01, 0.3)), speed=-1)
        elif step == 6:
            arm.emergency_stop()
        elif step == 7:
            arm.release_stop()
        elif step == 8:
            (arm.unplug if arm.is_plugged else arm.plug)()
        elif step == 9 and arm.is_plugged:
            arm.send("text", words="y" * draw.randrange(100))
        elif step == 10:
            arm.stop_repeating("move")
        arm.run(draw.choice((0.0001, 0.02)))  # each step looks at the account
    arm.close()
