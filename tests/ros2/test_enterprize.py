"""Seed 000 whole: five commands at 1 kHz twice over, every message of the MCU as topics, all at once on one link.

The line is a pty that is read as fast as 2 Mbaud carry, at an eighth of all rates here; the engine's share is in
tests/link/test_latest.py.
"""

from __future__ import annotations

import math
import threading
from collections import Counter
from typing import Any

import pytest

import wirebond
from tests.ros2.fake_node import FakeNode
from tests.shared import PROTOCOLS
from tests.waiting import PATIENCE, Stopwatch, let_pass, rounds_for, wait_until
from wirebond.protocol import loads
from wirebond.ros2.bridge import Bridge
from wirebond.ros2.mapping import load_mapping
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

SLOW = 8
TEXT = (PROTOCOLS / "enterprize.yaml").read_text(encoding="utf-8")
CODEC = wirebond.Codec(loads(TEXT.replace("baud: 2000000", f"baud: {2_000_000 // SLOW}")))
MAPPING = load_mapping(PROTOCOLS / "ros2" / "enterprize.yaml", CODEC.model)
TURN = [math.cos(0.25), 0.0, 0.0, math.sin(0.25)]  # w, x, y, z: half a radian to the left
COMMANDS = {"/cmd_vel": "chassis_cmd"} | {
    f"/{name}": name for name in ("gimbal_cmd", "action_cmd", "sentry_gimbal_cmd", "sentry_cv_cmd")
}
SENT = {
    "gimbal_msg": {"cur_cv_mode": 1, "target_color": 0, "bullet_speed": 28.0, "q": TURN},
    "chassis_msg": {"x_vel": 0.5, "y_vel": 0.25, "w_vel": 1.0},
    "sentry_gimbal_msg": {"cur_cv_mode": 1, "target_color": 0, "bullet_speed": 1.0, "small_q": TURN, "big_q": TURN},
    "field_msg": {
        "game_state": 4, "remain_time": 300, "bullet_remain": 100, "team": 1, "red_hp": [500] * 8, "blue_hp": [400] * 8,
        "in_combat": True, "bullet_supply_available": False, "shooter_locked": False,
    },
}  # fmt: skip


class Board:
    """The MCU's end: it reads no faster than the line, and sends when it is told."""

    def __init__(self) -> None:
        self.line = PtyPort()
        self.heard: Counter[str] = Counter()
        self.newest: dict[str, Any] = {}
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        decoder = CODEC.decoder("host")
        while not self._closed.is_set():
            for message in decoder.feed(self.line.read(0.05), t=0.0):
                self.heard[message.name] += 1
                self.newest[message.name] = message.fields

    def close(self) -> None:
        self._closed.set()
        self._thread.join(PATIENCE)
        self.line.close()


@pytest.fixture
def board() -> Any:
    made = Board()
    yield made
    made.close()


def test_all_of_it_at_once_on_one_link(board: Board) -> None:
    node = FakeNode()
    frames = {name: CODEC.encode(name, values) for name, values in SENT.items()}
    with wirebond.open(CODEC, board.line.path) as link:
        bridge = Bridge(link, node, MAPPING)
        thread = threading.Thread(target=bridge.run, daemon=True)
        thread.start()
        node.is_started.wait(PATIENCE)
        sent, watch = 0, Stopwatch()
        for _ in rounds_for(0.8):
            due = min(int(watch.seconds * 2000 / SLOW), sent + 8)  # after a pause, too, no more than the pty holds
            for number in range(sent + 1, due + 1):
                for topic in COMMANDS:
                    node.take[topic](command(topic, number))
                board.line.write(b"".join(frames.values()))
            sent = max(sent, due)
            let_pass(0.001)

        def has_left() -> bool:
            send = link.stats.send
            return send.queued == 0 and sum(board.heard.values()) == send.sent

        wait_until(has_left, "all commands leave")
        send, counts = link.stats.send, bridge.commands.counts
        assert counts["sent"] == 5 * sent
        assert counts["refused"] == counts["clamped"] == 0
        assert send.offered == send.sent + send.replaced == 5 * sent
        assert send.replaced > 0  # ten thousand a second are 111 % of the line
        assert set(board.heard) == set(COMMANDS.values())
        assert board.newest["chassis_cmd"]["x_vel"] == sent
        assert board.newest["sentry_cv_cmd"]["target_pitch"] == sent
        topics = ("/chassis/twist", "/enterprize/gimbal_msg", "/enterprize/sentry_gimbal_msg", "/enterprize/field_msg")
        for topic in topics:
            node.wait(lambda topic=topic: len(node.published[topic]) == sent)
        node.wait(lambda: len(node.published["/tf"]) == 3 * sent)
        node.wait(lambda: node.published["/enterprize/latency"])
        assert 0 < node.published["/enterprize/latency"][0]["data"] < 3600
        bridge.close()
        thread.join(PATIENCE)

    now = node.now_ns() / 1e9
    for message in node.published["/tf"]:
        (transform,) = message["transforms"]
        stamp = transform["header"]["stamp"]
        assert abs(stamp["sec"] + stamp["nanosec"] / 1e9 - now) < 3600
    tree = {t["child_frame_id"]: t for m in node.published["/tf"] for t in m["transforms"]}
    assert set(tree) == {"gimbal", "big_gimbal", "small_gimbal"}
    assert tree["small_gimbal"]["header"]["frame_id"] == "big_gimbal"
    assert tree["gimbal"]["transform"]["rotation"]["z"] == pytest.approx(math.sin(0.25))
    assert node.published["/enterprize/field_msg"][0]["red_hp"] == (500,) * 8


def command(topic: str, number: int) -> dict[str, Any]:
    """One whose number the MCU will see."""
    if topic == "/cmd_vel":
        return {"linear": {"x": float(number)}}
    return {"target_pitch": float(number)} if topic == "/sentry_cv_cmd" else {}
