"""Firmwares are tuned in the tuning view, in Chromium: the firmware's own code with a simulated body, on a pty."""

from __future__ import annotations

import contextlib
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Locator, Page, TimeoutError, expect

import wirebond
from tests.console.browser import Robot, open_page, real_time, take_control
from tests.shared import PROTOCOLS, ROOT, codec
from tests.suspended import Suspended
from tests.waiting import PATIENCE, moments, wait_until
from wirebond.console import Console
from wirebond.generate.code import generate_cpp
from wirebond.server import Server
from wirebond.sim.process import FirmwareProcess

pytestmark = pytest.mark.live

FIRMWARE = ROOT / "firmware"


@dataclass
class Tuning:
    """A page that shows the tuning view."""

    page: Page

    def row(self, parameter: str) -> Locator:
        return self.page.get_by_role("row").filter(has=self.page.get_by_role("slider", name=f"{parameter}, "))

    def has(self, parameter: str, value: float) -> None:
        """It is read back."""
        text = re.compile(rf"^{re.escape(format(value, 'g'))}(\.?0*)$")
        expect(self.row(parameter).locator("td.number").first).to_have_text(text)

    def set(self, **values: float) -> None:
        for name, value in values.items():
            self.page.get_by_role("spinbutton", name=name, exact=True).fill(str(value))
        self.page.get_by_role("button", name="Send changes").click()

    def button(self, name: str) -> Locator:
        return self.page.get_by_role("button", name=name, exact=True)

    def figure(self, name: str) -> float:
        """Return a figure of the step test, without its unit."""
        figure = self.page.locator(".figures div", has=self.page.get_by_text(name, exact=True)).locator("dd")
        return float(figure.inner_text().replace("\u2212", "-").split()[0])

    def save(self, name: str) -> None:
        """The wanted values as a named set."""
        self.page.get_by_role("textbox", name="Name of the set").fill(name)
        self.button("Save these values").click()


@dataclass
class Bench(Tuning):
    """And the firmware that is tuned, with its link."""

    process: FirmwareProcess
    link: wirebond.Link


def compiled(name: str, protocol: str, folder: Path) -> Path:
    """The firmware of this name for this computer."""
    generate_cpp(wirebond.load(PROTOCOLS / f"{protocol}.yaml").model, folder)
    includes = [folder, FIRMWARE, FIRMWARE / name, ROOT / "ports" / "posix" / "include"]
    source, program = FIRMWARE / name / "host" / "main.cpp", folder / name
    command = ["g++", "-std=c++17", "-O0", "-pthread", *(f"-I{one}" for one in includes), str(source), "-o"]
    subprocess.run([*command, str(program)], check=True)
    return program


@contextmanager
def bench(name: str, protocol: str, folder: Path, browser: Browser) -> Iterator[Bench]:
    program = compiled(name, protocol, folder)
    with (
        FirmwareProcess(program, name) as process,
        shown(process.port, protocol, folder, browser) as (link, page),
    ):
        yield Bench(page, process, link)


@contextmanager
def shown(port: str | Path, protocol: str, folder: Path, browser: Browser) -> Iterator[tuple[wirebond.Link, Page]]:
    problems: list[str] = []
    with (
        wirebond.open(codec(protocol), str(port)) as link,
        Server(link, folder / "server.sock") as server,
        Console(port=0) as console,
    ):
        console.show(link, server)
        page = open_page(browser, console, "tuning", problems)
        yield link, page
        page.context.close()
    assert problems == []


