"""Services of ROS that become messages of the host: what the caller is told when it works, and when it does not."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import pytest

import wirebond
from tests.ros2.fake_node import FakeNode
from tests.ros2.over_rclpy import PACKAGE as ROS_PACKAGE
from tests.ros2.test_rosidl import share_folder
from tests.waiting import PATIENCE, wait_until
from wirebond.errors import ProtocolFileError
from wirebond.protocol import loads
from wirebond.ros2.bridge import Bridge
from wirebond.ros2.mapping import read_mapping
from wirebond.ros2.types import SERVICE_NAMES, service_type
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

TEXT = """
wirebond: 1
protocol: cart
frame: [magic: 0xAA, length: u8, id: u8, payload: by_length, check: crc-16/mcrf4xx]
messages:
  enable: {id: 1, sender: host, reply: enabled, fields: {on: {type: bool}}}
  enabled: {id: 2, sender: mcu, fields: {on: {type: bool}, result: {type: u8, enum: {ok: 0, too_hot: 1}}}}
  home: {id: 3, sender: host, fields: {side: {type: u8, enum: {left: 0, right: 1}}, speed: {type: f32, range: [0, 1]}}}
  ticks: {id: 4, sender: mcu, fields: {left: {type: i16}, right: {type: i16}}}
deadlines: [{message: ticks, at: host, after: 60 s, then: lost, recover: explicit}]
emergency_stop: {message: enable, on: false}
"""
CART = wirebond.Codec(loads(TEXT))
LOSES = wirebond.Codec(loads(TEXT.replace("after: 60 s", "after: 50 ms")))
MAPPING = """
wirebond_ros2: 1
services:
  - service: motors_enabled
    type: std_srvs/SetBool
    message: enable
    fields: {on: data}
    answer: {success: {from: result, values: {ok: true, too_hot: false}}, message: result}
    timeout: 60 s
  - {service: ~/enable, type: std_srvs/Trigger, message: enable, fields: {on: true}, timeout: 60 s}
  - {service: hasty, type: std_srvs/Trigger, message: enable, fields: {on: true}, timeout: 300 ms}
  - service: home
    type: std_srvs/SetBool
    message: home
    fields: {side: {from: data, values: {true: left, false: right}}, speed: 0.5}
  - {service: fast, type: std_srvs/Trigger, message: home, fields: {side: {text: left}, speed: 2.0}}
  - {service: quiet, type: std_srvs/Empty, message: enable, fields: {on: true}, timeout: 300 ms}
  - {service: go_on, type: std_srvs/Trigger, recover: lost}
odometry:
  message: ticks
  left: left
  right: right
  wheel_radius: 0.05
  wheel_separation: 0.3
  ticks_per_turn: 100
  reset: reset_odometry
