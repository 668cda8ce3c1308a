"""Measures the bridge to ROS 2: its processor time, its losses, and the delay from a message to its topic.

Two ptys are joined by `wirebond wire` at the 2 Mbaud of the protocol file (8N2): 8 000 `chassis_msg` a second are 84 %
of it, and five commands 1 600 times a second each 89 %. At one end a process is the MCU, which writes and counts. The
bridge owns the other end. A third process is the ROS 2 network: it takes the topic and
publishes the commands. The latency of a message is the time from its stamp, which is that of the read that completed
it, to the program that takes the topic.

The bridge is measured as `wirebond serve --ros2` runs it, over DDS, and as the package `wirebond_ros` runs it over
rclpy, where there is one.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.ros2.over_rclpy import find_rclpy

from bench import every_command
from bench.figures import Figure
from bench.serve import line, process, processor_time, say
from wirebond.sim.wire.process import LineShape, WireProcess, WireSettings

SECONDS = 8.0
PER_MS = 8
PER_MS_LOADED = 1  # beside other programs two processors do not carry eight: the line itself is simulated
COMMAND = "make bench ONLY=ros2"
DOMAIN = 97
OVER_DDS = (
    "ros2_lost",
    "ros2_cpu",
    "ros2_latency_p99_ms",
    "ros2_latency_p99_ms_loaded",
    "ros2_waits_for_a_core_loaded",
    "ros2_latency_p99_ms_priority",
)
OVER_RCLPY = (
    "ros2_lost_rclpy",
    "ros2_cpu_rclpy",
    "ros2_latency_p99_ms_rclpy",
    "ros2_latency_p99_ms_rclpy_loaded",
    "ros2_waits_for_a_core_rclpy_loaded",
    "ros2_latency_p99_ms_rclpy_priority",
)
Bridging = Callable[..., AbstractContextManager[subprocess.Popen[str]]]

FEEDER = """
import os, select, sys, time, tty, wirebond
path, port, seconds, per_ms = sys.argv[1], sys.argv[2], float(sys.argv[3]), int(sys.argv[4])
proto = wirebond.load(path)
heard = proto.decoder("host")
line = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
tty.setraw(line)
print("ready", flush=True)
sys.stdin.readline()
frames = [proto.encode("chassis_msg", x_vel=n, y_vel=0.5, w_vel=0.25) for n in range(1000)]
number, waiting, began = 0, b"", time.monotonic()
end = began + seconds + 2
while (now := time.monotonic()) < end:
    due = int(min(now - began, seconds) * 1000) * per_ms
    if number < due:
        waiting += b"".join(frames[n % 1000] for n in range(number, due))
        number = due
    if waiting:
        try:
            waiting = waiting[os.write(line, waiting):]
        except BlockingIOError:
            pass  # the line is slower than this process was late
    if select.select([line], [], [], 0.0005)[0]:
        heard.feed(os.read(line, 65536), now)
print(number, len(waiting), heard.stats.frames, flush=True)
"""

BRIDGE = """
import sys, threading, wirebond
from wirebond.ros2.bridge import Bridge
from wirebond.ros2.dds import DdsNode
from wirebond.ros2.mapping import load_mapping
with wirebond.open(sys.argv[1], sys.argv[2]) as link:
    node = DdsNode("bench")
    bridge = Bridge(link, node, load_mapping(sys.argv[3], link.codec.model))
    thread = threading.Thread(target=bridge.run)
    thread.start()
    print("ready", flush=True)
    thread.join()
