"""Libraries that read a stream, or both ends of a line: what Wirebond sends over a pty, and what they send to it."""

from __future__ import annotations

import asyncio
import threading
from types import SimpleNamespace
from typing import Any

import pycyphal.transport.serial
import pynmea2
import pytest
import serial
import sliplib
import yahdlc
from pycyphal.transport import (
    InputSessionSpecifier,
    MessageDataSpecifier,
    OutputSessionSpecifier,
    PayloadMetadata,
    Priority,
    ServiceDataSpecifier,
    Timestamp,
    Transfer,
)
from pyrtcm import RTCMReader
from pysbf2 import SBFReader
from spherov2.toy.bolt import BOLT

from tests.contrib.played import played
from tests.waiting import PATIENCE
from wirebond import Message

pytestmark = pytest.mark.live


@pytest.fixture
def port() -> Any:
    opened: list[serial.Serial] = []

    def open_port(path: str) -> serial.Serial:
        opened.append(serial.Serial(path, 115200, timeout=PATIENCE))
        return opened[-1]

    yield open_port
    for one in opened:
        one.close()


# ---- what only reads


def test_pynmea2_reads_a_position_and_wirebond_reads_its_sentences(port: Any) -> None:
    with played("nmea") as receiver:
        tty = port(receiver.path)
        receiver.link.send("sentence", text="GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,")
        found = pynmea2.parse(tty.readline().decode())
        assert (found.latitude, found.num_sats, found.altitude) == (pytest.approx(48.1173), "08", 545.4)
        tty.write(str(pynmea2.RMB("GP", "RMB", ("A", "0.66", "L"))).encode() + b"\r\n")
        assert receiver.last("sentence").fields == {"text": "GPRMB,A,0.66,L"}


def test_pyrtcm_reads_a_station_and_its_text(port: Any) -> None:
    with played("rtcm3") as station:
        reader = RTCMReader(port(station.path))
        station.link.send("antenna", {"descriptor": "TRM59800.00", "setup": 2}, header={"station": 2003})
        _, found = reader.read()
        assert (found.identity, found.DF003, found.DF031) == ("1007", 2003, 2)
        assert "".join(getattr(found, f"DF030_{n:02}") for n in range(1, 12)) == "TRM59800.00"


def test_pysbf2_reads_the_time_of_a_receiver(port: Any) -> None:
    with played("sbf") as receiver:
        reader = SBFReader(port(receiver.path))
        utc = [26, 11, 26, 10, 30, 15]
        receiver.link.send(
            "receiver_time", time_of_week=123.456, week=2400, utc=utc, leap_seconds=18, sync_level=["week"]
        )
        _, found = reader.read()
        assert (found.identity, found.TOW, found.WNc, found.UTCHour) == ("ReceiverTime", 123456, 2400, 10)
        assert (found.UTCSec, found.DeltaLS) == (15, 18)


# ---- both ways


def test_yahdlc_and_wirebond_acknowledge_each_others_frames(port: Any) -> None:
    with played("hdlc") as station:
        tty = port(station.path)
        tty.write(yahdlc.frame_data(b"~}hello", yahdlc.FRAME_DATA, 5))
        came = station.last("information")
        assert (came["data"], came.header["send"]) == (b"~}hello", 5)
        station.link.send("ready", header={"receive": 6})
        assert yahdlc.get_data(tty.read(6)) == (b"", yahdlc.FRAME_ACK, 6)
        station.link.send("information", header={"send": 3, "poll": 1}, data=b"}~")
        data = tty.read_until(b"~")
        data += tty.read_until(b"~")
        assert yahdlc.get_data(data) == (b"}~", yahdlc.FRAME_DATA, 3)
        tty.write(yahdlc.frame_data(b"", yahdlc.FRAME_NACK, 3))
        assert station.last("reject").header["receive"] == 3


def test_sliplib_and_wirebond_exchange_datagrams(port: Any) -> None:
    with played("slip") as peer:
        tty = port(peer.path)
        stream = sliplib.SlipStream(tty, 1)
        stream.send_msg(b"\xc0\xdb\xdc\xdd")
        assert peer.last("datagram").fields == {"data": b"\xc0\xdb\xdc\xdd"}
        peer.link.send("datagram", data=b"\xdb\xc0 back")
        assert stream.recv_msg() == b"\xdb\xc0 back"


