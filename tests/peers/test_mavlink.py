"""pymavlink as a real program, in both roles: every message arrives, and its own counter of lost packets stays at 0."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common

import wirebond
from tests.contrib.cases import CONTRIB
from tests.peers.cable import cable, device
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.live

MANY = 600  # more than a sequence number counts


@contextmanager
def connection(path: str, system: int, component: int) -> Iterator[Any]:
    mavutil.set_dialect("common")
    made = mavutil.mavlink_connection(
        path, baud=57600, source_system=system, source_component=component, force_connected=True
    )
    try:
        yield made
    finally:
        made.close()


def test_a_link_and_pymavlink_hear_all_of_each_other() -> None:
    proto = wirebond.load(CONTRIB / "mavlink.yaml")
    with cable() as (here, there), wirebond.open(proto, here) as link, connection(there, 1, 1) as vehicle:
        assert isinstance(vehicle, mavutil.mavserial)
        vehicle.mav = common.MAVLink(vehicle, srcSystem=1, srcComponent=1)
        vehicle.mav.robust_parsing = True
        found: list[wirebond.Message] = []
        for n in range(MANY):
            vehicle.mav.attitude_send(n, 0.25, -0.5, n / 1024, 0.0, 0.0, 0.0)
            if n % 50 == 0:
                found += link.receive(0.1)
        wait_until(lambda: found.extend(link.receive(0.1)) or len(found) >= MANY, "all messages")
        assert [(m.fields["time_since_boot"], m.fields["angles"], m.header["sequence"]) for m in found] == [
            (pytest.approx(n / 1000), [0.25, -0.5, n / 1024], n % 256) for n in range(MANY)
        ]
        for n in range(MANY):
            params = [n, 0, 0, 0, 0, 0, 0]
            link.send("command_long", params=params, command=400, target_system=1, target_component=1)
            if n % 50 == 49:
                heard = [vehicle.recv_match(type="COMMAND_LONG", blocking=True, timeout=PATIENCE) for _ in range(50)]
                assert [(h.param1, h.command, h.get_srcSystem()) for h in heard] == [
                    (m, 400, 255) for m in range(n - 49, n + 1)
                ]
        assert (vehicle.mav_loss, vehicle.packet_loss()) == (0, 0)
        heard_of = link.stats.receive.sequence
        assert heard_of is not None
        assert (heard_of.numbered, heard_of.gaps, heard_of.repeats, heard_of.restarts) == (MANY, 0, 0, 0)


def test_pymavlink_hears_every_message_of_a_firmware_and_its_commands_are_acknowledged(tmp_path: Path) -> None:
    with device("mavlink", tmp_path) as path, connection(path, 255, 190) as station:
        attitude = station.recv_match(type="ATTITUDE", blocking=True, timeout=PATIENCE)
        first = attitude.time_boot_ms // 1000  # earlier ones went before this end was open
        for n in range(first + 1, first + MANY // 2):
            attitude = station.recv_match(type="ATTITUDE", blocking=True, timeout=PATIENCE)
            assert (attitude.time_boot_ms, attitude.roll, attitude.pitch, attitude.yaw) == (1000 * n, 0.25, -0.5, 1.0)
            assert (attitude.get_srcSystem(), attitude.get_srcComponent()) == (1, 1)
        for command in range(50):
            station.mav.command_long_send(1, 1, command, 0, *[0.0] * 7)
            ack = station.recv_match(type="COMMAND_ACK", blocking=True, timeout=PATIENCE)
            assert (ack.command, ack.result) == (command, 0)
        assert (station.mav_loss, station.packet_loss()) == (0, 0)
