"""Commands that hold a port open: monitor, send, sim. Loops with a clock; what they show is made elsewhere."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.text import Text

from wirebond.analysis.diagnosis import diagnose
from wirebond.analysis.diagnosis.live import LiveDiagnosis
from wirebond.cli.commands.dump import save
from wirebond.cli.commands.files import find_message
from wirebond.cli.dashboard import Dashboard
from wirebond.cli.output import ReaderGone, console, errors, plain, warn, write
from wirebond.cli.picture import picture
from wirebond.cli.rounds import paced, time_left
from wirebond.cli.shown import log_text, print_message, rates_line, stats_line, title_of, values_text
from wirebond.cli.signals import ended_by_signals
from wirebond.cli.values import parse_addresses, parse_assignments, parse_header, to_json
from wirebond.codec import Codec, Message, load
from wirebond.errors import LinkDownError, MessageError, QueueFullError, UsageError
from wirebond.link import Link, open_link
from wirebond.link.arrivals import Arrivals
from wirebond.link.line import Line
from wirebond.link.peer import Peer
from wirebond.link.rates import LONGEST_WINDOW
from wirebond.link.stamps import has_stamps
from wirebond.protocol.counter_values import McuCounters
from wirebond.protocol.model import End
from wirebond.protocol.planning import plan_for
from wirebond.sim.pty_port import PtyPort, run, symlinked
from wirebond.sim.script import Behaviour
from wirebond.sim.virtual_mcu import VirtualMcu

_MOST_DRIFT = 20_000  # parts per million, of a virtual MCU's clock: a poor RC oscillator
_REFRESH = 0.1  # seconds between two pictures
_REPLY_WAIT = 1.0  # seconds
_HELLO_WAIT = 0.3  # seconds for the MCU to say which protocol it has


@contextmanager
def _ctrl_c_ends() -> Iterator[None]:
    """End without an error on Ctrl-C, on SIGTERM, or if the reader of the output has left."""
    with suppress(KeyboardInterrupt, ReaderGone):
        yield


def monitor_port(
    path: Path,
    port: str,
    baud: int | None,
    seconds: float | None,
    as_json: bool,
    waits: bool,
    role: str,
    dump_on_exit: Path | None = None,
    is_verbose: bool = False,
) -> None:
    # A viewer shows everything: what is late, held back, or for others. It asks for the MCU's clock only where messages
    # have times of it.
    codec = load(path)
    with (
        ended_by_signals(),
        open_link(
            codec,
            port,
            baud,
            hold_back=False,
            listen="all",
            wait_for_port=waits,
            hello=role == End.HOST,
            clock_sync=role == End.HOST and has_stamps(codec),
            role=role,
        ) as link,
    ):
        with _ctrl_c_ends():
            if as_json or not console.is_terminal:
                _print_messages(link, seconds, as_json, is_verbose)
            else:
                _show_dashboard(link, f"{link.codec.name} on {port}", seconds)
        try:
            if dump_on_exit is not None:
                save(link, dump_on_exit)
        finally:  # a dump that cannot be written takes nothing from the account
            _tell_account(link, port)


def _tell_account(link: Link, port: str) -> None:
    for one in diagnose(link):
        errors.print(f"[yellow]diagnosis:[/] {plain(str(one))}")
    errors.print(rates_line(link.rates(LONGEST_WINDOW)))
    away = f"; {port} was away at the end" if link.state == "down" else ""
    stats = link.stats
    own = ""
    if link.codec.model.link.echo:
        own = f", {stats.echoed_bytes} own bytes came back, {stats.collisions} collisions"
    errors.print(stats_line(stats.receive) + own + away)


def _print_messages(link: Link, seconds: float | None, as_json: bool, is_verbose: bool) -> None:
    was_away = False
    watch = LiveDiagnosis(link) if as_json else None
    told: Peer | None = None
    shown: Line | None = None
    for left in time_left(seconds):
        is_away = link.state == "down"
        if is_away != was_away:
            waits = "" if _is_over(link) else ". Waiting for it."
            errors.print(f"{plain(link.why)}{waits}" if is_away else f"{plain(link.port)} is there")
            was_away = is_away
        line = link.line
        if is_verbose and line != shown and line is not None and not is_away:
            _show_line(link.port, line, as_json)
            shown = line
        if watch is not None and (found := watch.changed()) is not None:
            _print_event("diagnosis", {"found": [one.as_dict() for one in found]})
        peer = link.peer
        if peer.state == "different" and peer != told:
            warn(peer.why)
            told = peer
        came, is_over = False, _is_over(link)
        for message in link.receive(min(_REFRESH, left)):
            came = True
            if as_json:
                print_message(message, link.codec)
            else:
                console.print(one_line(message, link.codec), soft_wrap=True)
        if is_over and not came:
            return


def _is_over(link: Link) -> bool:
    """Return whether a replay has ended; it does not come back."""
    return link.port.startswith("replay:") and link.state == "down"


def _show_line(port: str, line: Line, as_json: bool) -> None:
    if as_json:
        _print_event("line", {"port": port, **line.as_dict()})
    else:
        errors.print(f"{plain(port)}: {plain(str(line))}")


def _print_event(event: str, what: dict[str, Any]) -> None:
    write(to_json({"t": round(time.monotonic(), 6), "event": event, **what}) + "\n")


def one_line(message: Message, codec: Codec) -> Text:
    text = Text(f"{message.t:.3f} ")
    line = codec.log_line(message)
    counters = codec.counters(message)
    if counters is not None:
        text.append(f"{title_of(message)}  {counters}")
    elif line is None:
        text.append(f"{title_of(message)}  {values_text(message.fields)}")
    else:
        header = values_text(message.header, between=", ")
        text.append(f"[{header}] " if header else "")
        text.append_text(log_text(line))
    return text.append("".join(f"  ({v})" for v in message.violations))


def _show_dashboard(link: Link, title: str, seconds: float | None) -> None:
    dashboard = Dashboard(link, title)
    watch = LiveDiagnosis(link)
    with picture(console, dashboard.render()) as draw:
        for left in time_left(seconds):
            is_over = _is_over(link)
            dashboard.update(found := list(link.receive(min(_REFRESH, left))))
            draw(dashboard.render(wrong=watch.found()))
            if is_over and not found:
                return


def send_message(
    path: Path,
    port: str,
    name: str,
    words: list[str],
    rate: float | None,
    baud: int | None,
    seconds: float | None,
    header_words: list[str],
    role: str,
    hands_over: bool = False,
) -> int:
    if role not in (End.HOST, End.MCU):
        raise UsageError(f"--role is {role}; expected host or mcu")
    if rate is not None and not 0 < rate <= 10_000:
        raise UsageError(f"--rate is {rate:g}; expected more than 0 and at most 10000 per second")
    codec = load(path)
    described = find_message(codec.model, name)
    if not described.sent_by(End(role)):
        raise MessageError(f"{name} is sent by the {described.sender}, not by the {role}")
    values = parse_assignments(described, words)
    header = parse_header(codec.model, header_words)
    whose = role if described.sender == End.BOTH else None
    frame = codec.encode(name, values, header=header, sender=whose)  # wrong values are refused before a port is touched
    if rate is None:
        with open_link(codec, port, baud, role=role) as link:
            code = _send_once(link, codec, name, values, header)
            _warn_of_peer(link, _HELLO_WAIT)
            if hands_over:
                link.hand_over()
            elif role == End.HOST and any(
                s.message == name and codec.encode(name, s.fields, header=header, sender=whose) != frame
                for s in codec.model.emergency_stop
            ):
                errors.print(
                    f"the safe value of {name} follows, because this program ends; --rate keeps the robot moving, and "
                    "--hand-over leaves it as it is"
                )
            return code
    with ended_by_signals(), open_link(codec, port, baud, role=role) as link:
        return _send_repeatedly(link, codec, name, values, header, rate, seconds, hands_over)


def _warn_of_peer(link: Link, wait: float) -> None:
    """Print one line if the MCU was built from another file. ``wait``: seconds for its hello."""
    end = time.monotonic() + wait
    says_hello = link.role == End.HOST and link.codec.model.service("hello") is not None
    while says_hello and link.peer.state == "unknown" and (left := end - time.monotonic()) > 0:
        link.receive(min(left, 0.01))
    if link.peer.state == "different":
        warn(link.peer.why)


def _send_once(link: Link, codec: Codec, name: str, values: dict[str, Any], header: dict[str, Any]) -> int:
    before = vars(link.stats.receive)
    link.send(name, values, header=header)
    reply = codec.model.message(name).reply
    if reply is None:
        return 0
    whom = _addressee(codec, link.role, header)
    if whom is not None and whom.is_broadcast:
        errors.print(f"{name} was sent to {whom.name}, the broadcast, which is not answered")
        return 0
    end = time.monotonic() + _REPLY_WAIT
    while (left := end - time.monotonic()) > 0:
        for message in link.receive(left):
            if message.name == reply:
                print_message(message, codec)
                return 0
    arrived = Arrivals.between(before, vars(link.stats.receive)).text
    meanwhile = f"in that time {arrived}" if arrived else "nothing arrived in that time"
    sent = f"{name} was sent{f' to {whom.name}' if whom else ''}"
    errors.print(f"{sent}; no {reply} came back within {_REPLY_WAIT:g} s; {meanwhile}")
    return 1


@dataclass(frozen=True)
class _Addressee:
    name: str  # such as "servo 3"
    is_broadcast: bool


def _addressee(codec: Codec, role: str, header: dict[str, Any]) -> _Addressee | None:
    """Return the addressee of a frame of this end with this header; None if frames have none."""
    plan = plan_for(codec.model, End(role))
    if plan.address is None:
        return None
    field = plan.header[plan.address]
    address = header.get(field.name, field.default(End(role)))
    return _Addressee(f"{field.name} {address}", address in field.broadcast)


def _send_repeatedly(
    link: Link,
    codec: Codec,
    name: str,
    values: dict[str, Any],
    header: dict[str, Any],
    rate: float,
    seconds: float | None,
    hands_over: bool,
) -> int:
    sent = missed = 0
    warned = False
    with _ctrl_c_ends():
        for _ in paced(rate, seconds):  # after a stall: no burst of old commands
            try:
                link.send(name, values, header=header)
                sent += 1
            except (LinkDownError, QueueFullError):
                missed += 1  # the port may come back, the line may catch up: go on
            if not warned and link.peer.state != "unknown":
                warned = True
                _warn_of_peer(link, 0.0)
    told = f"sent {name} {sent} times"
    last = ""
    if hands_over:
        with suppress(LinkDownError):
            link.hand_over()
    elif link.role == End.HOST and name in {stop.message for stop in codec.model.emergency_stop}:
        # Also while the port is away: it leaves if the port comes back in time.
        if (whom := _addressee(codec, link.role, header)) is not None:
            last = f"the safe value to {whom.name}"  # others are commanded by others
            link.internals.sender.end_safely(name, header)
        else:
            last = "the emergency stop"
            link.emergency_stop()
    is_away = link.state == "down"
    if last and not is_away:
        told += f", then {last}"
    if missed:
        told += f"; {missed} times the port was away or its queue full"
    if is_away:
        told += f"; {link.port} is away"
        told += f", and {last} could not be sent" if last else ""
    errors.print(told)
    return 3 if is_away else 0


def simulate(
    path: Path,
    link: Path | None,
    seconds: float | None,
    addresses: list[str],
    script: Path | None = None,
    with_stats: bool = False,
    clock_drift: float = 0.0,
) -> None:
    if not abs(clock_drift) <= _MOST_DRIFT:
        raise UsageError(
            f"--clock-drift is {clock_drift:g}; expected {-_MOST_DRIFT} to {_MOST_DRIFT} parts per million"
        )
    codec = load(path)
    behaviour = None if script is None else Behaviour(codec, script)
    played = parse_addresses(codec.model, addresses)
    mcu = VirtualMcu(codec, time.monotonic(), addresses=played, behaviour=behaviour, clock_drift=clock_drift)
    port = PtyPort()
    with symlinked(port.path, link) as name:
        console.print(name, soft_wrap=True)
        errors.print(f"virtual MCU for {codec.name} on {name}; Ctrl-C ends", style="dim")
        with ended_by_signals(), _ctrl_c_ends():
            end = math.inf if seconds is None else time.monotonic() + seconds
            run(mcu, port, end, lambda event: errors.print(escape(event)))
    port.close()
    refused = {"foreign": mcu.foreign, "held_back": mcu.held_back, "rejected": mcu.rejected}
    refused |= {"unread_bytes": port.lost_bytes}
    counters = McuCounters(mcu.counters)
    if with_stats:
        write(to_json({**mcu.account.as_dict(), **refused, "counters": counters.as_dict()}) + "\n")
        return
    told = [f"{count} {name.replace('_', ' ')}" for name, count in refused.items() if count]
    errors.print(", ".join([f"the MCU received {stats_line(mcu.account)}", *told]))
    errors.print(str(counters))
