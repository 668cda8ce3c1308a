"""Services over DDS: the bytes that leave, and what is said where they cannot work. Calls are in `test_rover`."""

from __future__ import annotations

import logging

import pytest
from cyclonedds._clayer import ddspy_take
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from tests.ros2.domains import own_domain
from tests.ros2.peer import wait
from wirebond.ros2.dds import LOOPBACK, DdsNode
from wirebond.ros2.dds_services import any_bytes
from wirebond.ros2.types import service_type

pytestmark = pytest.mark.live


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> int:
    number = own_domain()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.delenv("RMW_IMPLEMENTATION", raising=False)
    return number


def test_services_that_cannot_be_offered_are_reported(domain: int, caplog: pytest.LogCaptureFixture) -> None:
    node, type_ = DdsNode("base"), service_type("std_srvs/Trigger")
    assert type_ is not None
    for name in ("/recover", "/reset"):
        node.serve(name, type_, lambda request: request)
    node.canceller("/navigate_to_pose")()
    with caplog.at_level(logging.WARNING, "wirebond.ros2"):
        node.start()
    node.close()
    (line,) = caplog.messages
    assert line.startswith("services are not offered: /recover, /reset. Without ROS they work with rmw_cyclonedds_cpp")


def test_goals_of_an_action_are_cancelled(domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
    type_, other = service_type("action_msgs/CancelGoal"), DomainParticipant(domain)
    assert type_ is not None
    topic = Topic(other, "rq/navigate_to_pose/_action/cancel_goalRequest", any_bytes(type_.request))
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))
    reader = DataReader(other, topic, qos)
    node = DdsNode("base")
    cancel = node.canceller("/navigate_to_pose")
    wait(reader.get_matched_publications)
    cancel()
    ((data, _),) = wait(lambda: ddspy_take(reader._ref, 0x7F, 10))
    header, goal, stamp = bytes(16), bytes(16), bytes(8)  # neither a goal nor a time: all of them
    assert data == b"\0\1\0\0" + header + goal + stamp
    node.close()
