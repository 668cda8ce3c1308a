"""pyubx2 and pynmeagps as real programs: they read what Wirebond sends, and Wirebond reads what they send."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import serial
from pynmeagps import GET, NMEAMessage, NMEAReader
from pyubx2 import SET, UBXMessage, UBXReader

import wirebond
from tests.contrib.cases import CONTRIB
from tests.peers.cable import cable, device
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.live

MANY = 200


@pytest.fixture
def opened() -> Iterator[Any]:
    """Opens ttys as those libraries' users do."""
    ports: list[serial.Serial] = []

    def open_port(path: str) -> serial.Serial:
        ports.append(serial.Serial(path, 115200, timeout=PATIENCE))
        return ports[-1]

    yield open_port
    for port in ports:
        port.close()


def received(link: wirebond.Link, number: int) -> list[wirebond.Message]:
    found: list[wirebond.Message] = []
    wait_until(lambda: found.extend(link.receive(0.1)) or len(found) >= number, "all messages")
    return found


def test_pyubx2_reads_every_position_of_a_firmware_and_is_acknowledged(tmp_path: Path, opened: Any) -> None:
    with device("ubx", tmp_path) as path:
        port = opened(path)
        reader = UBXReader(port, protfilter=2)
        found = [reader.read()[1] for _ in range(MANY)]
        first = found[0].iTOW // 1000  # earlier ones went before this end was open
        for n, message in enumerate(found, first):
            assert message.identity == "NAV-POSLLH"
            assert (message.iTOW, message.height) == (1000 * n, -1000 * n)
            assert (round(message.lon * 1e7), round(message.lat * 1e7)) == (n, -n)
        for solutions, expected in ((1, "ACK-ACK"), (0, "ACK-NAK")):
            port.write(UBXMessage("CFG", "CFG-RATE", SET, measRate=100, navRate=solutions, timeRef=1).serialize())
            answer = next(m for _, m in reader if m.identity != "NAV-POSLLH")
            assert (answer.identity, answer.clsID, answer.msgID) == (expected, 6, 8)


def test_a_link_reads_every_position_of_pyubx2_and_configures_it(opened: Any) -> None:
    proto = wirebond.load(CONTRIB / "ubx.yaml")
    with cable() as (here, there), wirebond.open(proto, here) as link:
        port = opened(there)
        for n in range(MANY):
            message = UBXMessage("NAV", "NAV-POSLLH", 0, iTOW=n, height=-n, hAcc=n)
            port.write(message.serialize())
        found = received(link, MANY)
        assert [(m.name, m.fields["time_of_week"], m.fields["height"]) for m in found] == [
            ("nav_posllh", pytest.approx(n / 1000), pytest.approx(-n / 1000)) for n in range(MANY)
        ]
        link.send("cfg_rate", measurement_period=0.1, time_reference="galileo")
        _, configured = UBXReader(port, msgmode=SET).read()
        assert (configured.measRate, configured.navRate, configured.timeRef) == (100, 1, 4)
        port.write(UBXMessage("ACK", "ACK-ACK", 0, clsID=6, msgID=8).serialize())
        (answer,) = received(link, 1)
        assert (answer.name, answer.fields) == ("ack_ack", {"message": 0x0608})
        assert link.stats.receive.discarded_bytes == dict.fromkeys(link.stats.receive.discarded_bytes, 0)


def test_pynmeagps_reads_every_sentence_of_a_firmware_and_gets_its_own_back(tmp_path: Path, opened: Any) -> None:
    with device("nmea", tmp_path) as path:
        port = opened(path)
        reader = NMEAReader(port)
        headings = [reader.read()[1].headingT for _ in range(40)]
        assert headings == [headings[0] + n for n in range(40)]
        port.write(NMEAMessage("GP", "GLL", GET, lat=48.25, lon=11.5, status="A").serialize())
        back = next(m for _, m in reader if m.msgID == "GLL")
        assert (back.lat, back.lon, back.status) == (48.25, 11.5, "A")


def test_a_link_reads_every_sentence_of_pynmeagps_and_sends_it_some(opened: Any) -> None:
    proto = wirebond.load(CONTRIB / "nmea.yaml")
    with cable() as (here, there), wirebond.open(proto, here) as link:
        port = opened(there)
        sentences = [NMEAMessage("GP", "HDT", GET, headingT=n + 0.5, headingTu="T") for n in range(MANY)]
        for sentence in sentences:
            port.write(sentence.serialize())
        assert [m.fields["text"] for m in received(link, MANY)] == [s.serialize()[1:-5].decode() for s in sentences]
        reader = NMEAReader(port)
        for n in range(20):
            link.send("sentence", text=f"SDDPT,{n}.5,0.3,100.0")
            _, message = reader.read()
            assert (message.identity, message.depth, message.offset) == ("SDDPT", n + 0.5, 0.3)
