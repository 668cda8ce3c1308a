"""``wirebond demo --ros2``: the simulated rover as a node of ROS 2, which programs of ROS drive."""

from __future__ import annotations

import math
import tempfile
import time
from contextlib import ExitStack, suppress
from pathlib import Path

from wirebond.cli.commands.demo_rover import rover_program
from wirebond.cli.output import console as terminal
from wirebond.cli.output import plain
from wirebond.cli.signals import ended_by_signals
from wirebond.cli.web import show
from wirebond.codec import load
from wirebond.errors import WirebondError
from wirebond.link import open_link
from wirebond.paths import PAGE
from wirebond.ros2.serving import bridge_to, mapping_for
from wirebond.server import Server
from wirebond.sim import rover

_LOOK = 0.1  # seconds between two checks of the rover and of the bridge


def run_for_ros(seconds: float | None, in_terminal: bool, open_browser: bool) -> int:
    """Run until the time is over, or Ctrl-C; return the exit code. Nothing drives the rover but ROS and the console's
    user.

    :raises UsageError: what ROS 2 needs is not installed.
    :raises WirebondError: the bridge has failed.
    """
    codec = load(rover.protocol_file())
    mapping = mapping_for(codec, None)
    program = rover_program()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="wirebond-demo-")))
        process = stack.enter_context(rover.RoverProcess(program))
        stack.enter_context(ended_by_signals())
        own = stack.enter_context(open_link(codec, process.port))
        server = stack.enter_context(Server(own, folder / "rover.sock", recordings=folder / "recordings"))
        if PAGE.is_dir() and not in_terminal:
            from wirebond.cli.commands.demo_console import console_of_demo  # noqa: PLC0415 the terminal needs none of it

            console = stack.enter_context(console_of_demo())
            console.show(own, server)
            show(console, open_browser)
        bridge = stack.enter_context(bridge_to(f"wirebond://{folder}/rover.sock", mapping))
        node = f"{mapping.namespace.rstrip('/')}/{mapping.node}"
        terminal.print(
            f"rover on {plain(process.port)}, ROS 2 node [bold]{node}[/]. It does not move until ROS drives it:"
        )
        for line in _COMMANDS:
            terminal.print(f"  {line.format(node=node)}", markup=False, highlight=False, soft_wrap=True)
        end = math.inf if seconds is None else time.monotonic() + seconds
        with suppress(KeyboardInterrupt):
            while (left := end - time.monotonic()) > 0:
                if bridge.node.failure.why:
                    raise WirebondError(f"the bridge to ROS 2 ends, and the demo with it: {bridge.node.failure.why}")
                for event in process.events():
                    terminal.print(f"the rover reports at {event}", markup=False)
                time.sleep(min(left, _LOOK))
        return 0 if own.stats.receive.frames else 1


_COMMANDS = (
    "ros2 topic echo /odom",
    'ros2 topic pub -r 10 /cmd_vel geometry_msgs/msg/Twist "{{linear: {{x: 0.3}}, angular: {{z: 0.5}}}}"',
    "ros2 topic pub --once {node}/recover std_msgs/msg/Empty    # after a pause of 3 s, which ends in safe mode",
)