navigation: {deadline: lost}
"""


class Cart:
    """A bridge with services, and an MCU that answers while ``result`` is not empty."""

    def __init__(self, codec: wirebond.Codec = CART) -> None:
        self.line, self.node = PtyPort(), FakeNode()
        self.result: Any = "ok"
        self.heard: list[wirebond.Message] = []
        self._over = threading.Event()
        self._mcu = threading.Thread(target=self._answer, daemon=True)
        self._mcu.start()
        self.link = wirebond.open(codec, self.line.path)
        self.bridge = Bridge(self.link, self.node, read_mapping(MAPPING, codec.model))
        self._thread = threading.Thread(target=self.bridge.run, daemon=True)
        self._thread.start()
        self.node.is_started.wait(PATIENCE)

    def _answer(self) -> None:
        decoder = CART.decoder("host")
        while not self._over.is_set():
            for message in decoder.feed(self.line.read(0.02), t=0.0):
                self.heard.append(message)
                if message.name == "enable" and self.result:
                    self.line.write(CART.encode("enabled", on=message["on"], result=self.result))

    def moves(self) -> None:
        """Its wheels turn, and the bridge has seen it."""
        before = len(self.node.published["/odom"])
        self.line.write(CART.encode("ticks", left=10, right=10))
        self.node.wait(lambda: len(self.node.published["/odom"]) > before)
        self.node.wait(lambda: (self.node.newest("/navigation_ok") or {}).get("data"))

    def call(self, service: str, **request: Any) -> tuple[bool, str]:
        response = self.node.answer[service](request)
        return response["success"], response["message"]

    def close(self) -> None:
        self.bridge.close()
        self._thread.join(PATIENCE)
        self.link.close()
        self._over.set()
        self._mcu.join(PATIENCE)
        self.line.close()


@pytest.fixture(scope="module")
def cart() -> Iterator[Cart]:
    made = Cart()
    yield made
    made.close()


@pytest.fixture(autouse=True)
def ready(cart: Cart) -> None:
    cart.result = "ok"
    cart.heard.clear()
    cart.moves()


def test_reply_of_the_mcu_is_the_response(cart: Cart) -> None:
    assert cart.call("/motors_enabled", data=True) == (True, "ok")
    assert cart.heard[0].fields == {"on": True}
    cart.result = "too_hot"
    assert cart.call("/motors_enabled", data=True) == (False, "too_hot")
    assert cart.node.types["/motors_enabled"] == "std_srvs/SetBool"
    cart.node.wait(lambda: cart.node.published["/cart/enabled"])  # the reply is a message as any other


def test_without_an_answer_section_any_reply_is_a_success_and_is_reported(cart: Cart) -> None:
    assert cart.call("/cart/enable") == (True, 'enabled: {"on": true, "result": "ok"}')


def test_message_without_a_reply_is_a_success_once_it_is_sent(cart: Cart) -> None:
    for data, side in ((True, "left"), (False, "right")):
        assert cart.call("/home", data=data) == (True, "home was sent; the protocol has no reply to it")
        wait_until(
            lambda side=side: any(m.fields == {"side": side, "speed": 0.5} for m in cart.heard), f"home to the {side}"
        )


def test_missing_reply_is_reported_and_counted(cart: Cart) -> None:
    cart.result = ""
    success, message = cart.call("/hasty")
    assert not success
    assert message.startswith(
        (
            "no enabled within 0.3 s of enable; nothing arrived in that time. ",
            "no enabled within 0.3 s of enable. Nothing at all comes; ",  # after a pause of the machine
        )
    )
    assert cart.bridge.commands.counts["unanswered"] == 1
    assert cart.node.answer["/quiet"]({}) == {
        "structure_needs_at_least_one_member": 0
    }  # it has no place for the reason


def test_value_out_of_its_range_is_refused(cart: Cart) -> None:
    refused = cart.bridge.commands.counts["refused"]
    assert cart.call("/fast") == (False, "speed = 2 is outside 0 ... 1")
    assert cart.bridge.commands.counts["refused"] == refused + 1


def test_emergency_stop_refuses_what_would_move(cart: Cart) -> None:
    cart.link.emergency_stop()
    try:
        success, message = cart.call("/motors_enabled", data=True)
    finally:
        cart.link.release_stop()
    assert not success
    assert "emergency stop" in message


def test_deadline_is_over_by_a_call() -> None:
    cart = Cart(LOSES)
    try:
        cart.node.wait(lambda: ("warning", "lost: no ticks for 0.05 s") in cart.node.lines)
        assert cart.call("/go_on") == (True, "lost is over")
    finally:
        cart.close()


def test_moving_requests_are_refused_while_navigation_is_stopped(cart: Cart) -> None:
    cart.bridge.commands.stop("navigation is stopped, because there was no ticks for 60 s")
    try:
        assert cart.call("/motors_enabled", data=True) == (False, cart.bridge.commands.why_stopped)
        assert cart.call("/home", data=True)[0]  # it is not of the emergency stop
    finally:
        cart.bridge.commands.resume()


def test_pose_begins_at_zero_again(cart: Cart) -> None:
    assert cart.call("/reset_odometry") == (True, "the pose begins at zero again")
    cart.moves()
    assert cart.node.published["/odom"][-1]["pose"]["pose"]["position"]["x"] == pytest.approx(0.0314, abs=1e-4)


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        ("type: std_srvs/Trigger", "a service needs either `message` or `recover`; write one of them"),
        ("type: std_srvs/Trigger, message: enable, recover: lost", "a service needs either `message` or `recover`"),
        (
            "type: std_srvs/Toggle, message: enable",
            "`std_srvs/Toggle` is not possible here; did you mean `std_srvs/Trigger`?",
        ),
        ("type: std_srvs/Trigger, message: enable", "enable needs on, without a default; map it here"),
        ("type: std_srvs/Trigger, message: ticks", "ticks is not sent by the host"),
        (
            "type: std_srvs/SetBool, message: enable, fields: {on: date}",
            "std_srvs/SetBool_Request has no field `date`; did you mean `data`?",
        ),
        (
            "type: std_srvs/SetBool, message: home, "
            "fields: {side: {from: data, values: {true: up, false: left}}, speed: 0}",
            "there is no constant `up` for side; possible: left, right",
        ),
        (
            "type: std_srvs/Trigger, message: home, fields: {side: {text: left}, speed: 0}, timeout: 1 s",
            "home has no `reply` in the protocol file; remove this key",
        ),
        (
            "type: std_srvs/Trigger, message: enable, fields: {on: true}, answer: {succes: on}",
            "std_srvs/Trigger_Response has no field `succes`; did you mean `success`?",
        ),
        (
            "type: std_srvs/Trigger, message: enable, fields: {on: true}, answer: {success: result}",
            "result is a name, and success takes true or false",
        ),
        (
            "type: std_srvs/Empty, message: enable, fields: {on: true}, answer: {success: on}",
            "std_srvs/Empty answers nothing; take std_srvs/Trigger, or remove this key",
        ),
        (
            "type: std_srvs/Trigger, message: enable, fields: {on: true}, timeout: 61 s",
            "a call waits for 60 s at most; write less, such as 500 ms",
        ),
        ("type: std_srvs/Trigger, recover: lots", "the host has no deadline `lots`; did you mean `lost`?"),
        ("type: std_srvs/Trigger, recover: lost, timeout: 1 s", "`recover` sends no message; remove this key"),
        ("type: std_srvs/SetBool, recover: lost", "`recover` needs no true or false; write std_srvs/Trigger"),
    ],
)
def test_a_mistake_has_its_place(entry: str, sentence: str) -> None:
    with pytest.raises(ProtocolFileError) as caught:
        read_mapping(f"wirebond_ros2: 1\nservices:\n  - {{service: x, {entry}}}\n", CART.model)
    assert sentence in str(caught.value)
    assert caught.value.problems[0].line == 3


def test_types_are_those_of_ros() -> None:
    for name in (*SERVICE_NAMES, "action_msgs/CancelGoal"):
        type_ = service_type(name)
        assert type_ is not None
        package, last = name.split("/")
        text = (share_folder() / package / "srv" / f"{last}.json").read_text()
        for half in (type_.request, type_.response):
            assert f'"{half.name}",' in text
            assert f'"{half.hash}"' in text


def test_package_depends_on_them() -> None:
    assert "<exec_depend>std_srvs</exec_depend>" in (ROS_PACKAGE / "package.xml").read_text()
