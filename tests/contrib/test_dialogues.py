"""Dialogues over a port between a format's own library and Wirebond, which answers from the other end of the line."""

from __future__ import annotations

import contextlib
import io
import threading
from pathlib import Path

import pytest
from brping import Ping1D
from crsf_parser.handling import crsf_build_frame

import wirebond
from tests.contrib.cases import CONTRIB
from tests.contrib.played import asked_again
from tests.link.test_role_mcu import line
from tests.waiting import wait_until
from wirebond import Message

pytestmark = pytest.mark.live


def test_a_ping1d_is_asked_for_its_distance_by_the_library_of_its_maker() -> None:
    codec = wirebond.load(CONTRIB / "ping_sonar.yaml")
    with line() as (a, b), wirebond.open(codec, b.path, role="mcu") as sonar:

        @sonar.on("general_request")
        def answer_version(message: Message) -> None:
            if message["requested"] == 5:
                sonar.send("protocol_version", major=1, minor=0, patch=2, reserved=0)

        @sonar.on("request_general_info")
        def answer_info(_: Message) -> None:
            info = {"firmware_major": 3, "firmware_minor": 28, "voltage": 5.0, "ping_interval": 0.1}
            sonar.send("general_info", info, gain_setting=1, automatic=1)

        @sonar.on("request_distance")
        def answer_distance(_: Message) -> None:
            scan = {"scan_start": 0.1, "scan_length": 5.0, "gain_setting": 2}
            sonar.send("distance", scan, distance=1.234, confidence=90, transmit_duration=200e-6, ping_number=7)

        host = Ping1D()
        with contextlib.redirect_stdout(io.StringIO()):
            host.connect_serial(a.path, 115200)
        assert asked_again(lambda: host.initialize() or None)
        found = asked_again(host.get_distance)
        host.iodev.close()
    assert (found["distance"], found["confidence"], found["transmit_duration"]) == (1234, 90, 200)
    assert (found["ping_number"], found["scan_start"], found["scan_length"], found["gain_setting"]) == (7, 100, 5000, 2)


def test_a_sonar_is_asked_for_its_distance_as_the_library_does() -> None:
    codec = wirebond.load(CONTRIB / "ping_sonar.yaml")
    assert codec.encode("request_distance", header={"source": 0, "destination": 0}) == bytes.fromhex(
        "42 52 00 00 BC 04 00 00 54 01"  # Ping1D.get_distance() of bluerobotics-ping
    )


@pytest.mark.parametrize("start", [0xC8, 0xEE, 0xEA, 0xEC])
def test_crsf_frames_for_every_device_arrive(start: int) -> None:
    """A handset's frames begin with 0xEE, those of its module with 0xEA."""
    codec = wirebond.load(CONTRIB / "crsf.yaml")
    frame = bytes([start]) + bytes(crsf_build_frame(0x16, {"channels": [992] * 16}))[1:]
    arrived = threading.Event()
    with line() as (a, b), wirebond.open(codec, b.path, role="mcu") as module:

        @module.on("channels")
        def take(message: Message) -> None:
            if message.header["magic"] == start:
                arrived.set()

        with Path(a.path).open("wb", buffering=0) as handset:
            handset.write(frame)
            wait_until(arrived.is_set, "the frame arrives")
