"""The rover's firmware under virtual time: its deadlines strike to the millisecond, and every run is the same."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.shared import codec, rover_program
from wirebond.errors import WirebondError
from wirebond.sim.lockstep import LockstepFirmware

pytestmark = pytest.mark.live

DIFFDRIVE = codec("diffdrive")
BYTE_S = 10 / 115200


@pytest.fixture(scope="module")
def program() -> Path:
    return rover_program()


def velocity(linear: float) -> bytes:
    return DIFFDRIVE.encode("velocity", linear=linear, angular=0)


def test_deadlines_strike_a_second_and_three_after_the_last_command(program: Path) -> None:
    with LockstepFirmware(program) as firmware:
        firmware.advance(0.5)
        firmware.events.clear()
        firmware.send(velocity(0.5))
        firmware.advance(0.99)
        assert [e.text for e in firmware.events if "stop" in e.text or "safe" in e.text] == []
        firmware.advance(2.5)
        times = {e.text: e.t - 0.5 for e in firmware.events}
        assert times["stop"] == pytest.approx(1.0, abs=0.0021)  # the poll that finds it, and the one before the bytes
        assert times["safe_mode"] == pytest.approx(3.0, abs=0.0021)
        assert firmware.now == pytest.approx(3.99)


def test_silence_is_measured_from_the_last_velocity(program: Path) -> None:
    with LockstepFirmware(program) as firmware:
        firmware.send(velocity(0.2))
        firmware.advance(0.5)
        firmware.events.clear()
        for _ in range(8):  # a slow rhythm: no deadline may strike in between
            firmware.send(velocity(0.2))
            firmware.advance(0.95)
        assert [e.text for e in firmware.events if "stop" in e.text] == []
        firmware.advance(0.1)
        assert [e.text for e in firmware.events if "stop" in e.text] == ["stop"]


def test_a_command_moves_the_rover_and_its_operator_stops_it(program: Path) -> None:
    with LockstepFirmware(program) as firmware:
        decoder = DIFFDRIVE.decoder("mcu")

        def odometry(seconds: float) -> list[int]:
            """Ticks of each 50 ms, with a command every 50 ms."""
            ticks = []
            for _ in range(round(seconds / 0.05)):
                firmware.send(velocity(1.0))
                ticks += [m["left_ticks"] for m in decoder.feed(firmware.advance(0.05)) if m.name == "odometry"]
            return ticks

        assert odometry(1.0)[-1] > 0
        firmware.tell("estop on")
        assert odometry(1.0)[-1] == 0
        firmware.send(DIFFDRIVE.encode("status_query"))
        (status,) = (m for m in decoder.feed(firmware.advance(0.02)) if m.name == "status")
        assert status["state"] == ["estop"]
        assert sum(decoder.stats.discarded_bytes.values()) == 0


def test_the_same_calls_give_the_same_bytes_and_events(program: Path) -> None:
    def drive() -> tuple[list[bytes], list[object]]:
        with LockstepFirmware(program) as firmware:
            sent = []
            for i in range(100):
                if i % 30 < 20:
                    firmware.send(velocity(i / 100), delay=i * 1e-5)
                sent.append(firmware.advance(0.1))
            return sent, list(firmware.events)

    once = drive()
    assert once == drive()
    assert sum(map(len, once[0])) > 1000


def test_a_frame_leaves_when_the_line_has_carried_it(program: Path) -> None:
    """Polls are a millisecond apart, and odometry takes 0.955 ms of the line: it comes just before the next poll."""
    with LockstepFirmware(program) as firmware:
        step = 1e-5
        came = [firmware.now % 0.001 for _ in range(20_000) if firmware.advance(step)]
        assert len(came) >= 2
        assert came == [pytest.approx(11 * BYTE_S, abs=1.1 * step)] * len(came)


def test_a_firmware_that_ended_is_reported(program: Path) -> None:
    firmware = LockstepFirmware(program, "the rover")
    firmware._process.kill()
    with pytest.raises(WirebondError, match="the rover has ended"):
        firmware.advance(1)
    firmware._process.wait()
