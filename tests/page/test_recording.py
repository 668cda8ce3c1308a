"""Wirebond reads the recordings of a page; and the page shows the values that Wirebond finds in the same bytes."""

from __future__ import annotations

import csv
import itertools
import json
import random
import re
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

import wirebond
from tests.page.conftest import DIFFDRIVE, Rover, Seat, seat_of
from tests.shared import few_or_many
from tests.streams import damaged, random_values
from tests.waiting import let_pass, wait_until
from wirebond.protocol.model import End
from wirebond.recording.recording import Recording
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live
_TOGETHER = 80  # frames
COMMAND = str(Path(sys.executable).with_name("wirebond"))


@pytest.fixture
def seat(diffdrive_page: Path, browser: Browser) -> Iterator[tuple[Seat, PtyPort]]:
    pty = PtyPort()
    with seat_of(diffdrive_page, browser) as made:
        made.wire.device = pty.path
        yield made, pty
    pty.close()


def noisy_stream(count: int) -> list[bytes]:
    """Frames of the robot; some are damaged, and noise is between them. Each is one piece: a pause inside a frame, as a
    busy machine makes one, would rightly end it."""
    codec, source = wirebond.load(DIFFDRIVE), random.Random(count)
    messages = [message for message in codec.model.messages if message.sent_by(End.MCU)]
    out = []
    for _ in range(count):
        message = source.choice(messages)
        frame = codec.encode(message.name, random_values(message, source))
        out.append(damaged(frame, source) if source.random() < 0.02 else frame)
        if source.random() < 0.02:
            out.append(source.randbytes(source.randrange(1, 30)))
    return out


def downloaded(page: Page, label: str, message: str, to: Path) -> list[dict[str, str]]:
    with page.expect_download() as found:
        page.get_by_label(label).select_option(message)
    found.value.save_as(to)
    with to.open(newline="") as file:
        return list(csv.DictReader(file))


def closed_recording(page: Page) -> Locator:
    """Wait until the newest recording is closed: then its name stands alone, without a state."""
    name = page.locator("tbody tr td").first
    expect(name).to_have_text(re.compile(r"\.mcap$"))
    return name


def kept_recording(page: Page, to: Path) -> Recording:
    """Download the only recording, once it is closed: before, a download has what was written until then."""
    closed_recording(page)
    with page.expect_download() as found:
        page.get_by_role("button", name="MCAP").click()
    found.value.save_as(to)
    return Recording(to)


def opened_row(page: Page, message: str) -> Locator:
    """Open the only recording, and find the last message of this name."""
    page.get_by_role("button", name="Open", exact=True).click()
    page.locator("nav").get_by_text("Messages", exact=True).click()
    return page.get_by_role("row").filter(has_text=message)


