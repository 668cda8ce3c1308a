"""Servo buses: the libraries of their makers drive servos that Wirebond plays over a pty."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import dynamixel_sdk
import pytest
import scservo_sdk
from dynamixel_sdk import GroupBulkRead, GroupBulkWrite, GroupSyncRead, GroupSyncWrite
from lewanlib.bus import ServoBus

from tests.contrib.played import Answer, Played, asked_again, asked_until, played
from wirebond import Message

pytestmark = pytest.mark.live

SERVOS = (1, 2)


# ---- LX-16A


def test_lewanlib_sets_a_servo_and_reads_everything_back() -> None:
    kept: dict[str, Mapping[str, Any]] = {}

    def keeps(name: str) -> Answer:
        return lambda message: kept.update({name: message.fields})

    def says(name: str, **values: Any) -> Answer:
        return lambda message: (name, values or kept[name], {"servo": message.header["servo"]})

    answers = {
        "move": keeps("last_move"),
        "read_move": says("last_move"),
        "move_later": keeps("waiting_move"),
        "read_move_later": says("waiting_move"),
        "adjust_offset": keeps("offset"),
        "read_offset": says("offset"),
        "set_angle_limits": keeps("angle_limits"),
        "read_angle_limits": says("angle_limits"),
        "set_voltage_limits": keeps("voltage_limits"),
        "read_voltage_limits": says("voltage_limits"),
        "set_temperature_limit": keeps("temperature_limit"),
        "read_temperature_limit": says("temperature_limit"),
        "set_mode": keeps("mode"),
        "read_mode": says("mode"),
        "power": keeps("power_state"),
        "read_power": says("power_state"),
        "set_light": keeps("light"),
        "read_light": says("light"),
        "set_alarms": keeps("alarms"),
        "read_alarms": says("alarms"),
        "read_temperature": says("temperature", temperature=41),
        "read_voltage": says("voltage", voltage=7.4),
        "read_angle": says("angle", angle=-2.4),
    }
    with played("lx16a", answers, listen="all") as device:
        bus = ServoBus(device.path, timeout=0.5, discard_echo=False)
        servo = bus.get_servo(3)
        servo.move_time_write(120, 1.5)
        asked_until(servo.move_time_read, (120, 1.5))
        assert device.named("move")[0].header == {"servo": 3}
        assert device.named("move")[0].fields == {"angle": 120, "duration": 1.5}
        servo.move_time_wait_write(24, 0.25)
        asked_until(servo.move_time_wait_read, (24, 0.25))
        servo.move_start()
        servo.move_stop()
        servo.angle_offset_adjust(-12)
        asked_until(servo.angle_offset_read, -12)
        servo.angle_limit_write(24, 216)
        asked_until(servo.angle_limit_read, (24, 216))
        servo.vin_limit_write(5, 8.5)
        asked_until(servo.vin_limit_read, (5, 8.5))
        servo.temp_max_limit_write(70, "C")
        asked_until(lambda: servo.temp_max_limit_read("C"), 70)
        servo.mode_write("motor", -500)
        asked_until(servo.mode_read, ("motor", -500))
        servo.set_powered(True)
        asked_until(lambda: [servo.is_powered()], [True])
        servo.led_ctrl_write(False)
        asked_until(lambda: [servo.led_ctrl_read()], [False])
        servo.led_error_write(stalled=True, over_voltage=False, over_temp=True)
        asked_until(servo.led_error_read, (True, False, True))
        assert device.named("set_alarms")[-1].fields == {"alarms": ["over_temperature", "stalled"]}
        asked_until(lambda: servo.temp_read("C"), 41)
        asked_until(servo.vin_read, 7.4)
        asked_until(servo.pos_read, -2.4)
        servo.id_write(9)
        assert device.last("set_number").fields == {"number": 9}
        assert [len(device.named(name)) for name in ("start", "stop", "save_offset")] == [1, 1, 1]
        bus.serial_conn.close()


# ---- Dynamixel, and Feetech, whose frame is the same


class Memory:
    """The memory of two servos, and their answers to reading and writing."""

    def __init__(self) -> None:
        self.of = {number: bytearray(256) for number in SERVOS}

    def write(self, number: int, address: int, data: bytes) -> None:
        self.of[number][address : address + len(data)] = data

    def number(self, servo: int, address: int, size: int) -> int:
        return int.from_bytes(self.of[servo][address : address + size], "little")


def answers_of(memory: Memory, status: Mapping[str, Any]) -> dict[str, Answer]:
    """To what every servo is asked."""

    def reply(message: Message, data: bytes = b"") -> Any:
        servo = message.header["servo"]
        return ("status", {**status, "data": data}, {"servo": servo}) if servo in memory.of else None

    def read(message: Message) -> Any:
        servo, address = message.header["servo"], message["address"]
        return reply(message, bytes(memory.of[servo][address : address + message["size"]]))

    def write(message: Message) -> Any:
        memory.write(message.header["servo"], message["address"], message["data"])
        return reply(message)

    def sync_write(message: Message) -> None:
        step = message["size"] + 1
        for at in range(0, len(message["data"]), step):
            number, *data = message["data"][at : at + step]
            memory.write(number, message["address"], bytes(data))

    quiet = dict.fromkeys(("write_later", "factory_reset", "reboot", "clear_turns"), reply)
    return {"ping": reply, "read": read, "write": write, "sync_write": sync_write, **quiet}


def several(device: Played, memory: Memory, servos: Any, address: int, size: int, **status: Any) -> None:
    """Each of these servos answers with a part of its memory."""
    for servo in servos:
        data = bytes(memory.of[servo][address : address + size])
        device.link.send("status", status, data=data, header={"servo": servo})


@contextmanager
def opened(path: str) -> Iterator[dynamixel_sdk.PortHandler]:
    port = dynamixel_sdk.PortHandler(path)
    port.openPort()
    yield port
    port.closePort()


def good(result: Any) -> Any:
    """Value of a call that succeeded; None: it did not."""
    *values, outcome, error = result if isinstance(result, tuple) else (result, 0)
    return (values[0] if values else True) if outcome == 0 and error == 0 else None


def test_the_dynamixel_sdk_reads_and_writes_servos_of_protocol_1() -> None:
    memory = Memory()
    memory.write(1, 0, (29).to_bytes(2, "little"))  # a ping reads the model number
    with played("dynamixel_1", answers_of(memory, {}), listen="all") as device, opened(device.path) as port:

        @device.link.on("bulk_read")
        def answer(message: Message) -> None:
            for one in message["reads"]:
                several(device, memory, [one["servo"]], one["address"], one["size"])

        servos = dynamixel_sdk.PacketHandler(1.0)
        asked_until(lambda: good(servos.ping(port, 1)), 29)
        asked_until(lambda: good(servos.write2ByteTxRx(port, 1, 30, 512)) and memory.number(1, 30, 2), 512)
        asked_until(lambda: good(servos.read2ByteTxRx(port, 1, 30)), 512)
        assert asked_again(lambda: good(servos.write4ByteTxRx(port, 2, 100, 0xFF00FF00)))
        asked_until(lambda: good(servos.read4ByteTxRx(port, 2, 100)), 0xFF00FF00)
        assert asked_again(lambda: good(servos.regWriteTxRx(port, 1, 30, 2, [1, 2])))
        assert device.last("write_later").fields == {"address": 30, "data": b"\1\2"}
        servos.action(port, dynamixel_sdk.BROADCAST_ID)
        assert device.last("action").header["servo"] == 0xFE
        assert asked_again(lambda: good(servos.factoryReset(port, 2)))

        group = GroupSyncWrite(port, servos, 30, 2)
        for number in SERVOS:
            group.addParam(number, [number, 3])
        group.txPacket()
        assert device.last("sync_write").fields == {"address": 30, "size": 2, "data": bytes([1, 1, 3, 2, 2, 3])}

        def read_both() -> tuple[list[int], list[int]] | None:  # GroupBulkRead of this version calls it wrongly
            servos.bulkReadTx(port, [2, 1, 30, 4, 2, 100], 6)
            first, outcome, _ = servos.readRx(port, 1, 2)
            second, outcome_of_second, _ = servos.readRx(port, 2, 4)
            port.is_using = False
            return None if outcome or outcome_of_second else (first, second)

        asked_until(read_both, ([1, 3], [0, 0xFF, 0, 0xFF]))


def test_the_dynamixel_sdk_reads_and_writes_servos_of_protocol_2() -> None:
    memory = Memory()
    fine = {"error": {"reason": "none", "alert": False}}
    with played("dynamixel_2", answers_of(memory, fine), listen="all") as device, opened(device.path) as port:

        @device.link.on("sync_read")
        def answer(message: Message) -> None:
            several(device, memory, message["servos"], message["address"], message["size"], **fine)

        @device.link.on("bulk_read")
        def answer_bulk(message: Message) -> None:
            for one in message["reads"]:
                several(device, memory, [one["servo"]], one["address"], one["size"], **fine)

        @device.link.on("bulk_write")
        def write(message: Message) -> None:
            data = message["data"]
            while data:
                servo, address, size = data[0], *(int.from_bytes(data[i : i + 2], "little") for i in (1, 3))
                memory.write(servo, address, data[5 : 5 + size])
                data = data[5 + size :]

        servos = dynamixel_sdk.PacketHandler(2.0)
        memory.write(1, 100, b"\xff\xff\xfd\x01")  # a byte is inserted; the library does not insert it itself
        asked_until(lambda: good(servos.read4ByteTxRx(port, 1, 100)), 0x01FDFFFF)
        assert asked_again(lambda: good(servos.write4ByteTxRx(port, 1, 116, 0x7F010203)))
        asked_until(lambda: good(servos.read4ByteTxRx(port, 1, 116)), 0x7F010203)
        assert asked_again(lambda: good(servos.write1ByteTxRx(port, 2, 64, 1)))
        asked_until(lambda: good(servos.read1ByteTxRx(port, 2, 64)), 1)
        assert asked_again(lambda: good(servos.regWriteTxRx(port, 1, 116, 4, [1, 2, 3, 4])))
        servos.action(port, dynamixel_sdk.BROADCAST_ID)
        assert device.last("action").header["servo"] == 0xFE
        assert asked_again(lambda: good(servos.reboot(port, 1)))
        assert asked_again(lambda: good(servos.clearMultiTurn(port, 1)))
        assert asked_again(lambda: good(servos.factoryReset(port, 1, 0x02)))
        assert device.last("factory_reset").fields == {"option": "all_but_id_and_baud"}

        group = GroupSyncWrite(port, servos, 116, 4)
        for number in SERVOS:
            group.addParam(number, [number, 0, 0, 0])
        group.txPacket()
        reading = GroupSyncRead(port, servos, 116, 4)
        for number in SERVOS:
            reading.addParam(number)

        def read_each() -> list[int] | None:
            return good(reading.txRxPacket()) and [reading.getData(number, 116, 4) for number in SERVOS]

        asked_until(read_each, [1, 2])

        writing = GroupBulkWrite(port, servos)
        writing.addParam(1, 64, 1, [1])
        writing.addParam(2, 116, 4, [4, 3, 2, 1])
        writing.txPacket()
        bulk = GroupBulkRead(port, servos)
        bulk.addParam(1, 64, 1)
        bulk.addParam(2, 116, 4)

        def read_both() -> list[int] | None:
            return good(bulk.txRxPacket()) and [bulk.getData(1, 64, 1), bulk.getData(2, 116, 4)]

        asked_until(read_both, [1, 0x01020304])


def test_a_dynamixel_of_protocol_2_says_its_model_to_a_ping() -> None:
    model = {"error": {"reason": "none", "alert": False}, "data": bytes([0x24, 0x04, 45])}  # XM430, firmware 45
    with (
        played("dynamixel_2", {"ping": lambda m: ("status", model, {"servo": 1})}, listen="all") as device,
        opened(device.path) as port,
    ):
        servos = dynamixel_sdk.PacketHandler(2.0)
        asked_until(lambda: good(servos.ping(port, 1)), 0x424)
        asked_until(lambda: servos.broadcastPing(port)[0] or None, {1: [0x424, 45]})
        assert device.named("ping")[-1].header["servo"] == 0xFE


def test_the_feetech_sdk_moves_and_reads_servos() -> None:
    memory = Memory()
    with played("feetech", answers_of(memory, {}), listen="all") as device:

        @device.link.on("sync_read")
        def answer(message: Message) -> None:
            several(device, memory, message["servos"], message["address"], message["size"])

        port = scservo_sdk.PortHandler(device.path)
        port.openPort()
        servos = scservo_sdk.sms_sts(port)
        memory.write(1, 3, (777).to_bytes(2, "little"))
        asked_until(lambda: good(servos.ping(1)), 777)
        assert asked_again(lambda: good(servos.WritePosEx(1, 2048, 2400, 50)))
        assert device.last("write").fields == {"address": 41, "data": bytes([50, 0, 8, 0, 0, 0x60, 9])}
        memory.write(1, 56, (0x8005).to_bytes(2, "little") + (1500).to_bytes(2, "little"))
        asked_until(lambda: good(servos.ReadPos(1)), -5)

        def read_both() -> tuple[int, int] | None:
            position, speed, outcome, error = servos.ReadPosSpeed(1)
            return None if outcome or error else (position, speed)

        asked_until(read_both, (-5, 1500))
        assert asked_again(lambda: good(servos.RegWritePosEx(2, 100, 60, 5)))
        servos.RegAction()
        assert device.last("action").header["servo"] == 0xFE
        for number in SERVOS:
            servos.SyncWritePosEx(number, 1000 * number, 60, 5)
        servos.groupSyncWrite.txPacket()
        assert device.last("sync_write")["size"] == 7
        reading = scservo_sdk.GroupSyncRead(servos, 42, 2)
        for number in SERVOS:
            reading.addParam(number)

        def read_each() -> list[int] | None:
            return good(reading.txRxPacket()) and [reading.getData(number, 42, 2) for number in SERVOS]

        asked_until(read_each, [1000, 2000])
        port.closePort()
