"""``wirebond serve``: own a port, and let other programs attach to its link."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
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
from wirebond.link.common_port import CommonPort
from wirebond.server import Server
from wirebond.server.listening import is_loopback
from wirebond.server.recordings import Recordings
from wirebond.system import HAS_UNIX_SOCKETS, NO_UNIX_SOCKETS

if TYPE_CHECKING:
    from wirebond.console import Console
    from wirebond.ros2.failure import Failure
    from wirebond.ros2.mapping import BridgeMapping

_LOOK = 0.2  # seconds between two checks of the port and of the holder of control


@dataclass(frozen=True)
class Serving:
    """The arguments of ``wirebond serve``. Without ``paths`` and ``port`` the console's page chooses them."""

    paths: Sequence[Path]
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


@dataclass(frozen=True)
class _Served:
    """A link, and who may attach to it."""

    link: Link
    server: Server
    address: str  # by the socket
    console: Console | None

    def now(self) -> tuple[Link, Server] | None:
        """Return the current link and server, because the page may connect to another port, or to none."""
        return (self.link, self.server) if self.console is None else _shown_by(self.console)


def serve_port(given: Serving) -> None:
    """Serve until the time is over, or until Ctrl-C."""
    if not given.paths or given.port is None:
        _serve_page_alone(given)
        return
    codecs = [load(path) for path in given.paths]
    if len(codecs) > 1:
        _refuse_for_several(given, codecs)
    topics = _topics(codecs[0], given.mapping) if given.ros2 or given.mapping is not None else None
    host = _host_and_port(given.tcp)
    web = None if given.web is None else web_address(given.web)
    if not HAS_UNIX_SOCKETS:
        _refuse_without_unix_sockets(given)
    make_socket_folder()
    with ended_by_signals(), shown_server_log(), ExitStack() as stack:
        port = CommonPort(given.port, given.baud) if len(codecs) > 1 else given.port
        links = [stack.enter_context(_opened(codec, port, given)) for codec in codecs]
        served = [
            _serve(stack, given, link, _behind(host, number), _behind(web, number)) for number, link in enumerate(links)
        ]
        failure: Failure | None = None
        if topics is not None:
            from wirebond.ros2.serving import bridge_to  # noqa: PLC0415 without --ros2 its packages are not loaded

            bridge = stack.enter_context(bridge_to(served[0].address, topics))
            failure = bridge.node.failure
            source = f"by {topics.path}" if topics.path else "as JSON"
            errors.print(f"ROS 2 node [bold]{topics.namespace.rstrip('/')}/{topics.node}[/], {plain(source)}")
        try:
            _watch([_Watched(one.now, is_one_of_several=len(served) > 1) for one in served], given.seconds, failure)
        except KeyboardInterrupt:
            errors.print("ending: every repeated message ends with its safe value")
        for one in served:
            errors.print(_named(stats_line(one.link.stats.receive), one.link if len(served) > 1 else None))
    for one in served:
        _finish(one.server.recordings)


def _opened(codec: Codec, port: str | CommonPort, given: Serving) -> Link:
    baud = None if isinstance(port, CommonPort) else given.baud
    return open_link(codec, port, baud, listen=given.listen, wait_for_port=True)


def _serve(
    stack: ExitStack, given: Serving, link: Link, tcp: tuple[str, int] | None, web: tuple[str, int] | None
) -> _Served:
    where = socket_of(given.name or link.codec.name)
    place = f"{SCHEME}{where.absolute()}"
    if given.record is not None:
        stack.enter_context(link.record(given.record))
    token = given.token if tcp is None else _token(given, tcp[0])
    server = stack.enter_context(Server(link, where, tcp=tcp, token=token, recordings=given.recordings))
    attach = f". Attach with [bold]wirebond://{where.stem}[/]" if HAS_UNIX_SOCKETS else ""
    errors.print(f"{link.codec.name} on {plain(link.port)}{attach}", soft_wrap=True)
    if tcp is not None:
        address = f"wirebond://{_shown(tcp[0])}:{server.port}"
        errors.print(f"From other programs by TCP: [bold]{address}?token={server.token}[/]", soft_wrap=True)
    if web is None:
        return _Served(link, server, place, None)
    console = stack.enter_context(_console(web, given))
    console.show(link, server)
    show(console, given.opens_browser)
    return _Served(link, server, place, console)


def _refuse_for_several(given: Serving, codecs: Sequence[Codec]) -> None:
    """Refuse options that only a single link can have."""
    names = [codec.name for codec in codecs]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise UsageError(
            f"two of the files have the protocol {twice[0]}, by whose name programs attach; give only one of them"
        )
    for is_given, option, instead in (
        (given.name is not None, "--name", f"programs attach by the names of the protocols: {', '.join(names)}"),
        (given.record is not None, "--record", f"run `wirebond record {given.paths[0]} {SCHEME}{names[0]}` beside it"),
        (given.ros2, "--ros2", f"start the bridge by itself, at the port {SCHEME}{names[0]}"),
        (given.mapping is not None, "--mapping", f"start the bridge by itself, at the port {SCHEME}{names[0]}"),
    ):
        if is_given:
            raise UsageError(f"{option} is for one protocol file, and there are {len(names)}; {instead}")


