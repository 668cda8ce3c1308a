"""The editor of the protocol file in the browser: problems at their place, completion, a trial, saving, and its use."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

import wirebond
from tests.console.browser import close_tabs, open_page, robot_frames, serious
from tests.shared import PROTOCOLS
from wirebond.console import Console, Options
from wirebond.server import Server

pytestmark = pytest.mark.live

GOOD = (PROTOCOLS / "diffdrive.yaml").read_text(encoding="utf-8")
BEFORE = GOOD[: GOOD.index("id: u8")]
LINE, COLUMN = BEFORE.count("\n") + 1, len(BEFORE.rpartition("\n")[2]) + len("id: ") + 1  # of the type


@dataclass
class Edited:
    """A console over a robot whose file may be saved."""

    file: Path
    link: wirebond.Link
    console: Console
    browser: Browser

    def editor(self) -> tuple[Page, Locator]:
        """A page with the editor, and its text."""
        page = open_page(self.browser, self.console, "protocol")
        page.get_by_role("tab", name="Edit and try").click()
        text = page.get_by_role("textbox", name="Edit and try")
        expect(text).to_have_value(GOOD)
        return page, text


@pytest.fixture
def edited(browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Edited]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    file = tmp_path / "robot.yaml"
    file.write_text(GOOD, encoding="utf-8")
    with (
        robot_frames() as port,
        wirebond.open(wirebond.load(file), port) as link,
        Server(link, tmp_path / "server.sock") as server,
        Console(port=0, options=Options(may_connect=True, may_save=file)) as console,
    ):
        console.show(link, server)
        yield Edited(file, link, console, browser)
    close_tabs(browser)


def test_an_error_is_shown_at_its_place_and_the_old_file_stays_in_force(edited: Edited) -> None:
    page, text = edited.editor()
    before = edited.link.codec.hash
    text.fill(GOOD.replace("id: u8", "id: u9"))
    problem = page.locator(".problem").first
    expect(problem).to_contain_text(f"{LINE}:{COLUMN}")
    expect(page.locator(".gutter .wrong")).to_have_text(str(LINE))
    for name in ("Save", "Connect with the edited file"):
        expect(page.get_by_role("button", name=name, exact=True)).to_be_disabled()
    problem.click()
    at = text.evaluate("area => area.selectionStart")
    assert text.input_value()[at:].startswith("u9")
    assert serious(page) == []
    assert edited.file.read_text(encoding="utf-8") == GOOD and edited.link.codec.hash == before
    asked: list[str] = []
    page.once("dialog", lambda dialog: (asked.append(dialog.type), dialog.accept()))
    page.reload()
    assert asked == ["beforeunload"]
    page.get_by_role("button", name="Restore").click()
    expect(text).to_have_value(GOOD.replace("id: u8", "id: u9"))
    page.once("dialog", lambda dialog: dialog.accept())
    page.reload()
    page.get_by_role("button", name="Discard").click()
    page.get_by_role("tab", name="Edit and try").click()
    expect(text).to_have_value(GOOD)
    expect(page.get_by_role("button", name="Restore")).to_have_count(0)
    page.keyboard.press("Escape")
    page.keyboard.press("2")
    expect(page.locator("tr", has_text="odometry").locator(".fields")).to_contain_text("left_ticks")


@pytest.mark.long
def test_recorded_bytes_decode_under_the_edited_file_before_it_is_saved_and_used(edited: Edited) -> None:
    page, text = edited.editor()
    page.get_by_role("tab", name="Findings").click()
    page.get_by_role("button", name="line ").first.click()
    at = text.evaluate("area => area.selectionStart")
    assert text.input_value()[at:].startswith("  - check: xor8")
    name = "left_wheel"
    text.fill(GOOD.replace("left_ticks", name))
    expect(page.locator(".results")).to_contain_text(f"{name} ")
    assert edited.file.read_text(encoding="utf-8") == GOOD
    page.get_by_role("button", name="Save", exact=True).click()
    expect(page.locator(".results")).to_contain_text("Written to")
    assert name in edited.file.read_text(encoding="utf-8")
    other = open_page(edited.browser, edited.console, "messages")  # of somebody else
    expect(other.locator("tr", has_text="odometry").locator(".fields")).to_contain_text("left_ticks")
    page.get_by_role("button", name="Connect with the edited file").click()
    page.keyboard.press("Escape")
    page.keyboard.press("2")
    for tab in (page, other):
        expect(tab.locator("tr", has_text="odometry").locator(".fields")).to_contain_text(name)


def test_a_file_with_an_error_is_refused_when_it_is_connected_and_nothing_else_changes(
    edited: Edited, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = edited.file.parent
    monkeypatch.chdir(folder)
    (folder / "broken.yaml").write_text(GOOD.replace("id: u8", "id: u9"), encoding="utf-8")
    page = open_page(edited.browser, edited.console, "link")
    page.get_by_label("Protocol file").select_option(str(folder / "broken.yaml"))
    page.get_by_label("Port", exact=True).fill(edited.link.port)
    page.get_by_role("button", name="Connect", exact=True).click()
    expect(page.get_by_role("log")).to_contain_text(f"broken.yaml:{LINE}:{COLUMN}")
    expect(page.locator("header .name")).to_have_text("diffdrive")
    assert edited.link.state == "up"


def test_keys_and_values_are_completed_from_the_schema(edited: Edited) -> None:
    page, text = edited.editor()
    text.fill(f"{GOOD}lin")
    page.keyboard.press("Control+End")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowRight")
    expect(page.get_by_role("group", name="Completions").get_by_role("button", name="link")).to_be_visible()
    page.keyboard.press("Tab")
    expect(text).to_have_value(f"{GOOD}link: ")
    expect(text).to_be_focused()
    page.keyboard.press("Escape")
    expect(text).not_to_be_focused()


def test_a_completion_is_written_before_the_next_key(edited: Edited) -> None:
    page, text = edited.editor()
    text.fill(f"lin\n{GOOD}")
    page.keyboard.press("Control+Home")
    for _ in "lin":
        page.keyboard.press("ArrowRight")
    expect(page.get_by_role("group", name="Completions").get_by_role("button", name="link")).to_be_visible()
    page.evaluate("window.requestAnimationFrame = () => 0")  # a busy computer draws nothing meanwhile
    page.keyboard.press("Tab")
    page.keyboard.type("{}")
    expect(text).to_have_value(f"link: {{}}\n{GOOD}")
    page.keyboard.press("Escape")
    expect(text).not_to_be_focused()