@contextmanager
def monitored() -> Iterator[tuple[PtyPort, Iterator[dict[str, Any]]]]:
    """A port, and what `wirebond monitor --json` prints of what comes there."""
    pty = PtyPort()
    command = [COMMAND, "monitor", str(DIFFDRIVE), pty.path, "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    pty.wait_for_program()
    try:
        yield pty, (found for line in process.stdout if "message" in (found := json.loads(line)))
    finally:
        process.kill()
        process.wait()
        pty.close()


def feed(pty: PtyPort, stream: list[bytes], printed: Callable[[], int] | None = None) -> None:
    """Write all of it, as fast as the other side reads: a pty drops what has no room. A program that prints messages is
    given at most 20 000 that it has not `printed`: it keeps 65 536, and drops older ones."""
    for at in range(0, len(stream), _TOGETHER):
        if printed is not None:
            wait_until(lambda at=at: at < printed() + 20_000, "the other side prints")
        pty.write(b"".join(stream[at : at + _TOGETHER]))
        wait_until(lambda: not pty.unread(), "the other side reads")
    assert pty.lost_bytes == 0


@few_or_many(3_000, 100_000)
def test_every_value_is_the_one_that_monitor_prints(seat: tuple[Seat, PtyPort], tmp_path: Path, number: int) -> None:
    made, pty = seat
    stream = noisy_stream(number)
    decoder = wirebond.load(DIFFDRIVE).decoder("mcu")
    sent = [*decoder.feed(b"".join(stream)), *decoder.finish()]
    expected: dict[str, list[dict[str, Any]]] = defaultdict(list)
    page = made.connected("recordings")
    page.get_by_role("button", name="Record", exact=True).click()
    expect(page.get_by_role("button", name="Stop recording")).to_be_visible()
    with monitored() as (port, lines):
        printed = 0
        writing = threading.Thread(target=feed, args=(port, stream, lambda: printed))
        writing.start()
        for line in itertools.islice(lines, len(sent)):
            expected[line["message"]].append(line["fields"])
            printed += 1
        writing.join()
    feed(pty, stream)
    page.locator("nav").get_by_text("Link", exact=True).click()
    frames = page.locator("tr", has_text="frames").first
    wait_until(lambda: re.sub(r"\D", "", frames.inner_text()) == str(len(sent)), "all frames")
    page.locator("nav").get_by_text("Recordings", exact=True).click()
    page.get_by_role("button", name="Stop recording").click()
    name = closed_recording(page)
    label = f"CSV: {name.inner_text()}"
    compared = 0
    for message, values in expected.items():
        rows = downloaded(page, label, message, tmp_path / f"{message}.csv")
        assert len(rows) == len(values)
        for found, fields in zip(rows, values, strict=True):
            for column, text in found.items():
                path = column.partition(" [")[0].partition(".")[2]
                if path in fields and isinstance(fields[path], (int, float)):
                    assert float(text) == fields[path], (message, column)
                    compared += 1
    assert compared > number


def test_a_recording_is_opened_again_and_read_by_wirebond(rover: Rover, tmp_path: Path) -> None:
    page = rover.seat.connected("recordings")
    page.get_by_role("button", name="Record", exact=True).click()
    expect(page.get_by_role("button", name="Stop recording")).to_be_visible()
    page.locator("nav").get_by_text("Control", exact=True).click()
    rover.drive(page)
    page.keyboard.up("ArrowUp")
    page.locator("nav").get_by_text("Recordings", exact=True).click()
    page.get_by_role("button", name="Stop recording").click()
    recording = kept_recording(page, tmp_path / "run.mcap")
    sent = [message for message in recording.messages("host") if message.name == "velocity"]
    assert any(message["linear"] > 0 for message in sent)
    assert {"lease_begun", "control"} <= {event.kind for event in recording.events}
    assert subprocess.run([COMMAND, "info", str(recording.path)], check=False, capture_output=True).returncode == 0
    row = opened_row(page, "velocity")
    expect(row).to_contain_text(sent[-1].raw.hex(" ").upper())
    page.reload()  # the browser keeps it
    expect(row).to_contain_text(sent[-1].raw.hex(" ").upper())


def test_a_browser_that_deletes_recordings_is_named(rover: Rover) -> None:
    page = rover.seat.connected("recordings")
    record, stop = (page.get_by_role("button", name=name, exact=True) for name in ("Record", "Stop recording"))
    record.click()
    stop.click()
    closed_recording(page)
    page.evaluate("""async () => {
      const root = await navigator.storage.getDirectory();
      await root.removeEntry("wirebond recordings", { recursive: true });
    }""")
    record.click()
    expect(page.get_by_text("the browser has deleted the recordings of this page")).to_be_visible()
    record.click()
    stop.click()
    closed_recording(page)
    expect(page.locator("tbody tr")).to_have_count(1)


@pytest.mark.long
def test_ten_minutes_are_recorded_and_opened_again(rover: Rover, tmp_path: Path) -> None:
    page = rover.seat.connected("recordings", is_patient=False)
    page.get_by_role("button", name="Record", exact=True).click()
    expect(page.get_by_role("button", name="Stop recording")).to_be_visible()
    let_pass(600)
    page.get_by_role("button", name="Stop recording").click()
    name = closed_recording(page)
    recording = kept_recording(page, tmp_path / "run.mcap")
    expected = [message for message in recording.messages("mcu") if message.name == "odometry"]
    assert expected[-1].t - expected[0].t > 590
    rows = downloaded(page, f"CSV: {name.inner_text()}", "odometry", tmp_path / "odometry.csv")
    assert len(rows) == len(expected)
    expect(opened_row(page, "odometry")).to_contain_text(expected[-1].raw.hex(" ").upper())
