"""A page that stalls sends nothing old, and the emergency stop leaves first."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.page.conftest import DIFFDRIVE, Rover, Seat, in_control, seat_of, worker_of
from tests.waiting import moments, wait_until
from wirebond.codec import Message, load
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live
STALL = """(ms) => {
  const written = globalThis.bytesWritten;
  const until = performance.now() + ms;
  while (performance.now() < until);
  return written;
}"""


def frames_in(data: bytes) -> list[Message]:
    decoder = load(DIFFDRIVE).decoder("host")
    return [*decoder.feed(data), *decoder.finish()]


@pytest.mark.parametrize(
    "seconds", [2, pytest.param(10, marks=pytest.mark.long), pytest.param(60, marks=pytest.mark.long)]
)
def test_a_worker_that_stood_still_sends_nothing_old(rover: Rover, seconds: int) -> None:
    """The key stays down all the while: commands of that time wait, and are too old when the worker goes on."""
    page = rover.seat.connected("control", is_patient=False)
    written = rover.seat.wire.written

    def speeds(data: bytes) -> list[float]:
        return [message["linear"] for message in frames_in(data) if message.name == "velocity"]

    for _ in moments("the stall begins while the robot drives"):  # it may have lost control just before, and stopped
        rover.drive(page)
        before = worker_of(page).evaluate(STALL, 1000 * seconds)  # bytes that had left when the stall began
        wait_until(lambda: len(written) >= before, "they have come")  # noqa: B023 it ends in this round
        if speeds(bytes(written[:before]))[-1] != 0:
            break
    expect(in_control(page)).not_to_be_visible()
    page.keyboard.up("ArrowUp")
    wait_until(lambda: 0 in speeds(bytes(written[before:])), "the safe value leaves")
    assert set(speeds(bytes(written[before:]))) == {0}


def velocities(seat: Seat, since: float) -> list[Message]:
    """Those that left since then."""
    left = b"".join(data for t, data in seat.wire.writes if t > since)
    return [message for message in frames_in(left) if message.name == "velocity"]


def test_a_page_that_stalls_loses_control(rover: Rover) -> None:
    """Its worker goes on, and sends the safe value."""
    page = rover.seat.connected("control", is_patient=False)
    rover.drive(page)
    since = time.monotonic()
    page.evaluate(STALL, 2000)
    rover.robot.wait_for(lambda velocity: velocity.linear == 0, since)
    expect(in_control(page)).not_to_be_visible()
    page.keyboard.up("ArrowUp")


def test_a_hidden_tab_gives_control_up(rover: Rover) -> None:
    page = rover.seat.connected("control")
    rover.drive(page)
    since = time.monotonic()
    page.evaluate(
        "Object.defineProperty(document, 'hidden', { get: () => true }); "
        "document.dispatchEvent(new Event('visibilitychange'))"
    )
    rover.robot.wait_for(lambda velocity: velocity.linear == 0, since)
    expect(in_control(page)).not_to_be_visible()
    page.keyboard.up("ArrowUp")


@pytest.mark.parametrize("reloads", [False, True])
def test_a_stop_holds_after_a_new_connection(rover: Rover, reloads: bool) -> None:
    """Also in a page that was loaded again. That one did not stop the robot: it asks twice before it releases."""
    page = rover.seat.connected("control")
    rover.drive(page)
    page.keyboard.press("Space")
    banner = page.get_by_role("alert").filter(has_text="Emergency stop")
    expect(banner).to_be_visible()
    page.keyboard.up("ArrowUp")
    page.locator("nav").get_by_text("Link", exact=True).click()
    page.get_by_role("button", name="Disconnect").click()
    expect(banner).not_to_be_visible()  # there is no robot to stop
    if reloads:
        page.reload()
    begun = time.monotonic()
    page.get_by_role("button", name="again").click()
    expect(banner).to_be_visible()
    wait_until(lambda: velocities(rover.seat, begun), "the stop is sent again")
    banner.get_by_role("button", name="Release the stop").click()
    if reloads:
        banner.get_by_role("button", name="Yes, release the stop by console").click()
    expect(banner).not_to_be_visible()
    page.reload()
    page.get_by_role("button", name="again").click()
    expect(page.locator("header .state")).to_contain_text("Up")
    expect(banner).not_to_be_visible()


@pytest.fixture
def slow_seat(diffdrive_page: Path, browser: Browser) -> Iterator[Seat]:
    """A port at which nothing answers. At 1200 baud a frame takes 90 ms."""
    pty = PtyPort()
    with seat_of(diffdrive_page, browser) as made:
        made.wire.device = pty.path
        yield made
    pty.close()


def test_the_emergency_stop_is_the_first_to_leave_a_full_queue(slow_seat: Seat) -> None:
    page = slow_seat.open("link")
    page.get_by_label("Baud rate").fill("1200")
    page.get_by_role("button", name="Choose a serial port").click()
    expect(page.get_by_role("button", name="Disconnect")).to_be_visible()
    page.locator("nav").get_by_text("Control", exact=True).click()
    page.locator("header").get_by_role("button", name="Take control").click()
    expect(in_control(page)).to_be_visible()
    form = page.locator("form", has=page.get_by_role("button", name="Send")).filter(has_text="status_query").first
    for _ in range(30):
        form.get_by_role("button", name="Send").first.click()
    written = slow_seat.wire.written
    wait_until(lambda: len(frames_in(bytes(written))) >= 2, "the queue drains")
    began = len(written)
    page.keyboard.press("Space")
    expect(page.get_by_role("alert").first).to_be_visible()
    wait_until(lambda: any(m.name == "velocity" for m in frames_in(bytes(written))), "the stop leaves")
    names = [message.name for message in frames_in(bytes(written))]
    begun = len(frames_in(bytes(written[:began])))
    waited = list(itertools.takewhile(lambda name: name != "velocity", names[begun:]))
    assert len(waited) <= 2, names  # the frame on the line, and the one that had just been handed to the port