def samples(link: wirebond.Link, message: str, field: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of the last seconds, as the link has them."""
    found = [entry for entry in link.dump().entries if entry.message is not None and entry.message.name == message]
    return np.array([entry.t for entry in found]), np.array([entry.message[field] for entry in found if entry.message])


def swing(link: wirebond.Link, seconds: float) -> float:
    """The largest lean of the balance bot in its last seconds."""
    t, pitch = samples(link, "attitude", "pitch")
    return float(np.abs(pitch[t > t[-1] - seconds]).max())


def text_of(page: Page, button: str) -> str:
    """Return the text of the file that this button saves."""
    with page.expect_download() as download:
        page.get_by_role("button", name=button, exact=True).click()
    return download.value.path().read_text()


@pytest.mark.long
def test_a_balance_bot_that_falls_is_tuned_until_it_stands(tmp_path: Path, browser: Browser) -> None:
    with bench("balance", "pid_tuner", tmp_path, browser) as bot:
        page = bot.page
        page.get_by_role("combobox", name="Shown").select_option("2 s")
        expect(bot.row("p")).to_contain_text("as read back")
        bot.set(p=2)
        bot.has("p", 2)
        wait_until(lambda: swing(bot.link, 0.2) > 0.5, "it falls")
        bot.button("Measure now").click()
        assert bot.figure("maximum") - bot.figure("minimum") > 0.4

        bot.set(p=10, i=0.1, d=0.3)
        bot.has("p", 10)
        bot.has("i", 0.1)
        bot.has("d", 0.3)
        page.get_by_role("spinbutton", name="idx").fill("1")
        page.get_by_role("spinbutton", name="idx").blur()
        bot.has("p", 0)
        bot.set(p=0.2)
        bot.has("p", 0.2)
        expect(bot.row("i")).to_contain_text("the robot has another value")  # p/200, whatever is sent
        bot.has("i", 0.001)
        wait_until(lambda: swing(bot.link, 2.5) < 0.01, "it stands")
        bot.button("Measure now").click()
        _, pitch = samples(bot.link, "attitude", "pitch")
        assert abs(bot.figure("maximum")) < 0.01
        assert bot.figure("Final value") == pytest.approx(pitch[-50:].mean(), abs=2e-3)
        assert bot.figure("Spread (rms)") < 0.005


def test_an_axis_is_tuned_by_the_parameter_service_and_a_step_says_what_it_does(
    tmp_path: Path, browser: Browser
) -> None:
    with bench("axis", "linear_axis", tmp_path, browser) as axis:
        page, row = axis.page, axis.row("acceleration")
        expect(row).to_contain_text("as read back")
        axis.has("acceleration", 5)
        axis.save("hard")
        row.get_by_role("slider").fill("2")
        expect(row).to_contain_text("changed here, not sent")
        axis.has("acceleration", 5)
        assert axis.process.events() == []
        axis.button("Send changes").click()
        expect(row).to_contain_text("as read back")
        axis.has("acceleration", 2)
        assert [line.partition(" ")[2] for line in axis.process.events(5)] == ["parameter 1 is 2.000"]
        axis.save("soft")
        axis.set(acceleration=50)
        expect(row).to_contain_text("refused: out_of_range")
        axis.has("acceleration", 2)

        with real_time(page):
            found = step(axis, to=0.4)
        assert found.rise == pytest.approx(0.8 * 0.4 / 2, abs=0.02)  # the ramp that was set
        assert axis.figure("Rise time") / 1000 == pytest.approx(found.rise, abs=0.02)
        assert axis.figure("Settling time") / 1000 > found.settling - 0.08  # and the way of the command to the robot
        assert axis.figure("Overshoot") / 100 == pytest.approx(found.overshoot, abs=0.01)
        assert axis.figure("Steady error") == pytest.approx(found.to - found.final, abs=0.002)

        page.get_by_text("hard", exact=True).locator("..").get_by_role("button", name="Compare").click()
        expect(page.get_by_role("columnheader", name="hard")).to_be_visible()
        expect(row.locator("td.number.warn")).to_have_text(re.compile(r"^5(\.0*)?$"))  # it differs
        expect(axis.row("max_speed").locator("td.number.warn")).to_have_count(0)
        page.get_by_text("soft", exact=True).locator("..").get_by_role("button", name="Restore").click()
        expect(row.get_by_role("spinbutton")).to_have_value("2")
        page.get_by_text("hard", exact=True).locator("..").get_by_role("button", name="Restore").click()
        expect(row).to_contain_text("changed here, not sent")
        exported = text_of(page, "Export YAML")
        assert "acceleration: 5\n" in exported
        given = exported.replace("acceleration: 5\n", "acceleration: 4\n").encode()
        page.locator("input[type=file]").set_input_files({"name": "team.yaml", "mimeType": "", "buffer": given})
        page.get_by_text("team", exact=True).locator("..").get_by_role("button", name="Compare").click()
        expect(row.locator("td.number.warn")).to_have_text(re.compile(r"^4(\.0*)?$"))  # beside that of `hard`
        assert "inline constexpr float acceleration = 5.0F;\n" in text_of(page, "Export C++")
        assert axis.process.events() == []
        axis.button("Send changes").click()
        axis.has("acceleration", 5)


def test_a_robot_that_answers_late_is_read_without_a_hand(tmp_path: Path, browser: Browser) -> None:
    with bench("axis", "linear_axis", tmp_path, browser) as axis:
        axis.has("acceleration", 5)
        asked: set[float] = set()

        def was_asked_again() -> bool:
            entries = axis.link.dump().entries
            asked.update(e.t for e in entries if e.message is not None and e.message.name == "parameter_read")
            return len(asked) > 6  # three before the robot was silent

        def says_that_nothing_came() -> bool:
            found = axis.page.get_by_role("alert").all_inner_texts()
            return any("no parameter_value within" in text for text in found)

        pause = None
        while pause is None or pause.has_run:
            with Suspended(axis.process.pid) as pause:
                axis.page.reload()
                wait_until(
                    lambda over=pause: over.has_run or (says_that_nothing_came() and was_asked_again()),
                    "the page says that nothing came, and asks again and again",
                )
        axis.has("acceleration", 5)


@pytest.mark.long
def test_a_robot_that_has_started_again_is_read_again(tmp_path: Path, browser: Browser) -> None:
    robot = Robot(tmp_path, "linear_axis")
    try:
        with shown(robot.port, "linear_axis", tmp_path, browser) as (_, page):
            axis = Tuning(page)
            axis.has("acceleration", 0)
            axis.set(acceleration=2)
            axis.has("acceleration", 2)
            robot.kill()
            expect(page.locator("header").get_by_role("status")).to_contain_text("Down")
            robot.start()
            axis.has("acceleration", 0)
    finally:
        robot.kill()


@dataclass
class Response:
    """Figures of a step to this value, from what the link sent and received."""

    to: float
    final: float
    rise: float
    overshoot: float
    settling: float


LONGEST_GAP = 0.05  # seconds between two samples, which the axis sends every 10 ms


def response(link: wirebond.Link, to: float) -> Response | None:
    """Measure the last step of the axis. None: it was not held for the whole time, or samples of it are missing."""
    sent = [(e.t, e.message["speed"]) for e in link.dump().entries if e.message and e.message.name == "move"]
    stepped = [t for (_, before), (t, speed) in pairwise(sent) if before == 0 and speed == pytest.approx(to)][-1]
    ended = next((t for t, speed in sent if t > stepped and speed == 0), np.inf)
    t, speed = samples(link, "state", "speed")
    t, speed = t[(t >= stepped) & (t < ended)] - stepped, speed[(t >= stepped) & (t < ended)]
    if t.size == 0 or t[-1] < 0.9 or np.diff(t, prepend=0).max() > LONGEST_GAP or np.any(np.diff(speed / to) < 0):
        return None
    final = speed[t > 0.75 * t[-1]].mean()
    share = speed / final
    return Response(
        to,
        final,
        np.interp(0.9, share, t) - np.interp(0.1, share, t),
        max(0.0, share.max() - 1),
        t[np.flatnonzero(np.abs(share - 1) > 0.05)[-1] + 1],
    )


def step(axis: Bench, to: float) -> Response:
    """Run the step until it was whole.

    On a busy machine the server may not hear the page for 0.3 s. Then it ends the page's control, as it must, at any
    moment: before the press, which the button then refuses, or while the step runs. Each attempt goes back where the
    last one came from, because the rail has ends.
    """
    axis.page.get_by_role("spinbutton", name="Seconds").fill("1")
    run = axis.button("Run the step")
    reason = axis.page.get_by_text("take control first")
    panel = axis.page.locator(".panel", has=run)
    seen: list[str] = []
    for _ in moments(lambda: f"a step that is whole; {len(seen)} attempts, the last: {seen[-3:]}", 3 * PATIENCE):
        expect(run.or_(reason).first).to_be_visible()
        if reason.is_visible():  # the page says beside the button why it cannot be pressed
            take_control(axis.page)
        axis.page.get_by_role("spinbutton", name="To").fill(str(to))
        with contextlib.suppress(TimeoutError):  # it was disabled between the look and the press
            run.click(timeout=1000)
            expect(axis.page.get_by_text("The step runs")).not_to_be_visible()
            if axis.page.get_by_text("Rise time").is_visible() and (found := response(axis.link, to)):
                return found
            to = -to
        seen.append(panel.inner_text())
    raise AssertionError
