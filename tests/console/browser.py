"""A simulated robot on a real pty, the server that owns its line, and a browser that shows the console's page."""

from __future__ import annotations

import contextlib
import json
import re
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Error, Locator, Page, Playwright, WebSocketRoute, expect

import wirebond
from tests.patient_servers import are_patient
from tests.shared import PROTOCOLS, ROOT
from tests.waiting import PATIENCE, moments, rounds_for, wait_until
from wirebond.console import Console, Options
from wirebond.server import Server
from wirebond.sim.pty_port import PtyPort

CHROMIUM = Path("/usr/bin/chromium")
AXE = ROOT / "console" / "node_modules" / "axe-core" / "axe.min.js"
PAGE = ROOT / "python" / "src" / "wirebond" / "console" / "page" / "index.html"
DIFFDRIVE = PROTOCOLS / "diffdrive.yaml"
VIEWS = ("link", "messages", "plots", "control", "tuning", "recordings", "protocol")

# A page gives its control up after a second in which it hears nothing. With this a second of its is a minute.
_PATIENT = """
const now = performance.now.bind(performance)
let [since, shown, pace] = [now(), now(), 1 / 60]
performance.now = () => shown + (now() - since) * pace
globalThis.setPace = (next) => { [since, shown, pace] = [now(), performance.now(), next] }
"""

# The robot says when each velocity came, on a clock that all processes of this computer share.
_BEHAVIOUR = """
import time

def setup(mcu):
    @mcu.on("velocity")
    def velocity(message):
        mcu.report(f"got {time.monotonic()} {message['linear']} {message['angular']}")

    @mcu.on("parameter")
    def parameter(message):
        if message["name"] == "clear_safe_mode":  # the file's `recover_by`
            mcu.report("cleared")

    @mcu.on("status_query")
    def status(message):
        return {"battery": 11.97, "errors": ["encoder"], "state": []}
"""


@dataclass
class Velocity:
    """One that the robot got."""

    t: float
    linear: float
    angular: float


class Robot:
    """A virtual MCU in a process of its own. ``start`` again after ``kill`` is the cable that comes back."""

    def __init__(self, folder: Path, protocol: str = "diffdrive") -> None:
        self.port = folder / "robot"
        self.velocities: list[Velocity] = []
        self._cleared = 0  # times
        self._script = folder / "behaviour.py"
        self._script.write_text(_BEHAVIOUR)
        self._protocol = protocol
        self.start()

    def start(self) -> None:
        script = ["--script", str(self._script)] if self._protocol == "diffdrive" else []
        file = PROTOCOLS / f"{self._protocol}.yaml"
        wirebond = str(Path(sys.executable).with_name("wirebond"))
        command = [wirebond, "sim", str(file), "--link", str(self.port), *script]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        wait_until(self.port.exists, "the robot's port")
        threading.Thread(target=self._listen, args=(self._process,), daemon=True).start()

    @property
    def pid(self) -> int:
        return self._process.pid

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()
        self.port.unlink(missing_ok=True)

    def ready(self, link: wirebond.Link) -> None:
        """Ends the safe mode, once the robot has handled what the link sent before."""
        before = self._cleared
        link.send("parameter", name="clear_safe_mode", value=0)
        wait_until(lambda: self._cleared > before, "the end of the safe mode")

    def _listen(self, process: subprocess.Popen[str]) -> None:
        assert process.stderr is not None
        for line in process.stderr:
            if found := re.search(r"got (\S+) (\S+) (\S+)", line):
                self.velocities.append(Velocity(*map(float, found.groups())))
            self._cleared += line.startswith("cleared")

    def since(self, t: float) -> list[Velocity]:
        """The velocities that came after this time of `time.monotonic`."""
        return [velocity for velocity in self.velocities if velocity.t > t]

    def wait_for(self, fits: Callable[[Velocity], object], since: float) -> Velocity:
        """The first velocity behind ``since`` that fits."""
        for _ in moments(lambda: f"a velocity at the robot; since then came {self.since(since)[-5:]}"):
            for velocity in self.since(since):
                if fits(velocity):
                    return velocity
        raise AssertionError


