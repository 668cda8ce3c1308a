"""``wirebond serve``: own a port, and let other programs attach to its link."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from wirebond.cli.output import errors, plain
from wirebond.cli.rounds import time_left
from wirebond.cli.shown import stats_line
from wirebond.cli.shown_logs import shown_server_log
from wirebond.cli.signals import ended_by_signals
from wirebond.cli.web import show, web_address
from wirebond.codec import Codec, load
from wirebond.errors import UsageError, WirebondError
from wirebond.link import Link, open_link
from wirebond.link.attached.address import SCHEME, make_socket_folder, socket_of
from wirebond.link.attached.kept_token import kept_token
from wirebond.server import Server
from wirebond.server.owner import is_loopback
from wirebond.server.recordings import Recordings

if TYPE_CHECKING:
    from wirebond.console import Console
    from wirebond.ros2.failure import Failure
    from wirebond.ros2.mapping import BridgeMapping

_LOOK = 0.2  # seconds between two looks at the port and at who is in control


@dataclass(frozen=True)
class Serving:
    """What ``wirebond serve`` was given. ``path`` and ``port`` None: the page of the console chooses them."""

    path: Path | None
    port: str | None
    baud: int | None
    name: str | None
    tcp: str | None
    token: str | None
    listen: str
    record: Path | None
    recordings: Path | None
    web: str | None
    opens_browser: bool
    ros2: bool
    mapping: Path | None
    seconds: float | None


def serve_port(given: Serving) -> None:
    """Until the time is over, or Ctrl-C."""
    if given.path is None or given.port is None:
        _serve_page_alone(given)
        return
    codec = load(given.path)
    topics = _topics(codec, given.mapping) if given.ros2 or given.mapping is not None else None
    where = socket_of(given.name or codec.name)
    host = _host_and_port(given.tcp)
    web = None if given.web is None else web_address(given.web)
    make_socket_folder()
    with ended_by_signals(), shown_server_log(), ExitStack() as stack:
        link = stack.enter_context(open_link(codec, given.port, given.baud, listen=given.listen, wait_for_port=True))
        if given.record is not None:
            stack.enter_context(link.record(given.record))
        token = given.token if host is None else _token(given, host[0])
        server = stack.enter_context(Server(link, where, tcp=host, token=token, recordings=given.recordings))
        errors.print(
            f"{codec.name} on {plain(link.port)}. Attach with [bold]wirebond://{where.stem}[/]", soft_wrap=True
        )
        if host is not None:
            address = f"wirebond://{_shown(host[0])}:{server.port}"
            errors.print(f"From other programs by TCP: [bold]{address}?token={server.token}[/]", soft_wrap=True)
        now: Callable[[], tuple[Link, Server] | None] = lambda: (link, server)  # noqa: E731
        failure: Failure | None = None
        if web is not None:
            console = stack.enter_context(_console(web, given))
            console.show(link, server)
            show(console, given.opens_browser)
            now = lambda: _served(console)  # noqa: E731
        if topics is not None:
            from wirebond.ros2.serving import bridge_to  # noqa: PLC0415 without --ros2 its packages are not loaded

            bridge = stack.enter_context(bridge_to(f"{SCHEME}{where.absolute()}", topics))
            failure = bridge.node.failure
            source = f"by {topics.path}" if topics.path else "as JSON"
            errors.print(f"ROS 2 node [bold]{topics.namespace.rstrip('/')}/{topics.node}[/], {plain(source)}")
        try:
            _watch(now, given.seconds, failure)
        except KeyboardInterrupt:
            errors.print("ends: what is repeated ends with its safe value")
        errors.print(stats_line(link.stats.receive))
    _finish(server.recordings)


def _topics(codec: Codec, path: Path | None) -> BridgeMapping:
    from wirebond.ros2.serving import mapping_for  # noqa: PLC0415 without --ros2 its packages are not loaded

    return mapping_for(codec, path)


def _serve_page_alone(given: Serving) -> None:
    """The page chooses the port and the protocol."""
    if given.web is None or given.path is not None or given.tcp is not None or given.record is not None or given.ros2:
        raise UsageError("give FILE and PORT; without both, only --web is possible, where the page chooses them")
    with ended_by_signals(), shown_server_log(), _console(web_address(given.web), given) as console:
        show(console, given.opens_browser)
        with suppress(KeyboardInterrupt):
            _watch(lambda: _served(console), given.seconds)


def _console(address: tuple[str, int], given: Serving) -> Console:
    from wirebond.console import Console, Options  # noqa: PLC0415 without --web its packages are not loaded

    options = Options(given.name, given.recordings, given.listen, may_connect=True, may_save=given.path)
    return Console(*address, token=_token(given, address[0]), options=options)


def _token(given: Serving, host: str) -> str | None:
    """What was given. On this computer alone it stays the same when the server starts again; None: a new one."""
    return given.token or (kept_token() if is_loopback(host) else None)


def _served(console: Console) -> tuple[Link, Server] | None:
    served = console.station.served
    return None if served is None else (served.link, served.server)


def _finish(recordings: Recordings) -> None:
    """Wait until the recordings are compressed."""
    if not recordings.is_closing:
        return
    errors.print("compresses the recording; Ctrl-C leaves it whole, and larger")
    with ended_by_signals(), suppress(KeyboardInterrupt):
        recordings.wait()


def _watch(now: Callable[[], tuple[Link, Server] | None], seconds: float | None, bridge: Failure | None = None) -> None:
    """Print what changes. ``now``: what is served at that moment.

    :raises WirebondError: the bridge to ROS 2 has failed. Topics that stopped would look like a silent robot, so the
        server ends with an error, and what started it can start it again.
    """
    known: Link | None = None
    is_other = False  # not the one that the command line named
    was_away, holder, clients, stopped_by = False, None, 0, None
    for left in time_left(seconds):
        if bridge is not None and bridge.why:
            raise WirebondError(f"the bridge to ROS 2 ends, and the server with it: {bridge.why}")
        found = now()
        if found is None:
            known, is_other = None, True
            time.sleep(min(_LOOK, left))
            continue
        link, server = found
        is_other = is_other or known not in (None, link)
        if is_other and known is not link:
            was_away, holder, clients, stopped_by = False, None, 0, None
            errors.print(f"{link.codec.name} on {plain(link.port)}")
        known = link
        is_away = link.state == "down"
        if is_away != was_away:
            errors.print(f"{plain(link.why)}. Waiting for it." if is_away else f"{plain(link.port)} is there")
            was_away = is_away
        if (name := server.holder) != holder:
            errors.print("no program is in control" if name is None else f"{plain(name)} is in control")
            holder = name
        if (name := server.stopped_by) != stopped_by:
            errors.print("the emergency stop is released" if name is None else f"{plain(name)} stopped the robot")
            stopped_by = name
        if (count := server.client_count) != clients:
            errors.print(f"{count} client{'' if count == 1 else 's'}")
            clients = count
        time.sleep(min(_LOOK, left))


def _host_and_port(text: str | None) -> tuple[str, int] | None:
    if text is None:
        return None
    host, found, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not found or not port.isdigit() or len(port) > 5 or int(port) > 65535:
        raise UsageError(f"--tcp is {text!r:.80}; give HOST:PORT, such as 127.0.0.1:7000, or 0.0.0.0:7000 for all")
    return host or "127.0.0.1", int(port)


def _shown(host: str) -> str:
    return f"[{host}]" if ":" in host else host
