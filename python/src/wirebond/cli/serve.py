"""``wirebond serve``: own a port, and let other programs attach to its link."""

from __future__ import annotations

import math
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from wirebond.attach.address import SCHEME, make_socket_folder, socket_of
from wirebond.cli.output import errors, plain
from wirebond.cli.shown import stats_line
from wirebond.cli.signals import ended_by_signals
from wirebond.cli.web import show, web_address
from wirebond.codec import Codec, load
from wirebond.errors import UsageError
from wirebond.link import Link, open_link
from wirebond.server import Server
from wirebond.server.recordings import Recordings

if TYPE_CHECKING:
    from wirebond.ros2.mapping import BridgeMapping

_LOOK = 0.2  # seconds between two looks at the port and at who is in control


def serve_port(
    path: Path,
    port: str,
    baud: int | None,
    name: str | None,
    tcp: str | None,
    token: str | None,
    listen: str,
    record: Path | None,
    recordings: Path | None,
    web: str | None,
    open_browser: bool,
    ros2: bool,
    mapping: Path | None,
    seconds: float | None,
) -> None:
    """Until the time is over, or Ctrl-C."""
    codec = load(path)
    topics = _topics(codec, mapping) if ros2 or mapping is not None else None
    where = socket_of(name or codec.name)
    host = _host_and_port(tcp)
    page = None if web is None else web_address(web)
    make_socket_folder()
    end = math.inf if seconds is None else time.monotonic() + seconds
    with ended_by_signals(), ExitStack() as stack:
        link = stack.enter_context(open_link(codec, port, baud, listen=listen, wait_for_port=True))
        if record is not None:
            stack.enter_context(link.record(record))
        server = stack.enter_context(Server(link, where, tcp=host, token=token, recordings=recordings))
        errors.print(
            f"{codec.name} on {plain(link.port)}. Attach with [bold]wirebond://{where.stem}[/]", soft_wrap=True
        )
        if host is not None:
            address = f"wirebond://{_shown(host[0])}:{server.port}"
            query = "" if server.token is None else f"?token={server.token}"
            errors.print(f"From other programs by TCP: [bold]{address}{query}[/]", soft_wrap=True)
        if page is not None:
            from wirebond.console import Console  # noqa: PLC0415 without --web its packages are not loaded

            console = stack.enter_context(Console(*page, token=token))
            console.show(link, server)
            show(console, open_browser)
        if topics is not None:
            from wirebond.ros2.serving import bridge_to  # noqa: PLC0415 without --ros2 its packages are not loaded

            stack.enter_context(bridge_to(f"{SCHEME}{where.absolute()}", topics))
            source = f"by {topics.path}" if topics.path else "as JSON"
            errors.print(f"ROS 2 node [bold]{topics.namespace.rstrip('/')}/{topics.node}[/], {plain(source)}")
        try:
            _watch(link, server, end)
        except KeyboardInterrupt:
            errors.print("ends: what is repeated ends with its safe value")
        errors.print(stats_line(link.stats.receive))
    _finish(server.recordings)


def _topics(codec: Codec, path: Path | None) -> BridgeMapping:
    from wirebond.ros2.serving import mapping_for  # noqa: PLC0415 without --ros2 its packages are not loaded

    return mapping_for(codec, path)


def _finish(recordings: Recordings) -> None:
    """Wait until the recordings are compressed."""
    if not recordings.is_closing:
        return
    errors.print("compresses the recording; Ctrl-C leaves it whole, and larger")
    with ended_by_signals(), suppress(KeyboardInterrupt):
        recordings.wait()


def _watch(link: Link, server: Server, end: float) -> None:
    """Say what changes."""
    was_away, holder, clients = False, None, 0
    while (left := end - time.monotonic()) > 0:
        is_away = link.state == "down"
        if is_away != was_away:
            errors.print(f"{plain(link.why)}. Waiting for it." if is_away else f"{plain(link.port)} is there")
            was_away = is_away
        if (now := server.holder) != holder:
            errors.print("no program is in control" if now is None else f"{plain(now)} is in control")
            holder = now
        if (count := server.client_count) != clients:
            errors.print(f"{count} client{'' if count == 1 else 's'}")
            clients = count
        time.sleep(min(_LOOK, left))


def _host_and_port(text: str | None) -> tuple[str, int] | None:
    if text is None:
        return None
    host, found, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not found or not port.isdigit() or int(port) > 65535:
        raise UsageError(f"--tcp is {text!r:.80}; give HOST:PORT, such as 127.0.0.1:7000, or 0.0.0.0:7000 for all")
    return host or "127.0.0.1", int(port)


def _shown(host: str) -> str:
    return f"[{host}]" if ":" in host else host