@dataclass
class Desk:
    """All that a test needs."""

    robot: Robot
    link: wirebond.Link
    server: Server
    console: Console
    browser: Browser
    problems: list[str] = field(default_factory=list)  # what pages wrote as errors

    def page(self, view: str = "link", address: str = "", **options: Any) -> Page:
        """A tab of a browser's profile of its own."""
        return open_page(self.browser, self.console, view, self.problems, address, **options)

    @contextmanager
    def of_one_test(self) -> Iterator[Desk]:
        """A test begins without tabs, and its pages had no error; behind it the robot is stopped by none, and free."""
        self.problems.clear()
        yield self
        self.tell()
        for context in self.browser.contexts:
            context.close()
        self.link.release_stop()
        wait_until(lambda: self.server.holder is None, "nobody is in control")
        assert self.problems == []

    def tell(self) -> None:
        """Print the state of the pages and the sent commands, for the report of a test that failed."""
        for page in (page for context in self.browser.contexts for page in context.pages):
            with contextlib.suppress(Error):  # it does not show a page of ours
                print(page.url, page.locator("body").inner_text(timeout=1000), sep="\n")
        for command in self.server.log.commands()[-20:]:
            print(command)

    def drive(self, page: Page) -> Velocity:
        """Holds the key until the robot moves: its first velocity.

        After 3 s without velocity the robot is in its safe mode, which ends only where somebody says so. On a busy
        machine a page can be silent for the 0.3 s that end control; then nothing drives by itself, and it is taken
        again.
        """
        control = page.get_by_text("You are in control")
        for _ in moments("the robot moves"):
            self.robot.ready(self.link)
            if not control.is_visible():
                take_control(page)
            page.get_by_role("application").focus()
            page.keyboard.up("ArrowUp")
            since = time.monotonic()
            page.keyboard.down("ArrowUp")
            for _ in rounds_for(2):
                if not control.is_visible():
                    break
                if moving := [v for v in self.robot.since(since) if v.linear > 0]:
                    return moving[0]
        raise AssertionError

    def let_go(self, page: Page) -> float:
        """Lets the key go. The time from which on the robot gets nothing but zero.

        The first zero at the robot need not be that of the page: where renewals come late, leases of the server end in
        between, and a velocity can still be on its way.
        """
        page.keyboard.up("ArrowUp")
        expect(page.get_by_text("Let go: zero is sent")).to_be_visible()
        wait_until(lambda: not any(self._newest_repeated().values()), "zero at the server")
        self.robot.ready(self.link)
        return time.monotonic()

    def _newest_repeated(self) -> Mapping[str, Any]:
        """The fields of the velocity that a page asked the server to repeat last."""
        repeated = (one for one in reversed(self.server.log.commands()) if one.do == "repeat")
        return next(repeated).fields or {}


def open_page(
    browser: Browser,
    console: Console,
    view: str = "link",
    problems: list[str] | None = None,
    address: str = "",
    **options: Any,
) -> Page:
    """A tab of a browser's profile of its own. ``problems`` gets what it writes as errors. ``address``: of another way
    to the console. It is as patient as the servers, but in `real_time`."""
    context = browser.new_context(
        **{"viewport": {"width": 1280, "height": 720}, "locale": "en-US", "color_scheme": "light", **options}
    )
    context.set_default_timeout(PATIENCE * 1000)
    page = context.new_page()
    if are_patient():
        page.add_init_script(_PATIENT)
    if problems is not None:
        page.on("pageerror", lambda error: problems.append(error.stack or str(error)))
    page.goto(address_of(console, view, address))
    return page


@contextmanager
def real_time(page: Page) -> Iterator[None]:
    """Make durations on the page's own clock real, and the page as impatient as it really is."""
    page.evaluate("globalThis.setPace?.(1)")
    yield
    page.evaluate("globalThis.setPace?.(1 / 60)")


def address_of(console: Console, view: str, address: str = "") -> str:
    """Return the address of this view, with the token. ``address``: of another way to the console."""
    fragment = f"#/{view}{'&' if '?' in view else '?&'}token={console.token}"
    return f"{address or console.address.partition('#')[0]}{fragment}"


def request_to(console: Console, path: str, body: object) -> urllib.request.Request:
    """A POST with the token."""
    address = f"{console.address.partition('#')[0]}{path}"
    headers = {"Authorization": f"Bearer {console.token}"}
    return urllib.request.Request(address, json.dumps(body).encode(), headers, method="POST")


