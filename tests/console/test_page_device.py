"""A device that no file describes, in the browser: from raw bytes to a first protocol file that the link uses."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.console.browser import close_tabs, open_page, serious, undescribed_device
from wirebond.console import Console

pytestmark = pytest.mark.live

HEADER = """#include <stdint.h>
#pragma pack(1)
typedef struct { int16_t left; int16_t right; } wheels_t;
"""


@pytest.fixture
def device(browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Console]:
    """Files are written into ``tmp_path``."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with undescribed_device() as console:
        yield console
    close_tabs(browser)


UNDOCUMENTED = """\
wirebond: 1
protocol: undocumented
frame: [magic: 0x5A 0xC3, id: u8, payload: 4, check: {type: crc-16/modbus, over: magic..payload}]
messages:
  odometry: {id: 7, sender: mcu, fields: {left_ticks: {type: i16}, right_ticks: {type: i16}}}
"""


def text_of(page: Page) -> str:
    return page.get_by_role("textbox", name="Edit and try").input_value()


def test_its_format_is_found_edited_saved_and_used_without_leaving_the_page(
    browser: Browser, device: Console, tmp_path: Path
) -> None:
    problems: list[str] = []
    page = open_page(browser, device, "messages", problems)
    expect(page.get_by_role("status")).to_contain_text("Raw bytes")
    expect(page.locator("td.mono").first).to_contain_text("AA 55 83")
    page.get_by_role("button", name="Try the known formats").click()
    match = page.locator(".match", has_text="diffdrive").first
    expect(match).to_contain_text("100 % of the bytes")
    match.get_by_role("button", name="Edit a copy").click()
    expect(page.locator(".results")).to_contain_text("odometry")  # the bytes decode under it before it is in force
    expect(page.get_by_role("status")).to_contain_text("Raw bytes")
    page.get_by_label("Name", exact=True).fill("My robot")
    editor = page.get_by_role("textbox", name="Edit and try")
    editor.fill(text_of(page).replace("protocol: diffdrive", "protocol: my_robot"))
    page.keyboard.press("Escape")
    page.keyboard.press("2")  # elsewhere, and back: nothing is lost
    page.keyboard.press("7")
    page.get_by_role("button", name="Save", exact=True).click()
    expect(page.locator(".results")).to_contain_text(f"Written to {tmp_path}/my_robot.yaml")
    assert "protocol: my_robot" in (tmp_path / "my_robot.yaml").read_text()
    page.get_by_role("button", name="Use it for this port").click()
    expect(page.locator("header .name")).to_have_text("my_robot")
    page.keyboard.press("2")
    expect(page.locator("tr", has_text="odometry").locator(".fields")).to_contain_text("left_ticks")
    assert problems == []


def test_an_undocumented_format_becomes_a_first_file(browser: Browser, tmp_path: Path) -> None:
    file, problems = tmp_path / "undocumented.yaml", list[str]()
    file.write_text(UNDOCUMENTED)
    with undescribed_device(file) as console:
        page = open_page(browser, console, "messages", problems)
        expect(page.locator("td.mono").nth(50)).to_be_visible()
        page.get_by_role("button", name="Try the known formats").click()
        seen = page.get_by_role("region", name="Derived from the bytes")
        expect(seen).to_contain_text("magic: 0x5A 0xC3")
        expect(seen).to_contain_text("check: {type: crc-16/modbus, over: magic..payload")
        assert serious(page) == []
        page.get_by_role("button", name="Edit this file").click()
        expect(page.locator(".results")).to_contain_text("message")
    close_tabs(browser)
    assert problems == []


@pytest.mark.long
def test_a_first_file_is_made_of_a_template_or_of_a_c_header(browser: Browser, device: Console) -> None:
    page = open_page(browser, device, "plots")
    page.get_by_role("button", name="Start a protocol file").click()
    assert serious(page) == []
    chooser = page.locator("input[type=file]")
    chooser.set_input_files({"name": "broken.h", "mimeType": "text/plain", "buffer": b"struct {"})
    expect(page.get_by_role("alert")).to_contain_text("broken.h")
    chooser.set_input_files({"name": "robot_link.h", "mimeType": "text/plain", "buffer": HEADER.encode()})
    expect(page.get_by_label("Name", exact=True)).to_have_value("robot_link")
    assert "left:" in text_of(page)
    assert serious(page) == []
    page.get_by_role("button", name="Start again").click()
    page.get_by_label("Name", exact=True).fill("Two wheels")
    page.get_by_label("The robot has").fill("base, joints=12")
    page.get_by_role("button", name="Template length").click()
    expect(page.locator(".results")).to_contain_text("The file is fine: two_wheels")
    assert "count: 12" in text_of(page)


@pytest.mark.long
def test_all_baud_rates_are_tried_and_the_port_comes_back(browser: Browser, device: Console) -> None:
    page = open_page(browser, device, "messages")
    page.get_by_role("button", name="Try all baud rates").click()
    expect(page.locator("main")).to_contain_text("Likely", timeout=60_000)
    expect(page.locator(".match", has_text="diffdrive").first).to_be_visible()
    page.locator(".match", has_text="diffdrive").first.get_by_role("button", name="Use this one").click()
    expect(page.locator("header .name")).to_have_text("diffdrive")
