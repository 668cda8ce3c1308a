"""A console over a pty, and a client of it; and what tests with a browser share."""

from __future__ import annotations

import contextlib
import http.client
import json
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Playwright, sync_playwright
from playwright.sync_api import Error as BrowserError
from websockets.sync.client import ClientConnection, connect

import wirebond
from tests.console import browser as browsers
from tests.patient_servers import ages, real_ages  # noqa: F401 - fixtures of this folder
from tests.shared import ROOT, codec
from tests.waiting import PATIENCE, moments, rounds_for, wait_until
from wirebond.console import Console
from wirebond.server import Server
from wirebond.sim.pty_port import PtyPort

PICTURES = ROOT / "build" / "screenshots"


@dataclass
class Desk:
    """A console over a link to a pty whose other side the test reads and writes."""

    codec: wirebond.Codec
    pty: PtyPort
    link: wirebond.Link
    server: Server
    port: int  # of the console
    token: str

    @property
    def host(self) -> str:
        return f"127.0.0.1:{self.port}"

    @contextmanager
    def web(self, path: str, origin: Any = None) -> Iterator[ClientConnection]:
        """A WebSocket to this path."""
        address = f"ws://{self.host}{path}"
        with connect(address, origin=origin, compression=None, max_size=None, close_timeout=PATIENCE) as socket:
            yield socket

    def ask(
        self, path: str, body: Any = None, headers: dict[str, str] | None = None, method: str | None = None
    ) -> tuple[int, Any]:
        """Status and answer of an HTTP request, with the token unless `headers` has another."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE)
        data = None if body is None else body if isinstance(body, bytes) else json.dumps(body).encode()
        connection.request(
            method or ("GET" if data is None else "POST"),
            path,
            data,
            {"Authorization": f"Bearer {self.token}", **(headers or {})},
        )
        answer = connection.getresponse()
        read = answer.read()
        is_json = answer.getheader("content-type", "").startswith("application/json")
        connection.close()
        return answer.status, json.loads(read) if is_json else read

    @contextmanager
    def attach(self, **facts: Any) -> Iterator[ClientConnection]:
        """A client of `/attach` that has said who it is."""
        with self.web("/attach") as socket:
            say(socket, {"do": "attach", "id": 1, "messages": "none", "token": self.token, **facts})
            yield socket

    @contextmanager
    def look(self, **views: Any) -> Iterator[ClientConnection]:
        """A client of `/views` that wants this."""
        with self.web("/views") as socket:
            say(socket, {"token": self.token, "views": views})
            yield socket

    def __post_init__(self) -> None:
        self._decoder = self.codec.decoder("host")

    def send(self, message: str, **fields: Any) -> None:
        """The MCU sends a message."""
        self.pty.write(self.codec.encode(message, **fields))

    def sent(self, wait: float = 0.0) -> list[wirebond.Message]:
        """Return the messages that left at the port since the last call: all that the link has accepted by now, and all
        that follow within ``wait`` seconds."""
        found: list[wirebond.Message] = []
        for _ in rounds_for(wait):
            found += self._decoder.feed(self.pty.read(0.002), time.monotonic())
        for _ in moments("what the link has accepted does not leave"):
            stats = self.link.stats.send
            if not stats.queued and self._decoder.stats.frames >= stats.sent:
                return found
            found += self._decoder.feed(self.pty.read(0.002), time.monotonic())
        raise AssertionError


@pytest.fixture(scope="module")
def shared_desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    yield from make_desk(tmp_path_factory.mktemp("desk"))


@pytest.fixture
def desk(shared_desk: Desk) -> Desk:
    """One console for the tests of a file; nobody is in control, and nothing waits at the port."""
    wait_until(lambda: shared_desk.server.client_count == 0, "clients of the last test go")
    shared_desk.link.release_stop()
    shared_desk.sent()
    return shared_desk


def make_desk(folder: Path, **options: Any) -> Iterator[Desk]:
    proto, pty = codec("diffdrive"), PtyPort()
    with (
        wirebond.open(proto, pty.path) as link,
        Server(link, folder / "server.sock", recordings=folder / "recordings") as server,
        Console(port=0, **options) as console,
    ):
        console.show(link, server)
        yield Desk(proto, pty, link, server, console.port, console.token)
    pty.close()


@pytest.fixture(scope="package")
def playwright() -> Iterator[Playwright]:
    """One for all tests of this folder: a thread can have no second one."""
    if not browsers.PAGE.exists():
        pytest.skip("the page is not built: that needs Node, as setup/page.sh says")
    with sync_playwright() as started:
        yield started


@pytest.fixture(scope="package")
def browser(playwright: Playwright) -> Iterator[Browser]:
    """One for all; each test begins without tabs."""
    with browsers.chromium(playwright) as started:
        yield started


@pytest.fixture(autouse=True)
def no_tab_stays(request: pytest.FixtureRequest) -> Iterator[None]:
    yield
    started = getattr(request.node, "funcargs", {}).get("browser")
    if started is not None:
        browsers.close_tabs(started)


@pytest.fixture(scope="package")
def shared_rover(tmp_path_factory: pytest.TempPathFactory, browser: Browser) -> Iterator[browsers.Desk]:
    with browsers.desk(tmp_path_factory.mktemp("desk"), browser) as made:
        yield made


@pytest.fixture
def rover(shared_rover: browsers.Desk) -> Iterator[browsers.Desk]:
    """One robot and one server for the tests of several files; each begins without tabs."""
    shared_rover.problems.clear()
    yield shared_rover
    browsers.close_tabs(shared_rover.browser)
    assert shared_rover.problems == []


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_teardown(item: pytest.Function) -> None:
    """Keep the last picture of each browser when its test ends."""
    browser = item.funcargs.get("browser") or getattr(item.funcargs.get("rover"), "browser", None)
    pages = [] if browser is None else [page for context in browser.contexts for page in context.pages]
    for number, page in enumerate(pages):
        name = f"{item.path.stem}-{item.name}-{number}.png"
        with contextlib.suppress(BrowserError):
            page.screenshot(path=PICTURES / name, timeout=2000)


def say(socket: ClientConnection, value: Any) -> None:
    socket.send(json.dumps(value))


def hear(socket: ClientConnection, fits: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    """The next message in text that fits."""
    for _ in moments("the message that the test waits for"):
        said = socket.recv(timeout=PATIENCE)
        if isinstance(said, str) and fits(found := json.loads(said)):
            return found
    raise AssertionError


def view(socket: ClientConnection, name: str, fits: Callable[[dict[str, Any]], object] = bool) -> dict[str, Any]:
    """The next message of this view that fits."""
    return hear(socket, lambda said: said.get("view") == name and fits(said))


@dataclass
class Batch:
    """A message of a plot, read as docs/console-api.md says."""

    head: dict[str, Any]
    columns: dict[str, tuple[Any, Any, Any]]


def read_batch(data: bytes) -> Batch:
    (size,) = struct.unpack_from("<I", data)
    head = json.loads(data[4 : 4 + size])
    at = 4 + size
    assert at % 8 == 0
    columns = {}
    for column in head["columns"]:
        arrays = []
        for key in ("t", "low", "high"):
            kind = np.dtype({"f64": "<f8", "f32": "<f4"}[column[key]])
            arrays.append(np.frombuffer(data, kind, column["n"], at))
            at += -(-kind.itemsize * column["n"] // 8) * 8
        columns[column["field"]] = (arrays[0], arrays[1], arrays[2])
    assert at == len(data)
    return Batch(head, columns)


def batches(socket: ClientConnection) -> Iterator[Batch]:
    """The plots that come."""
    while True:
        said = socket.recv(timeout=PATIENCE)
        if isinstance(said, bytes):
            yield read_batch(said)