def _refuse_without_unix_sockets(given: Serving) -> None:
    """Refuse what needs a server's name."""
    if given.tcp is None and given.web is None:
        raise UsageError(NO_UNIX_SOCKETS)
    if given.ros2:
        raise UsageError("the bridge to ROS 2 needs Unix sockets, and Python on this system has none; run it on Linux")


def _behind(address: tuple[str, int] | None, number: int) -> tuple[str, int] | None:
    """Return the address of the link with this number: each has the port after that of the one before.

    :raises UsageError: there is none.
    """
    if address is None or address[1] == 0:
        return address
    if address[1] + number > 65535:
        raise UsageError(
            f"each file takes a port of its own, from {address[1]} on, and ports end at 65535; give a lower one"
        )
    return address[0], address[1] + number


def _topics(codec: Codec, path: Path | None) -> BridgeMapping:
    from wirebond.ros2.serving import mapping_for  # noqa: PLC0415 without --ros2 its packages are not loaded

    return mapping_for(codec, path)


def _serve_page_alone(given: Serving) -> None:
    """Serve only the page, which then chooses the port and the protocol."""
    if given.web is None or given.port is not None or given.tcp is not None or given.record is not None or given.ros2:
        raise UsageError("give FILE and PORT; without both, only --web is possible: the page then chooses them")
    with ended_by_signals(), shown_server_log(), _console(web_address(given.web), given) as console:
        show(console, given.opens_browser)
        with suppress(KeyboardInterrupt):
            _watch([_Watched(lambda: _shown_by(console))], given.seconds)


def _console(address: tuple[str, int], given: Serving) -> Console:
    from wirebond.console import Console, Options  # noqa: PLC0415 without --web its packages are not loaded

    options = Options(
        given.name, given.recordings, given.listen, may_connect=True, may_save=given.paths[0] if given.paths else None
    )
    return Console(*address, token=_token(given, address[0]), options=options)


def _token(given: Serving, host: str) -> str | None:
    """Return the given token. For this computer alone the same token is used after a restart; None: a new one."""
    return given.token or (kept_token() if is_loopback(host) else None)


def _shown_by(console: Console) -> tuple[Link, Server] | None:
    served = console.station.served
    return None if served is None else (served.link, served.server)


def _finish(recordings: Recordings) -> None:
    """Wait until the recordings are compressed."""
    if not recordings.is_closing:
        return
    errors.print("compresses the recording; Ctrl-C leaves it whole, and larger")
    with ended_by_signals(), suppress(KeyboardInterrupt):
        recordings.wait()


class _Watched:
    """Prints what changes at a link.

    :param now: what is served at that moment.
    :param is_one_of_several: say of which link.
    """

    def __init__(self, now: Callable[[], tuple[Link, Server] | None], *, is_one_of_several: bool = False) -> None:
        self._now = now
        self._is_one_of_several = is_one_of_several
        self._known: Link | None = None
        self._is_other = False  # not the one that the command line named
        self._forget()

    def _forget(self) -> None:
        self._was_away = False
        self._holder: str | None = None
        self._clients = 0
        self._stopped_by: str | None = None

    def look(self) -> None:
        found = self._now()
        if found is None:
            self._known, self._is_other = None, True
            return
        link, server = found
        self._is_other = self._is_other or self._known not in (None, link)
        if self._is_other and self._known is not link:
            self._forget()
            errors.print(f"{link.codec.name} on {plain(link.port)}")
        self._known = link
        is_away = link.state == "down"
        if is_away != self._was_away:
            self._say(f"{plain(link.why)}. Waiting for it." if is_away else f"{plain(link.port)} is there")
            self._was_away = is_away
        if (name := server.holder) != self._holder:
            self._say("no program is in control" if name is None else f"{plain(name)} is in control")
            self._holder = name
        if (name := server.stopped_by) != self._stopped_by:
            self._say("the emergency stop is released" if name is None else f"{plain(name)} stopped the robot")
            self._stopped_by = name
        if (count := server.client_count) != self._clients:
            self._say(f"{count} client{'' if count == 1 else 's'}")
            self._clients = count

    def _say(self, text: str) -> None:
        errors.print(_named(text, self._known if self._is_one_of_several else None))


def _named(text: str, link: Link | None) -> str:
    """Append the name of its protocol, if one is given."""
    return text if link is None else f"{link.codec.name}: {text}"


def _watch(watched: Sequence[_Watched], seconds: float | None, bridge: Failure | None = None) -> None:
    """Print what changes.

    :raises WirebondError: the bridge to ROS 2 has failed. Topics that stopped would look like a silent robot, so the
        server ends with an error, and what started it can start it again.
    """
    for left in time_left(seconds):
        if bridge is not None and bridge.why:
            raise WirebondError(f"the bridge to ROS 2 ends, and the server with it: {bridge.why}")
        for one in watched:
            one.look()
        time.sleep(min(_LOOK, left))


def _host_and_port(text: str | None) -> tuple[str, int] | None:
    if text is None:
        return None
    host, found, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not found or not port.isdigit() or len(port) > 5 or int(port) > 65535:
        raise UsageError(
            f"--tcp is {text!r:.80}; give HOST:PORT, such as 127.0.0.1:7000, or 0.0.0.0:7000 for all addresses"
        )
    return host or "127.0.0.1", int(port)


def _shown(host: str) -> str:
    return f"[{host}]" if ":" in host else host
