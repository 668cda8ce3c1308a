"""Sensors, radios and controllers: the libraries that speak to them ask a device that Wirebond plays over a pty."""

from __future__ import annotations

import re
import threading
from typing import Any

import pytest
import serial
from digi.xbee.devices import RemoteXBeeDevice, XBeeDevice
from digi.xbee.models.address import XBee64BitAddress
from digi.xbee.models.hw import HardwareVersion
from flySkyiBus.IBus import IBus
from pymsp.msp import MSPStreamProcessor, MSPv1, MSPv2
from sensirion_shdlc_driver import ShdlcConnection, ShdlcDevice, ShdlcSerialPort
from sensirion_shdlc_driver.errors import ShdlcDeviceError
from tfmini import TFmini
from tsip import GPS, Packet

from tests.contrib.oracles.vesc import VESC
from tests.contrib.played import Answer, asked_again, asked_until, played
from tests.waiting import PATIENCE, wait_until
from wirebond import Message

pytestmark = pytest.mark.live


@pytest.fixture
def port() -> Any:
    """Opens ttys as a library's users do."""
    opened: list[serial.Serial] = []

    def open_port(path: str) -> serial.Serial:
        opened.append(serial.Serial(path, 115200, timeout=0.5))
        return opened[-1]

    yield open_port
    for one in opened:
        one.close()


# ---- flight controllers


@pytest.mark.parametrize("version", [1, 2])
def test_a_flight_controller_answers_pymsp_in_the_version_of_its_request(version: int, port: Any) -> None:
    answers: dict[str, Answer] = {
        "read_attitude": lambda _: ("attitude", {"roll": -12.5, "pitch": 3.1, "heading": 270}),
        "read_battery": lambda _: ("failed", {}, {"id": 110}),
    }
    with played("msp", answers) as board:
        tty, asking, answered = port(board.path), {1: MSPv1(), 2: MSPv2()}, MSPStreamProcessor()

        def ask(number: int, version: int) -> bytes:
            tty.write(asking[version].pack(number, b""))
            return tty.read(64)

        def attitude(version: int) -> tuple[int, int, bytes] | None:
            frames = list(answered.push_bytes(ask(108, version)))
            return (frames[-1].protocol_version, frames[-1].message_id, frames[-1].payload) if frames else None

        tty.timeout = 0.05
        for spoken in (version, 3 - version, version):  # it follows each request
            asked_until(lambda spoken=spoken: attitude(spoken), (spoken, 108, bytes.fromhex("83FF 1F00 0E01")))
        # an error reply, which the library does not read, has the form of that version, too
        errors = {1: [b"$M!"], 2: [b"$X!"]}
        asked_until(lambda: re.findall(rb"\$[MX]!", ask(110, version))[-1:], errors[version])


# ---- motor controllers


def test_pyvesc_drives_a_motor_and_reads_its_measurements() -> None:
    measured = {
        "transistor_temperature": 31.5, "motor_temperature": 40.2, "motor_current": -1.25, "input_current": 0.5,
        "current_d": 0.01, "current_q": -0.02, "duty_cycle": -0.25, "speed": -4200, "input_voltage": 24.1,
        "charge_drawn": 1.5, "charge_returned": 0.25, "energy_drawn": 12.5, "energy_returned": 2.5, "steps": -7,
        "steps_of_both_ways": 9, "fault": 0, "position": 12.5, "controller": 3, "phase_temperatures": [0, 0],
        "rest": bytes(11),  # the library waits for more than 72 bytes, and newer firmware sends them
    }  # fmt: skip
    answers: dict[str, Answer] = {
        "read_version": lambda _: ("version", {"major": 5, "minor": 2, "rest": b"410\0"}),
        "get_values": lambda _: ("values", measured),
    }
    with played("vesc", answers) as controller:
        with VESC(controller.path, has_sensor=True, start_heartbeat=False) as motor:
            found = motor.get_measurements()
            assert (found.rpm, found.v_in, found.temp_fet, found.duty_cycle_now) == (-4200, 24.1, 31.5, -0.25)
            assert (found.avg_motor_current, found.pid_pos_now, found.tachometer_abs) == (-1.25, 12.5, 9)
            assert motor.get_firmware_version().startswith("5.2.")
            motor.set_rpm(3000)
            motor.set_current(1.5)
            motor.set_duty_cycle(0.5)
            motor.set_servo(0.25)
            assert controller.last("set_servo").fields == {"position": 0.25}
            motor.start_heartbeat()
            controller.last("alive")
        assert controller.last("show_position").fields == {"mode": "off"}
        assert controller.last("set_speed").fields == {"speed": 3000}
        assert controller.last("set_current").fields == {"current": 1.5}
        assert controller.last("set_duty_cycle").fields == {"duty_cycle": 0.5}