"""

NETWORK = """
import sys, time
from cyclonedds._clayer import ddspy_take, ddspy_write
from wirebond.ros2.cdr import decode, encode
from wirebond.ros2.dds import DdsNode
from wirebond.ros2.node import Qos
from wirebond.ros2.types import ros_type
seconds, per_ms, topics = float(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]
node, late = DdsNode("network"), []
twist, vector = ros_type("geometry_msgs/TwistStamped"), ros_type("geometry_msgs/Vector3")
node.subscribe("/chassis", twist, Qos(depth=10000), None)
reader = node._readers.pop().entity
writers = [node.publisher(f"/{topic}", vector, Qos(depth=10000)) for topic in topics]
data = encode(vector, {"x": 0.5, "y": 0.25, "z": 1.0})
while not (reader.get_matched_publications() and all(w.entity.get_matched_subscriptions() for w in writers)):
    time.sleep(0.05)
time.sleep(1)  # the other side has found these, too
print("ready", flush=True)
sys.stdin.readline()
number, began, total = 0, time.monotonic(), int(1000 * seconds) * per_ms
turn, end = began, began + seconds + 1
while (now := time.monotonic()) < end:
    due = min(int((now - began) * 1000) * per_ms, total, number + 2 * per_ms)
    if now < turn:
        due = number
    elif due > number:  # who was late catches up at twice the rate, not at once
        turn, end = now + 0.001, max(end, now + 1)
    while number < due:
        writers[number % len(writers)].publish_encoded((data,))  # each alone, as programs of ROS publish
        number += 1
    for sample, _ in ddspy_take(reader._ref, 0x7F, 1000):
        stamp = int.from_bytes(sample[4:8], "little") + int.from_bytes(sample[8:12], "little") * 1e-9
        late.append(time.time() - stamp)
    time.sleep(0.0003)
