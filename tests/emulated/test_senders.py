"""Many senders on the emulated board: what a link accepted arrives once, in order for each sender, and is accounted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest

import wirebond
from tests.emulated.build import HERE, build, without_silence
from tests.emulated.machine import Machine
from tests.shared import account_closes, codec_without_latest
from tests.waiting import moments

pytestmark = pytest.mark.live

SENDERS = 5  # four tasks and an interrupt
COMMAND_BYTES = 19


def pattern(sender: int, count: int, place: int) -> int:
    """As the program has it."""
    x = (count * 2654435761 + sender * 40503 + place * 977) & 0xFFFFFFFF
    return (x ^ x >> 15) & 0xFFFF


def sender_and_count(message: wirebond.Message) -> tuple[int, int]:
    """Return the sender, and the number of its message. AssertionError if the other fields do not agree with them."""
    fields: dict[str, Any] = message.fields
    match message.name:
        case "field_msg":
            sender, count = fields["game_state"], fields["remain_time"] + (fields["bullet_remain"] << 16)
            found, flag = [*fields["red_hp"], *fields["blue_hp"]], bool(count % 2)
            assert (fields["in_combat"], fields["shooter_locked"]) == (flag, flag)
        case "sentry_gimbal_msg":
            sender, count = fields["cur_cv_mode"], int(fields["bullet_speed"])
            found = [*fields["small_q"], *fields["big_q"]]
        case "gimbal_msg":
            sender, count, found = fields["cur_cv_mode"], int(fields["bullet_speed"]), fields["q"]
        case _:
            sender, count, found = int(fields["x_vel"]), int(fields["y_vel"]), [fields["w_vel"]]
    assert list(found) == [pattern(sender, count, place) for place in range(len(found))], message
    return sender, count


def talk(link: wirebond.Link, commands: int, expected: int) -> Iterator[wirebond.Message]:
    """Send the commands, and give what comes meanwhile until this many messages have come."""
    sent = received = 0
    while sent < commands or received < expected:
        before = sent + received
        for _ in moments(f"{received} of {expected} messages came, {sent} of {commands} commands are sent"):
            messages = link.receive(0.01)
            received += len(messages)
            with suppress(wirebond.QueueFullError):  # the line is slower than this loop
                for _ in range(min(20, commands - sent)):
                    link.send("chassis_cmd", x_vel=float(sent), y_vel=2.0 * sent, w_vel=0.0)
                    sent += 1
            if sent + received != before:
                break
        yield from messages


@pytest.mark.parametrize(
    ("frames", "commands"),
    [pytest.param(1_000, 800, id="short"), pytest.param(50_000, 40_000, id="long", marks=pytest.mark.long)],
)
def test_frames_of_four_tasks_and_an_interrupt_arrive_once_and_in_order(frames: int, commands: int) -> None:
    program = build(HERE / "programs" / "senders.cpp", "enterprize", definitions=[f"FRAMES={frames}U"])
    with (
        Machine(program) as machine,
        wirebond.open(without_silence(codec_without_latest("enterprize")), machine.ports[0]) as link,
    ):
        arrived: Counter[int] = Counter()
        for message in talk(link, commands, SENDERS * frames):
            sender, count = sender_and_count(message)
            assert count == arrived[sender], f"of sender {sender}; {link.stats}"
            arrived[sender] += 1
        link.send("chassis_cmd", x_vel=-1.0, y_vel=0.0, w_vel=0.0)
        report = machine.report()
        assert link.receive(0.1) == []
        stats = link.stats
    assert arrived == dict.fromkeys(range(SENDERS), frames)
    assert report["accepted"] == report["accepted by the senders' count"] == report["sent"] == SENDERS * frames
    assert report["refused"] == report["refused by the senders' count"] > 0, "the line was not full"
    assert report["offered"] == report["accepted"] + report["refused"]
    assert (report["queued"], report["aborted"]) == (0, 0)
    assert stats.receive.frames == SENDERS * frames
    assert stats.receive.bytes == stats.receive.frame_bytes
    assert account_closes(stats.receive)
    assert stats.dropped_messages == 0
    assert (report["commands"], report["commands out of order"]) == (commands, 0)
    assert report["bytes"] == report["bytes in frames"] == (commands + 1) * COMMAND_BYTES
    assert stats.send.sent == commands + 1
    assert report["bytes lapped"] == 0
    assert report["bytes dropped"] == report["laps unknown"] == 0
    assert report["nested polls"] == 0