# ---- sensors


def test_the_tfmini_library_sets_up_the_lidar_and_reads_its_distance() -> None:
    is_over = threading.Event()
    with played("tfmini", {"configure": lambda m: ("configured", {n: m[n] for n in ("mode", "command")})}) as lidar:

        def measure() -> None:
            while not is_over.wait(0.002):
                lidar.link.send("measurement", distance=1.23, strength=400, mode=2)

        thread = threading.Thread(target=measure)
        thread.start()
        try:
            sensor = asked_again(lambda: TFmini(lidar.path, mode=TFmini.STD_MODE))
            asked_until(sensor.read, 1.23)
            assert sensor.strength == 400
            sensor.close()
        finally:
            is_over.set()
            thread.join()
        sent = {("settings", 1), ("output", 1), ("settings", 0)}
        wait_until(lambda: sent <= {(m["command"], m["mode"]) for m in lidar.named("configure")}, "it is set up")


def test_sensirions_driver_reads_and_sets_a_device() -> None:
    texts = {"product_name": "SPS30", "serial_number": "A1B2", "article_code": "1-101", "product_type": "00080000"}

    def about(message: Message) -> Any:
        if message["which"] == "product_subtype":
            return "information", {"text": "\x05"}, {"device": 3, "state": 0}
        return "information", {"text": texts[message["which"]] + "\0"}, {"device": 3, "state": 0}

    def to(name: str, **values: Any) -> Answer:
        return lambda _: (name, values, {"device": 3, "state": 0})

    answers: dict[str, Answer] = {
        "read_information": about,
        "read_version": to("version", firmware=[2, 3], hardware=7, protocol=[2, 0]),
        "read_error_state": to("error_state", errors=0x11, last_error=0x7E),
        "read_address": to("address", address=3),
        "set_address": to("address_set"),
        "read_baud": to("baud", baud=115200),
        "set_baud": to("baud_set"),
        "read_reply_delay": to("reply_delay", delay=0.0005),
        "set_reply_delay": to("reply_delay_set"),
        "read_up_time": to("up_time", up_time=0x7D7E1113),  # every byte of it is escaped
    }
    with (
        played("sensirion_shdlc", answers, listen="all") as sensor,
        ShdlcSerialPort(sensor.path, 115200, additional_response_time=0.5) as tty,
    ):
        device = ShdlcDevice(ShdlcConnection(tty), slave_address=3)
        asked_until(device.get_product_name, "SPS30")
        asked_until(device.get_serial_number, "A1B2")
        asked_until(device.get_article_code, "1-101")
        asked_until(lambda: device.get_product_type(as_int=True), 0x80000)
        asked_until(device.get_product_subtype, 5)
        version = asked_again(device.get_version)
        assert (version.firmware.major, version.firmware.minor, version.hardware.major) == (2, 3, 7)
        asked_until(lambda: device.get_error_state(clear=True), (0x11, 0x7E))
        assert sensor.last("read_error_state").fields == {"clear": True}
        asked_until(device.get_slave_address, 3)
        asked_until(device.get_baudrate, 115200)
        asked_until(device.get_reply_delay, 500)
        asked_until(device.get_system_up_time, 0x7D7E1113)
        asked_again(lambda: [device.set_slave_address(9, update_driver=False)])
        asked_again(lambda: [device.set_baudrate(9600, update_driver=False)])
        asked_again(lambda: [device.set_reply_delay(250)])
        assert sensor.last("set_address").fields == {"address": 9}
        assert sensor.last("set_baud").fields == {"baud": 9600}
        assert sensor.last("set_reply_delay").fields == {"delay": 250e-6}


def test_sensirions_driver_reports_what_a_device_refuses() -> None:
    def refuse(_: Message) -> Any:
        return "version", {"firmware": [0, 0], "hardware": 0, "protocol": [0, 0]}, {"device": 0, "state": 0x04}

    with (
        played("sensirion_shdlc", {"read_version": refuse}) as sensor,
        ShdlcSerialPort(sensor.path, 115200, additional_response_time=30) as tty,
    ):
        with pytest.raises(ShdlcDeviceError) as refused:
            ShdlcDevice(ShdlcConnection(tty), slave_address=0).get_version()
        assert refused.value.error_code == 4


# ---- receivers