def test_a_toy_of_spherov2_is_woken_driven_and_asked_for_its_battery() -> None:
    def answer_as(name: str, **values: Any) -> Any:
        def answer(message: Message) -> Any:
            flags = ["response", "activity"]
            header: dict[str, Any] = {"number": message.header["number"], "error": "success"}
            if "target" in message.header:  # the answer goes back to where the request came from
                flags += ["has_target", "has_source"]
                header |= {"target": message.header["source"], "source": message.header["target"]}
            return name, values, header | {"flags": flags}

        return answer

    class Adapter:
        """The Bluetooth characteristic, on a tty."""

        def __init__(self, path: str) -> None:
            self._tty = serial.Serial(path, 115200, timeout=0.01)
            self._is_over = False
            self._thread = threading.Thread(target=self._read)

        def set_callback(self, _: str, callback: Any) -> None:
            self._callback = callback
            self._thread.start()

        def write(self, characteristic: str, data: bytes) -> None:
            if characteristic == BOLT._send_uuid:  # another one takes a password, which a serial line has not
                self._tty.write(bytes(data))

        def _read(self) -> None:
            while not self._is_over:
                if data := self._tty.read(64):
                    self._callback("", data)

        def close(self) -> None:
            self._is_over = True
            self._thread.join()
            self._tty.close()

    answers = {
        "ping": answer_as("pong", data=b"\x8d\xab\xd8"),
        "read_battery": answer_as("battery", voltage=3.91),
        "wake": answer_as("woken"),
        "drive": answer_as("driving"),
    }
    with played("sphero", answers) as robot, BOLT(SimpleNamespace(address=robot.path, name="SB-1"), Adapter) as toy:
        toy.wake()
        assert bytes(toy.ping(b"\x8d\xab\xd8")) == b"\x8d\xab\xd8"
        assert toy.get_battery_voltage() == 3.91
        toy.drive_with_heading(120, 270, 0)
        assert robot.last("drive").fields == {"speed": 120, "heading": 270, "flags": []}
        assert len(robot.named("wake")) == 1


def test_a_cyphal_node_hears_pycyphal_and_answers_its_request() -> None:
    about = {
        "protocol_version": [1, 0],
        "hardware_version": [2, 1],
        "software_version": [3, 4],
        "software_revision": 7,
        "unique_id": bytes(range(16)),
        "name": "org.example.node",
        "software_crc": [],
        "certificate": b"",
    }

    def answer(message: Message) -> Any:
        return (
            "info",
            about,
            {"source": 9, "destination": message.header["source"], "transfer": message.header["transfer"]},
        )

    async def talk(path: str, node: Any) -> bytes:
        transport = pycyphal.transport.serial.SerialTransport(path, 42)
        kind = ServiceDataSpecifier(430, ServiceDataSpecifier.Role.REQUEST)
        asking = transport.get_output_session(OutputSessionSpecifier(kind, 9), PayloadMetadata(0))
        answered = ServiceDataSpecifier(430, ServiceDataSpecifier.Role.RESPONSE)
        listening = transport.get_input_session(InputSessionSpecifier(answered, 9), PayloadMetadata(448))
        beats = transport.get_input_session(
            InputSessionSpecifier(MessageDataSpecifier(7509), None), PayloadMetadata(12)
        )
        loop = asyncio.get_running_loop()
        reply = None
        for number in range(100):
            await asking.send(Transfer(Timestamp.now(), Priority.NOMINAL, number, []), loop.time() + 1)
            if (reply := await listening.receive(loop.time() + 0.5)) is not None:
                break
        assert reply is not None
        said = OutputSessionSpecifier(MessageDataSpecifier(7509), None)
        beat = transport.get_output_session(said, PayloadMetadata(12))
        payload = [memoryview(bytes([5, 0, 0, 0, 1, 2, 3]))]
        await beat.send(Transfer(Timestamp.now(), Priority.HIGH, 3, payload), loop.time() + 5)
        node.link.send(
            "heartbeat",
            {"uptime": 8, "health": "caution", "mode": "maintenance", "vendor_status": 9},
            header={"source": 9},
        )
        heard = await beats.receive(loop.time() + PATIENCE)
        assert heard is not None
        assert b"".join(map(bytes, heard.fragmented_payload)) == bytes([8, 0, 0, 0, 2, 2, 9])
        transport.close()
        return b"".join(map(bytes, reply.fragmented_payload))

    with played("cyphal_serial", {"get_info": answer}, listen="all") as node:
        payload = asyncio.run(talk(node.path, node))
        assert payload[:6] == bytes([1, 0, 2, 1, 3, 4])
        assert b"org.example.node" in payload
        heartbeat = node.last("heartbeat")
        assert heartbeat.fields == {"uptime": 5, "health": "advisory", "mode": "maintenance", "vendor_status": 3}
        assert (heartbeat.header["source"], heartbeat.header["priority"]) == (42, "high")
