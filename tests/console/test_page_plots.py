"""Plots in the browser: layouts that are kept and shared, zoom, pan, pause, the cursor's values, peaks that stay."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from bench.console_scrub import HOUR, PEAK, look
from playwright.sync_api import Browser, Page, expect

import wirebond
from tests.console.browser import DIFFDRIVE, Desk, noisy_robot, open_page, serious
from tests.waiting import wait_until
from wirebond.console import Console
from wirebond.generate.new.template import template_text
from wirebond.recording.history.history import History
from wirebond.recording.history.pixels import Pixels
from wirebond.server import Server

pytestmark = pytest.mark.live

# The plot follows the pointer from picture to picture.
_DRAWN = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"


def is_drawn(page: Page) -> None:
    expect(page.locator(".legend .value").first).to_have_text(re.compile(r"\d"))


# Every text that is drawn at the end of its place, with where it begins there: in a canvas nothing else tells it.
_TEXTS = """
window.texts = [];
const plain = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (text, x, y, ...more) {
  if (this.textAlign === "right") {
    const begins = this.getTransform().transformPoint({ x, y }).x - this.measureText(text).width;
    window.texts.push([text, begins]);
  }
  return plain.call(this, text, x, y, ...more);
};
"""


def range_of(page: Page) -> tuple[float, float]:
    found = re.search(r"from=([\d.]+)&to=([\d.]+)", page.url)
    assert found is not None, page.url
    return float(found[1]), float(found[2])


def test_a_layout_is_kept_for_its_protocol_and_shared_as_a_file(rover: Desk, tmp_path: Path) -> None:
    page = rover.page("plots")
    is_drawn(page)
    page.get_by_role("button", name="New plot").click()
    page.get_by_role("button", name="battery").click()
    page.get_by_label("Shown").select_option("60")
    expect(page.locator(".plot")).to_have_count(2)
    page.reload()
    expect(page.locator(".plot")).to_have_count(2)
    expect(page.locator(".plot").nth(1)).to_contain_text("status.battery")
    with page.expect_download() as download:
        page.get_by_role("button", name="Save layout").click()
    assert download.value.suggested_filename == "diffdrive-layout.json"
    file = tmp_path / "layout.json"
    download.value.save_as(file)

    other = rover.page("plots")  # another person's browser
    is_drawn(other)
    expect(other.locator(".plot")).to_have_count(1)
    other.locator("input[type=file]").set_input_files(file)
    expect(other.locator(".plot").nth(1)).to_contain_text("status.battery")
    expect(other.get_by_label("Shown")).to_have_value("60")
    layout = json.loads(file.read_text())
    layout["plots"].append({"fields": ["no.field"]})
    for content, said in ((json.dumps(layout), "no.field"), ("[1", "not a layout"), ('{"plots": 3}', "not a layout")):
        upload = {"name": "x.json", "mimeType": "application/json", "buffer": content.encode()}
        other.locator("input[type=file]").set_input_files([upload])  # type: ignore[list-item]
        expect(other.get_by_role("log")).to_contain_text(said)


def test_eight_series_have_eight_colours_that_a_reload_keeps(rover: Desk) -> None:
    page = rover.page("plots")
    is_drawn(page)
    fields = page.locator(".fields .field:not(.plotted)")
    while page.locator(".legend .entry").count() < 8:
        fields.nth(min(3, fields.count() - 1)).click()
    swatches = "found => found.map((one) => getComputedStyle(one).backgroundColor)"
    colours = page.locator(".legend .swatch").evaluate_all(swatches)
    assert len(set(colours)) == len(colours) == 8
    assert sorted(page.locator(".fields .plotted .swatch").evaluate_all(swatches)) == sorted(colours)
    page.get_by_role("button", name=re.compile("^Remove ")).nth(1).click()
    page.get_by_role("button", name=re.compile("^Remove ")).nth(1).click()
    kept = page.locator(".legend .swatch").evaluate_all(swatches)
    assert len(kept) == 6 and set(kept) < set(colours)
    page.reload()
    expect(page.locator(".legend .swatch")).to_have_count(6)
    assert page.locator(".legend .swatch").evaluate_all(swatches) == kept


def test_a_field_goes_into_the_chosen_plot_and_out_of_it(rover: Desk) -> None:
    page = rover.page("plots")
    is_drawn(page)
    plots = page.locator(".plot")
    fields = page.locator(".fields")
    battery = fields.get_by_role("button", name="battery")
    left = fields.get_by_role("button", name="left_ticks")
    page.get_by_role("button", name="New plot").click()
    expect(plots.nth(1)).to_contain_text("Click a field in the list, or drag it here.")
    left.click()  # it is in the first plot already
    expect(plots.nth(1)).to_contain_text("odometry.left_ticks")
    expect(plots.nth(0)).to_contain_text("odometry.left_ticks")
    left.click()
    expect(plots.nth(1)).to_contain_text("Click a field in the list")
    expect(plots.nth(0)).to_contain_text("odometry.left_ticks")
    battery.click()
    expect(plots.nth(1)).to_contain_text("status.battery")
    plots.nth(0).locator(".legend").click()
    battery.click()
    expect(plots.nth(0)).to_contain_text("status.battery")


def test_plots_that_fit_are_not_cut_off(rover: Desk) -> None:
    page = rover.page("plots")
    is_drawn(page)
    page.get_by_role("button", name="New plot").click()
    page.locator(".fields").get_by_role("button", name="battery").click()
    expect(page.locator(".plot").nth(1)).to_contain_text("status.battery")
    left = "(one) => one.scrollHeight - one.clientHeight"
    wait_until(lambda: page.locator(".plots").evaluate(left) <= 1, "everything fits")


def test_twelve_joints_are_twelve_lines_with_one_click(browser: Browser, tmp_path: Path) -> None:
    file = tmp_path / "legs.yaml"
    file.write_text(template_text("native", "legs", {"joints": 12}))
    with (
        wirebond.open(file, "sim:") as link,
        Server(link, tmp_path / "server.sock") as server,
        Console(port=0) as console,
    ):
        console.show(link, server)
        page = open_page(browser, console, "plots")
        is_drawn(page)
        expect(page.locator(".legend .entry")).to_have_count(12)  # a first plot has all of them, and not some
        velocities = page.get_by_role("button", name=re.compile(r"^joints\.velocity"))
        velocities.last.click()
        expect(page.locator(".plot")).to_have_count(2)
        lines = page.locator(".plot").nth(1).locator(".legend .entry")
        expect(lines).to_have_count(12)
        expect(lines.nth(11)).to_contain_text("joints[11].velocity")
        expect(lines.nth(11).locator(".value")).to_have_text(re.compile(r"\d"))
        expect(velocities.last).to_have_attribute("aria-pressed", "true")
        velocities.last.click()
        expect(page.locator(".legend .entry")).to_have_count(12)
        page.get_by_role("button", name="Elements of joint_states.joints.velocity").click()
        page.get_by_role("button", name="joints[3].velocity").click()
        expect(page.locator(".legend .entry")).to_have_count(13)
        assert serious(page) == []


def test_a_plot_is_zoomed_moved_paused_and_read_at_the_cursor(browser: Browser) -> None:
    with noisy_robot() as console:  # whose wheels turn all the time
        served = console.station.served
        assert served is not None
        wait_until(lambda: served.link.stats.receive.messages.get("odometry", 0) > 90, "a history of some seconds")
        zoom_move_pause_and_read(open_page(browser, console, "plots"))


def zoom_move_pause_and_read(page: Page) -> None:
    is_drawn(page)
    box = page.locator(".u-over").first.bounding_box()
    assert box is not None
    page.evaluate("document.querySelector('.u-over').dataset.made = 'once'")
    left, right, middle = box["x"] + 0.5 * box["width"], box["x"] + 0.9 * box["width"], box["y"] + box["height"] / 2
    page.mouse.move(left, middle)
    page.mouse.down()
    page.mouse.move(right, middle, steps=3)
    page.wait_for_function("least => document.querySelector('.u-select').offsetWidth >= least", arg=right - left - 2)
    page.mouse.up()
    expect(page).to_have_url(re.compile("from="))
    begin, end = range_of(page)
    assert end - begin == pytest.approx(0.4 * 10, rel=0.05)
    expect(page.locator("[data-from]").first).to_have_attribute("data-from", f"{begin:.4f}")
    page.evaluate(_DRAWN)
    box = page.locator(".u-over").first.bounding_box()  # the numbers of the axis may take more room than before
    assert box is not None
    page.keyboard.down("Shift")
    page.mouse.move(left, middle)
    page.mouse.down()
    page.mouse.move(left + box["width"] / 4, middle, steps=3)
    page.evaluate(_DRAWN)
    page.mouse.up()
    page.keyboard.up("Shift")
    earlier = pytest.approx(begin - (end - begin) / 4, abs=0.05)
    wait_until(lambda: range_of(page)[0] == earlier, "the range that it was moved to")
    moved = range_of(page)
    assert moved[1] - moved[0] == pytest.approx(end - begin, rel=1e-3)
    page.mouse.dblclick(left, middle)
    expect(page).not_to_have_url(re.compile("from="))
    page.keyboard.press("p")
    expect(page.get_by_role("button", name="Resume")).to_be_visible()
    position = page.locator(".position")
    expect(position).to_have_text(re.compile(r"^\d\d:\d\d:\d\d"))
    values = set()
    for share in range(5, 100, 5):  # percent of the plot: where a pause of this machine left a gap there is no value
        before = position.inner_text()
        page.mouse.move(box["x"] + share / 100 * box["width"], middle)
        expect(position).not_to_have_text(before)
        expect(position).to_have_text(re.compile(r"^\d\d:\d\d:\d\d\.\d{3}(?!\d)"))
        values.add(page.locator(".legend .value").first.inner_text())
    assert len(values - {"–"}) > 1  # noqa: RUF001
    page.get_by_role("button", name="Live", exact=True).click()
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    expect(page.locator(".u-over").first).to_have_attribute("data-made", "once")  # no range makes the plot anew


def test_the_numbers_of_an_axis_are_whole(browser: Browser, tmp_path: Path) -> None:
    file = tmp_path / "wide.yaml"
    file.write_text(re.sub(r"(left_ticks: .*)}", r"\1, offset: 2000000000}", DIFFDRIVE.read_text()))
    with noisy_robot(2_000_000_000, file) as console:
        page = open_page(browser, console, "link")
        page.add_init_script(_TEXTS)
        page.goto(page.url.replace("#/link", "#/plots"))
        page.reload()
        wide = "texts.filter(([text]) => /^2.000.000.\\d\\d\\d$/.test(text))"
        wait_until(lambda: page.evaluate(wide), "an axis with these numbers")
        page.evaluate("texts.length = 0")  # what was drawn before the axis knew its numbers
        wait_until(lambda: page.evaluate(wide), "an axis with these numbers")
        assert [text for text, begins in page.evaluate("texts") if begins < 0] == []


@pytest.mark.parametrize("rows_of_a_pixel", [1, 2])  # two: as while the numbers of an axis make the plot narrower
def test_the_picture_of_a_long_history_has_its_peaks(
    browser: Browser, rows_of_a_pixel: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    pixels = History.pixels

    def narrower(history: History, fields: Sequence[str], begin: float, end: float, width: float) -> list[Pixels]:
        return pixels(history, fields, begin, end, width / rows_of_a_pixel)

    monkeypatch.setattr(History, "pixels", narrower)
    found = look(browser, seconds=20.0, moves=3)
    assert found["greatest"] == PEAK
    assert len(found["answers"]) >= 3 * 3  # every movement was shown, with all of its lines


@pytest.mark.long
def test_an_hour_moves_under_the_hand_and_has_its_peaks(browser: Browser) -> None:
    found = look(browser, seconds=HOUR, moves=20)
    assert found["greatest"] == PEAK
    assert len(found["pauses"]) > 20
    assert len(found["answers"]) > 20  # every movement was shown, with all of its lines