def test_the_tsip_library_asks_a_receiver_for_its_version_and_time(port: Any) -> None:
    version = [1, 2, 3, 4, 99, 5, 6, 16, 16, 100]  # 16 is DLE: it is doubled
    answers: dict[str, Answer] = {
        "read_software_version": lambda _: ("software_version", {"version": version}),
        "read_time": lambda _: ("time", {"seconds": 12.5, "week": 0x1010, "utc_offset": 18.0}),
    }
    with played("tsip", answers) as receiver:
        gps = GPS(port(receiver.path))

        def ask(request: Packet) -> list[Any]:
            gps.write(request)
            return list(gps.read().fields)

        asked_until(lambda: ask(Packet(0x1F)), [0x45, *version])
        asked_until(lambda: ask(Packet(0x21)), [0x41, 12.5, 0x1010, 18.0])
        gps.write(Packet(0x31, 0.5, -1.5, 16.0))
        assert receiver.last("set_first_position").fields == {"place": [0.5, -1.5, 16.0]}


def test_the_ibus_library_reads_the_channels_that_wirebond_sends() -> None:
    wanted = [1000 + 50 * n for n in range(14)]
    with played("ibus") as receiver:
        radio = IBus(receiver.path)
        receiver.link.repeat("channels", hold=30, channels=[n * 1e-6 for n in wanted])
        assert list(radio.read())[2:-1] == wanted
        radio.serial.close()


# ---- radios


@pytest.mark.parametrize("escaped", [False, True])
@pytest.mark.parametrize("firmware", [b"\x20\x11", b"\x10\x0d"], ids=["802.15.4", "zigbee"])
def test_digis_library_opens_a_radio_sends_and_receives(escaped: bool, firmware: bytes) -> None:
    is_zigbee = firmware[0] == 0x10
    parameters = {
        "AP": b"\2" if escaped else b"\1",
        "HV": bytes([HardwareVersion.XBEE3.code, 0x41]),
        "VR": firmware,
        "SH": b"\0\x13\xa2\0",
        "SL": b"\x40\x7d\x11\x13",
        "NI": b"rover",
        "MY": b"\xff\xfe",
        "CE": b"\0",
        "SM": b"\0",
    }

    def respond(message: Message) -> Any:
        command, number = message["command"], message["frame_id"]
        if message["value"]:
            parameters[command] = message["value"]
            return "at_response", {"frame_id": number, "command": command, "status": "ok", "value": b""}
        value = parameters.get(command, b"\0")
        return "at_response", {"frame_id": number, "command": command, "status": "ok", "value": value}

    def delivered(message: Message) -> Any:
        return "transmit_status", {
            "frame_id": message["frame_id"], "network_address": 0x1234, "retries": 0, "delivery": 0,
            "discovery": "none",
        }  # fmt: skip

    def respond_far(message: Message) -> Any:
        values = {name: message[name] for name in ("frame_id", "network_address", "command")}
        far = {"source": message["destination"], "status": "ok", "value": b"far"}
        return "remote_at_response", values | far

    answers: dict[str, Answer] = {
        "at_command": respond,
        "at_command_queued": respond,
        "transmit_request": delivered,
        "transmit_64": lambda m: ("transmitted", {"frame_id": m["frame_id"], "status": 0}),
        "remote_at_command": respond_far,
    }
    with played("xbee_api_2" if escaped else "xbee_api", answers) as modem:
        radio = XBeeDevice(modem.path, 9600)
        radio.set_sync_ops_timeout(2)

        def opened() -> bool:
            try:
                radio.open()
            except Exception:
                radio.close()
                raise
            return True

        try:
            assert asked_again(opened)
            assert (radio.get_node_id(), str(radio.get_64bit_addr())) == ("rover", "0013A200407D1113")
            asked_again(lambda: [radio.set_node_id("other")])
            assert parameters["NI"] == b"other"
            asked_again(lambda: [radio.set_parameter("ID", b"\x7e\x7d")])
            assert parameters["ID"] == b"\x7e\x7d"
            asked_until(lambda: radio.get_parameter("ID"), b"\x7e\x7d")
            there = RemoteXBeeDevice(radio, XBee64BitAddress.from_hex_string("0013A20011223344"))
            assert asked_again(lambda: radio.send_data(there, b"\x11\x13hello")).transmit_status.code == 0
            sent = modem.last("transmit_request" if is_zigbee else "transmit_64")
            assert (sent["data"], sent["destination"]) == (b"\x11\x13hello", 0x0013A20011223344)
            assert bytes(asked_again(lambda: there.get_parameter("NI"))) == b"far"
            came = {"source": 0x0013A20011223344, "options": 1, "data": b"\x7d!"}
            if is_zigbee:
                modem.link.send("receive_packet", came, network_address=1)
            else:
                modem.link.send("received_64", came, strength=-40)
            read = radio.read_data(PATIENCE)
            assert bytes(read.data) == b"\x7d!"
            assert str(read.remote_device.get_64bit_addr()) == "0013A20011223344"
        finally:
            radio.close()
