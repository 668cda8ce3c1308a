"""Parameters of a firmware in a page without a server: read, set, and refused by the robot."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.console.test_tuning import Tuning, compiled
from tests.page.conftest import seat_of, write_page
from wirebond.sim.process import FirmwareProcess

pytestmark = pytest.mark.live


def test_a_parameter_is_read_set_and_refused(tmp_path: Path, browser: Browser) -> None:
    program = compiled("axis", "linear_axis", tmp_path)
    folder = write_page(tmp_path / "page", "linear_axis")
    with FirmwareProcess(program, "axis") as process, seat_of(folder, browser) as seat:
        seat.wire.device = str(process.port)
        axis = Tuning(seat.connected("tuning"))
        row = axis.row("acceleration")
        expect(row).to_contain_text("as read back")
        axis.has("acceleration", 5)
        axis.set(acceleration=2)
        axis.has("acceleration", 2)
        assert [line.partition(" ")[2] for line in process.events(5)] == ["parameter 1 is 2.000"]
        axis.set(acceleration=50)
        expect(row).to_contain_text("refused: out_of_range")
        axis.has("acceleration", 2)