late.sort()
print(len(late), late[len(late) // 2], late[len(late) * 99 // 100], number, flush=True)
"""

MAPPING = """
wirebond_ros2: 1
json_topics: none
publish:
  - message: chassis_msg
    topic: chassis
    type: geometry_msgs/TwistStamped
    frame: base_link
    qos: {{depth: 10000}}
    fields: {{twist.linear.x: x_vel, twist.linear.y: y_vel, twist.angular.z: w_vel}}
subscribe:
{commands}
"""
FIELDS = {
    "gimbal_cmd": "target_pitch: x, target_yaw: y, shoot_mode: 1",
    "chassis_cmd": "x_vel: x, y_vel: y, w_vel: z",
    "action_cmd": "scan: true, spin_vel: x, cv_enable: true",
    "sentry_gimbal_cmd": "l_target_pitch: x, l_target_yaw: y, l_shoot_mode: 1, r_target_pitch: x, r_target_yaw: y, "
    "r_shoot_mode: 1, main_target_pitch: x, main_target_yaw: z",
    "sentry_cv_cmd": "target_pitch: x, target_yaw: y, shoot_mode: 1, main_yaw_target: z",
}


def measure() -> list[Figure]:
    os.environ.update(ROS_DOMAIN_ID=str(DOMAIN), ROS_LOCALHOST_ONLY="1")
    figures = [*figures_of(OVER_DDS, (0, 50, 5), over_dds)]
    environment = find_rclpy()
    if environment is not None:
        figures += figures_of(OVER_RCLPY, (None, None, None), lambda *files: over_rclpy(environment, *files))
    return figures


def figures_of(keys: tuple[str, ...], goals: tuple[float | None, ...], bridging: Bridging) -> Iterator[Figure]:
    """With the computer to itself, and beside a busy program for each processor, without and with priority."""
    alone = run(SECONDS, PER_MS, bridging)
    yield Figure(keys[0], alone.lost, "messages", goals[0], COMMAND)
    yield Figure(keys[1], 100 * alone.spent, "% of a core", goals[1], COMMAND)
    yield Figure(keys[2], 1e3 * alone.late, "ms", goals[2], COMMAND)
    with ExitStack() as stack:
        for _ in range(os.cpu_count() or 1):
            stack.enter_context(process([sys.executable, "-c", "while True: pass"]))
        loaded = run(SECONDS, PER_MS_LOADED, bridging)
        yield Figure(keys[3], 1e3 * loaded.late, "ms", None, COMMAND)
        yield Figure(keys[4], 100 * loaded.waited, "% of the time", None, COMMAND)
        if may_have_priority():
            first = run(SECONDS, PER_MS_LOADED, bridging, has_priority=True)
            yield Figure(keys[5], 1e3 * first.late, "ms", None, COMMAND)


@contextmanager
def over_dds(*files: str) -> Iterator[subprocess.Popen[str]]:
    with process([sys.executable, "-c", BRIDGE, *files]) as bridge:
        line(bridge)
        yield bridge


@contextmanager
def over_rclpy(environment: dict[str, str], *files: str) -> Iterator[subprocess.Popen[str]]:
    """Run the bridge in rclpy. It may not run yet: wait for its topics."""
    names = ("protocol", "port", "mapping")
    given = [word for name, value in zip(names, files, strict=True) for word in ("-p", f"{name}:={value}")]
    with process([sys.executable, "-m", "wirebond_ros.bridge", "--ros-args", *given], environment) as bridge:
        yield bridge


@dataclass(frozen=True)
class Run:
    """One measurement.

    :ivar spent: the share of a core that the bridge took.
    :ivar waited: the share of the time that the bridge's threads were ready to run and had no core, all together.
    :ivar lost: messages of both directions.
    :ivar late: the 99th percentile of the latency, in seconds.
    """

    spent: float
    waited: float
    lost: int
    late: float


def run(seconds: float, per_ms: int, bridging: Bridging, *, has_priority: bool = False) -> Run:
    """``has_priority``: the processes of the measurement go before all others of the computer."""
    command = "  - {{topic: {0}, type: geometry_msgs/Vector3, message: {0}, qos: {{depth: 10000}}, fields: {{{1}}}}}"
    commands = "\n".join(command.format(name, fields) for name, fields in FIELDS.items())
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        protocol = Path(folder) / "every_command.yaml"
        protocol.write_text(every_command.text(), encoding="utf-8")
        mapping = Path(folder) / "mapping.yaml"
        mapping.write_text(MAPPING.format(commands=commands))
        numbers = [str(seconds), str(per_ms)]
        wire = stack.enter_context(WireProcess(WireSettings(baud=2_000_000, line=LineShape(stop_bits=2))))
        feed = stack.enter_context(process([sys.executable, "-c", FEEDER, str(protocol), wire.a, *numbers]))
        line(feed)
        bridge = stack.enter_context(bridging(str(protocol), wire.b, str(mapping)))
        network = stack.enter_context(process([sys.executable, "-c", NETWORK, *numbers, *FIELDS]))
        line(network)
        if has_priority:
            for each in (wire, feed, bridge, network):
                give_priority(each.pid)
        before, waited = processor_time(bridge.pid), waiting_time(bridge.pid)
        say(network)
        say(feed)
        taken, _, late, published = line(network).split()
        spent, waited = processor_time(bridge.pid) - before, waiting_time(bridge.pid) - waited
        fed, unwritten, heard = map(int, line(feed).split())
        if unwritten:
            raise RuntimeError("the line did not carry in time what the MCU wrote")
        return Run(spent / seconds, waited / seconds, fed - int(taken) + int(published) - heard, float(late))


def waiting_time(pid: int) -> float:
    """Seconds that its threads were ready to run, and another program had the core: /proc/PID/task/TID/schedstat."""
    files = Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(int(file.read_text().split()[1]) for file in files) * 1e-9


def give_priority(pid: int) -> None:
    """To all its threads, as ``chrt --all-tasks --rr --pid 10 PID`` does."""
    for task in Path(f"/proc/{pid}/task").iterdir():
        os.sched_setscheduler(int(task.name), os.SCHED_RR, os.sched_param(10))


def may_have_priority() -> bool:
    """Does the system let this user do that?"""
    with process([sys.executable, "-c", "input()"]) as probe:
        try:
            give_priority(probe.pid)
        except PermissionError:
            return False
    return True