@contextmanager
def desk(folder: Path, browser: Browser, protocol: str = "diffdrive", **options: Any) -> Iterator[Desk]:
    robot = Robot(folder, protocol)
    codec = wirebond.load(PROTOCOLS / f"{protocol}.yaml")
    try:
        with (
            wirebond.open(codec, str(robot.port)) as link,
            Server(link, folder / "server.sock", recordings=folder / "recordings") as server,
            Console(port=0, **options) as console,
        ):
            console.show(link, server)
            yield Desk(robot, link, server, console, browser)
    finally:
        robot.kill()


@contextmanager
def robot_frames(damaged: int = 0, first: int = 0, file: Path = DIFFDRIVE) -> Iterator[str]:
    """A pty to which frames of ``diffdrive`` come, twenty times a second.

    :param damaged: each frame of this number has a wrong byte; 0: none.
    :param first: where the count of the left wheel begins.
    :param file: of a protocol with the same message.
    """
    codec, pty, ends = wirebond.load(file), PtyPort(), threading.Event()

    def send() -> None:
        number = 0
        while not ends.wait(0.05):
            frame = bytearray(codec.encode("odometry", left_ticks=first + number, right_ticks=-number))
            if damaged and number % damaged == 0:
                frame[5] ^= 0x40
            pty.write(bytes(frame))
            pty.read(0)
            number += 1

    thread = threading.Thread(target=send, daemon=True)
    thread.start()
    try:
        yield pty.path
    finally:
        ends.set()
        thread.join(PATIENCE)
        pty.close()


@contextmanager
def noisy_robot(first: int = 0, file: Path = DIFFDRIVE) -> Iterator[Console]:
    """A console over a line on which every seventh frame of the robot is damaged. The rest: see `robot_frames`."""
    with (
        robot_frames(7, first, file) as port,
        wirebond.open(file, port) as link,
        tempfile.TemporaryDirectory() as folder,
        Server(link, Path(folder) / "server.sock") as server,
        Console(port=0) as console,
    ):
        console.show(link, server)
        yield console


@contextmanager
def undescribed_device(file: Path = DIFFDRIVE) -> Iterator[Console]:
    """A console over a port that sends frames, and no protocol is chosen. ``file``: as of `robot_frames`."""
    with robot_frames(file=file) as port, Console(port=0, options=Options(may_connect=True)) as console:
        urllib.request.urlopen(request_to(console, "api/connect", {"port": port, "baud": 115200})).close()
        yield console


@contextmanager
def chromium(playwright: Playwright, *arguments: str) -> Iterator[Browser]:
    expect.set_options(timeout=PATIENCE * 1000)
    browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox", *arguments])
    yield browser
    browser.close()


def with_told(page: Page, view: str, facts: dict[str, Any]) -> None:
    """From now on the server tells this page these facts, too, in each message of this view. The page loads again."""

    def told(said: str | bytes) -> str | bytes:
        message = json.loads(said) if isinstance(said, str) else {}
        return json.dumps(message | facts) if message.get("view") == view else said

    def between(socket: WebSocketRoute) -> None:
        server = socket.connect_to_server()
        server.on_message(lambda said: socket.send(told(said)))

    page.route_web_socket(re.compile("/views$"), between)
    page.reload()


def press(page: Page, button: Locator, holds: Callable[[], object], what: str) -> None:
    """Press it, until this holds. A press may have no effect, because this machine is busy and the press came late, but
    then the page must say so; only then it is pressed again."""
    notices = page.locator(".notice")
    is_pressed = False
    for _ in moments(lambda: f"{what}; the page says {notices.all_inner_texts()}"):
        if holds():
            return
        if is_pressed and not notices.count():
            continue
        page.evaluate("document.querySelectorAll('.notice button').forEach((close) => close.click())")
        if not holds():
            button.click()
            is_pressed = True


def take_control(page: Page) -> None:
    button = page.locator("header").get_by_role("button", name="Take control")
    press(page, button, page.get_by_text("You are in control").is_visible, "control")


def shows_the_robot(page: Page) -> None:
    expect(page.get_by_role("status").filter(has_text="Up")).to_be_visible()


def close_tabs(browser: Browser) -> None:
    for context in browser.contexts:
        context.close()


def serious(page: Page) -> list[str]:
    """Return the findings of axe that are serious or worse, each as one line."""
    page.evaluate(AXE.read_text())
    found = page.evaluate("axe.run(document, {resultTypes: ['violations']}).then((result) => result.violations)")
    return [
        f"{one['id']}: {node['target']} {node['failureSummary']}"
        for one in found
        if one["impact"] in ("serious", "critical")
        for node in one["nodes"]
    ]
