"""``wirebond demo``: a simulated rover in a process of its own, opened through its tty and driven as a user would."""

from __future__ import annotations

import math
import time
from collections import deque
from dataclasses import dataclass

from rich.markup import escape

from wirebond.cli.commands.demo_rover import rover_program
from wirebond.cli.dashboard import Dashboard
from wirebond.cli.output import console
from wirebond.cli.picture import picture
from wirebond.cli.shown import stats_line, values_text
from wirebond.cli.signals import ended_by_signals
from wirebond.codec import Message, load
from wirebond.errors import LinkDownError
from wirebond.link import Link, open_link
from wirebond.paths import PAGE
from wirebond.sim import rover

_REFRESH = 0.1  # seconds between two pictures
_LAST_EVENTS = 5


@dataclass(frozen=True)
class Phase:
    """A part of the drive. ``linear`` None: the host says nothing, and the rover must stop by itself."""

    seconds: float
    text: str
    linear: float | None
    angular: float = 0.0
    estop: bool = False


DRIVE = (
    Phase(4.0, "driving straight on, 0.8 m/s", 0.8),
    Phase(4.0, "turning left", 0.6, 1.2),
    Phase(4.0, "turning right", 0.6, -1.2),
    Phase(4.5, "the host falls silent: stop after 1 s, safe mode after 3 s", None),
    Phase(3.0, "safe mode cleared by parameter, driving back", -0.5),
    Phase(2.5, "somebody presses the e-stop while the host goes on commanding", 0.8, estop=True),
)


class Driver:
    """Plays the drive over and over; renews the repeated commands within their lease."""

    def __init__(self, link: Link, process: rover.RoverProcess) -> None:
        self._link = link
        self._process = process
        self._index = -1
        self._phase_end = -math.inf

    @property
    def phase(self) -> Phase:
        return DRIVE[self._index % len(DRIVE)]

    def step(self, now: float) -> None:
        if now >= self._phase_end:
            self._begin(now)
        self._link.repeat("status_query", hold=2.0)
        if self.phase.linear is not None:
            self._link.repeat("velocity", linear=self.phase.linear, angular=self.phase.angular)

    def _begin(self, now: float) -> None:
        if self._index >= 0 and self.phase.estop:
            self._process.tell("estop off")
        self._index += 1
        self._phase_end = now + self.phase.seconds
        if self.phase.estop:
            self._process.tell("estop on")
        if self.phase.linear is None:
            self._link.stop_repeating("velocity")
            return
        try:
            self._link.send("parameter", name="clear_safe_mode", value=0)
        except LinkDownError:
            self._phase_end = now  # tried again at the next step


def run_demo(seconds: float | None, in_terminal: bool, open_browser: bool, ros2: bool) -> int:
    """Return the exit code: 1 when nothing was received."""
    if ros2:
        from wirebond.cli.commands.demo_ros2 import run_for_ros  # noqa: PLC0415 without --ros2 its packages are not loaded

        return run_for_ros(seconds, in_terminal, open_browser)
    if not in_terminal:
        if PAGE.is_dir():
            from wirebond.cli.commands.demo_console import run_in_console  # noqa: PLC0415 the terminal needs none of it

            return run_in_console(seconds, open_browser)
        console.print("the console's page was not built (that needs Node 20 or newer); so here is the terminal view")
    program = rover_program()
    codec = load(rover.protocol_file())
    with rover.RoverProcess(program) as process, ended_by_signals(), open_link(codec, process.port) as link:
        console.print(f"rover on {process.port}, protocol {codec.name}", style="dim", soft_wrap=True)
        began = time.monotonic()
        try:
            _drive(link, process, math.inf if seconds is None else began + seconds)
        except KeyboardInterrupt:
            console.print("ended by Ctrl-C or a signal", style="dim")
        return _summary(link, time.monotonic() - began)


def _drive(link: Link, process: rover.RoverProcess, end: float) -> None:
    dashboard = Dashboard(link, f"rover on {link.port}")
    driver = Driver(link, process)
    events: deque[str] = deque(maxlen=_LAST_EVENTS)
    last_line = 0.0
    with picture(console) as draw:
        while (now := time.monotonic()) < end:
            driver.step(now)
            messages = link.receive(min(_REFRESH, end - now))
            dashboard.update(messages)
            events.extend(process.events())
            if console.is_terminal:
                draw(dashboard.render(_note(driver, events)))
            elif now - last_line >= 1.0:  # into a file or a pipe: a line a second
                last_line = now
                console.print(_plain_line(driver, link, messages, events), soft_wrap=True)


def _note(driver: Driver, events: deque[str]) -> str:
    lines = [f"[bold cyan]now:[/] {escape(driver.phase.text)}"]
    lines += [f"[dim]rover says at {escape(event)}[/]" for event in events]
    return "\n".join(lines)


def _plain_line(driver: Driver, link: Link, messages: list[Message], events: deque[str]) -> str:
    last = f"{messages[-1].name} {values_text(messages[-1].fields)}" if messages else "nothing received"
    said = f"; rover: {events[-1]}" if events else ""
    return escape(f"{link.state}: {driver.phase.text}; {link.stats.receive.frames} frames, last {last}{said}")


def _summary(link: Link, elapsed: float) -> int:
    stats = link.stats
    receive, send = stats.receive, stats.send
    bits = link.codec.model.link.bits_per_byte
    use = (count * bits / link.baud / elapsed for count in (receive.bytes, send.sent_bytes))
    console.print(f"[bold]{elapsed:.1f} s.[/] received {escape(stats_line(receive))}", soft_wrap=True)
    console.print(f"by message: {', '.join(f'{name} {count}' for name, count in receive.messages.items()) or 'none'}")
    console.print(
        f"sent {send.sent} frames of {send.offered} offered, {send.sent_bytes} bytes; refused "
        f"{send.refused_down + send.refused_full}, expired {send.expired}, replaced {send.replaced}"
    )
    received_use, sent_use = use
    console.print(
        f"line use: receive {received_use:.1%}, send {sent_use:.1%} of {link.baud} baud; reconnects {stats.reconnects}"
    )
    if not receive.frames:
        console.print("[bold red]nothing was received[/]")
        return 1
    return 0
