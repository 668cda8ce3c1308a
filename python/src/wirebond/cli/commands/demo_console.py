"""``wirebond demo`` in a browser: the simulated rover with a console, driven until a person takes over."""

from __future__ import annotations

import contextlib
import math
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from wirebond.cli.commands.demo import Driver
from wirebond.cli.commands.demo_rover import rover_program
from wirebond.cli.output import console as terminal
from wirebond.cli.output import errors
from wirebond.cli.signals import ended_by_signals
from wirebond.cli.web import show
from wirebond.codec import load
from wirebond.console import DEFAULT_PORT, Console
from wirebond.errors import LateCommandError, LinkDownError, NotInControlError, PortError, StoppedError
from wirebond.link import Link, open_link
from wirebond.link.attached.kept_token import kept_token
from wirebond.link.attached.words import Control
from wirebond.server import Server
from wirebond.sim import rover

_STEP = 0.1  # seconds between two steps of the drive


def run_in_console(seconds: float | None, open_browser: bool) -> int:
    """Run the demo in the console. Return the exit code: 1 if nothing was received."""
    program = rover_program()
    codec = load(rover.protocol_file())
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="wirebond-demo-")))
        process = stack.enter_context(rover.RoverProcess(program))
        stack.enter_context(ended_by_signals())
        own = stack.enter_context(open_link(codec, process.port))
        server = stack.enter_context(Server(own, folder / "rover.sock", recordings=folder / "recordings"))
        console = stack.enter_context(console_of_demo())
        console.show(own, server)
        terminal.print(f"rover on {process.port}, protocol {codec.name}", style="dim", soft_wrap=True)
        show(console, open_browser)
        end = math.inf if seconds is None else time.monotonic() + seconds
        with contextlib.suppress(KeyboardInterrupt), open_link(codec, f"wirebond://{folder}/rover.sock") as link:
            drive(link, process, end)
            while (left := end - time.monotonic()) > 0:
                time.sleep(min(left, _STEP))
        frames = own.stats.receive.frames
        terminal.print(f"received {frames} frames")
        return 0 if frames else 1


def console_of_demo() -> Console:
    """Open the console at the usual port; if another program has it, at any other."""
    token = kept_token()
    try:
        return Console(port=DEFAULT_PORT, token=token)
    except PortError:
        return Console(port=0, token=token)


def drive(link: Link, process: rover.RoverProcess, end: float) -> None:
    """Drive until the time is over, or a person has taken control or stopped the rover. It never drives again then."""
    driver = Driver(link, process)
    while time.monotonic() < end:
        try:
            driver.step(time.monotonic())
        except (NotInControlError, StoppedError) as error:
            if isinstance(error, NotInControlError) and link.control == Control():
                _take_again(link)  # this computer was busy, and the server heard nothing of the demo for 0.3 s
                continue
            errors.print("a person has control: the demo drives no more")
            process.tell("estop off")
            return
        except (LateCommandError, LinkDownError):
            pass  # this computer was busy: tried again at the next step
        process.events()
        time.sleep(_STEP)


def _take_again(link: Link) -> None:
    # A person was faster, or the server is busy: the next step sees that.
    with contextlib.suppress(NotInControlError, LateCommandError, LinkDownError):
        link.take_control()
