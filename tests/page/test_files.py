"""The files of a page: what is in them, how large they are, and what they do in other places than a web server."""

from __future__ import annotations

import gzip
import subprocess
import sys
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

import wirebond
from tests.page.conftest import DIFFDRIVE, seat_of, write_page
from tests.page.wire import Wire
from wirebond.console.standalone import page_files

pytestmark = pytest.mark.live
MOST_BYTES = 700_000  # of the module and the page, compressed
COMMAND = str(Path(sys.executable).with_name("wirebond"))
HOSTILE = """
wirebond: 1
protocol: hostile
description: "</script><script>document.title = 'taken'</script><img src=x onerror=\\"document.title = 'taken'\\">"
frame: [magic: 0xAA, length: u8, id: u8, payload: by_length, check: crc-8/smbus]
messages:
  status:
    id: 1
    sender: mcu
    description: "<img src=x onerror=\\"document.title = 'taken'\\">"
    fields:
      mode: {type: u8, enum: {a: 0, b: 1}, description: "--></textarea><script>document.title = 'taken'</script>"}
"""


def test_the_command_writes_the_page_and_says_what_is_not_current(tmp_path: Path) -> None:
    out = tmp_path / "page"
    command = [COMMAND, "gen", str(DIFFDRIVE), "--lang", "page", "--out", str(out)]
    shown = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert {str(path) for path in out.rglob("*") if path.is_file()} == set(shown.split())
    assert subprocess.run([*command, "--check"], check=False, capture_output=True).returncode == 0
    (out / "protocol.json").write_text("{}")
    stale = subprocess.run([*command, "--check"], check=False, capture_output=True, text=True)
    assert (stale.returncode, stale.stdout.strip()) == (1, f"not current: {out / 'protocol.json'}")


def test_the_page_is_small(diffdrive_page: Path) -> None:
    """`page_bytes`: what a browser loads from a web server that compresses."""
    parts = [path for path in diffdrive_page.rglob("*") if path.is_file() and path.name != "diffdrive.html"]
    size = sum(len(gzip.compress(path.read_bytes(), 9)) for path in parts)
    assert size <= MOST_BYTES


def test_one_file_opens_from_disk(diffdrive_page: Path, browser: Browser) -> None:
    page = browser.new_page()
    problems: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.goto((diffdrive_page / "diffdrive.html").as_uri() + "#/link")
    expect(page.get_by_role("button", name="Choose a serial port")).to_be_visible()
    expect(page.locator("header .state")).to_contain_text("No port")  # its worker runs
    assert problems == []


def test_a_browser_without_ports_says_which_ones_have_them(diffdrive_page: Path, browser: Browser) -> None:
    with Wire(diffdrive_page).served() as wire:
        page = browser.new_page()
        page.add_init_script("for (const name of ['serial', 'usb']) delete Navigator.prototype[name]")
        page.goto(f"http://127.0.0.1:{wire.port}/#/link")
        expect(page.get_by_text("Open this page in Chrome, Edge or Opera")).to_be_visible()


def test_texts_of_a_protocol_are_shown_and_never_run(tmp_path: Path, browser: Browser) -> None:
    file = tmp_path / "hostile.yaml"
    file.write_text(HOSTILE)
    folder = tmp_path / "page"
    for name, data in page_files(wirebond.load(file)).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    with seat_of(folder, browser) as seat:
        page = seat.open("protocol")
        for address in (page.url, (folder / "hostile.html").as_uri() + "#/protocol"):
            page.goto(address)
            expect(page.locator("header .state")).to_contain_text("No port")
            assert page.title() != "taken"


def test_the_page_takes_the_file_of_another_protocol(diffdrive_page: Path, tmp_path: Path, browser: Browser) -> None:
    other = write_page(tmp_path, "native")
    with seat_of(diffdrive_page, browser) as seat:
        page = seat.open("link")
        page.get_by_label("Another protocol").set_input_files(diffdrive_page / "index.html")
        expect(page.get_by_text("This is not a file that `wirebond gen --lang page` wrote")).to_be_visible()
        page.get_by_label("Another protocol").set_input_files(other / "protocol.json")
        expect(page.get_by_label("Baud rate")).to_have_attribute(
            "placeholder", str(wirebond.load("protocols/native.yaml").model.link.baud)
        )
