"""Memory does not grow while messages arrive: neither the page's, nor the server's apart from its history. The long
test sends 8 000 a second; the short one, which shares the machine with other tests, sends 1 000."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from bench.console_page import FEEDER, LAYOUT, PROTOCOL
from playwright.sync_api import Browser, Page
from websockets.sync.client import connect

from tests.waiting import PATIENCE, moments

pytestmark = pytest.mark.live

SERVER_MAY_GROW = 8 << 20  # bytes, by what is not history
PAGE_MAY_GROW = 2 << 20  # bytes of live objects


@dataclass
class Look:
    """The memory in use at one time."""

    t: float
    server: int  # bytes, without the history
    history: int
    page: int  # bytes of objects that are in use
    messages: int  # that came so far


@contextmanager
def served(folder: Path, seconds: float, rate: int) -> Iterator[tuple[int, str]]:
    """The process of ``wirebond serve --web`` over a line with ``rate`` messages a second, and its address."""
    file = folder / "console_bench.yaml"
    file.write_text(PROTOCOL)
    wirebond = str(Path(sys.executable).with_name("wirebond"))
    own = {**os.environ, "XDG_RUNTIME_DIR": str(folder)}  # the server's socket: another one of this name may run
    feed = [sys.executable, "-c", FEEDER, str(file), str(seconds), str(rate)]
    with subprocess.Popen(feed, stdout=subprocess.PIPE, text=True) as feeder:
        assert feeder.stdout is not None
        port = feeder.stdout.readline().strip()
        command = [wirebond, "serve", str(file), port, "--web", "127.0.0.1:0", "--no-browser"]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=own) as server:
            assert server.stderr is not None
            try:
                address = next(found.group() for line in server.stderr if (found := re.search(r"http://\S+", line)))
                yield server.pid, address
            finally:
                server.terminate()
                feeder.kill()


def look(server: int, address: str, page: Page) -> Look:
    parts = urlsplit(address)
    with connect(f"ws://{parts.netloc}/views", compression=None) as socket:
        socket.send(json.dumps({"token": parts.fragment.removeprefix("token="), "views": {"link": True}}))
        while (said := json.loads(socket.recv(timeout=PATIENCE))).get("view") != "link":
            pass
    status = Path(f"/proc/{server}/status").read_text()
    resident = int(re.findall(r"VmRSS:\s+(\d+) kB", status)[0]) << 10
    devtools = page.context.new_cdp_session(page)
    devtools.send("HeapProfiler.collectGarbage")
    used = devtools.send("Runtime.getHeapUsage")["usedSize"]
    devtools.detach()
    history = said["history"]["bytes"]
    return Look(time.monotonic(), resident - history, history, int(used), said["receive"]["messages"]["state"])


def looks(
    browser: Browser, folder: Path, rate: int, width: float, settle: float, seconds: float, every: float
) -> list[Look]:
    """For so long, and until as many messages have come as nearly all of this time brings. The page shows its table and
    two plots of eight fields, ``width`` seconds wide. ``settle``: before the first."""
    wanted = 0.9 * rate * seconds  # on a busy machine a pty overflows: then it takes longer
    layout = json.dumps(json.dumps({**LAYOUT, "seconds": width}))
    with served(folder, settle + 4 * seconds + 4 * PATIENCE, rate) as (server, address):
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.set_default_timeout(PATIENCE * 1000)
        page.add_init_script(f"localStorage.setItem('wirebond.layout.console_bench', {layout})")
        page.goto(address.replace("#", "#/plots?&"))
        page.locator("[data-newest]").nth(1).wait_for()
        page.wait_for_timeout(settle * 1000)
        found = [look(server, address, page)]
        for _ in moments(
            lambda: f"messages; {found[0]} was the first look, {found[-1]} the last", 4 * seconds + PATIENCE
        ):
            page.wait_for_timeout(every * 1000)
            found.append(look(server, address, page))
            if found[-1].t - found[0].t >= seconds and found[-1].messages > found[0].messages + wanted:
                break
        return found


def stays(found: list[Look]) -> None:
    quarter = max(1, len(found) // 4)
    first, last = found[:quarter], found[-quarter:]
    assert min(one.server for one in last) - min(one.server for one in first) < SERVER_MAY_GROW
    assert min(one.page for one in last) - min(one.page for one in first) < PAGE_MAY_GROW


def test_memory_stays_for_some_seconds(browser: Browser, tmp_path: Path) -> None:
    stays(looks(browser, tmp_path, rate=1000, width=1, settle=0.5, seconds=1, every=0.25))


@pytest.mark.long
def test_memory_stays_for_ten_minutes(browser: Browser, tmp_path: Path) -> None:
    found = looks(browser, tmp_path, rate=8000, width=10, settle=30, seconds=600, every=10)
    print(found[0], found[len(found) // 2], found[-1], sep="\n")
    stays(found)
