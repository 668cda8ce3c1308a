"""pymodbus and minimalmodbus as real programs: masters of a firmware, and pymodbus as a slave of a link."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TypeVar

import minimalmodbus
import pytest
import serial
from pymodbus import FramerType
from pymodbus.client import ModbusSerialClient
from pymodbus.datastore import ModbusDeviceContext, ModbusSequentialDataBlock, ModbusServerContext
from pymodbus.exceptions import ModbusIOException
from pymodbus.server import ModbusSerialServer

import wirebond
from tests.contrib.cases import CONTRIB
from tests.peers.cable import cable, device
from tests.waiting import PATIENCE, let_pass, moments

pytestmark = pytest.mark.live
T = TypeVar("T")


@pytest.fixture(scope="module")
def slave(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with device("modbus_rtu", tmp_path_factory.mktemp("modbus")) as path:
        yield path


def test_pymodbus_reads_and_writes_the_registers_of_a_firmware(slave: str) -> None:
    with ModbusSerialClient(slave, baudrate=19200, timeout=PATIENCE, retries=0) as master:
        assert master.read_holding_registers(10, count=5, device_id=1).registers == [10000, 11000, 12000, 13000, 14000]
        for n in range(20):
            assert not master.write_register(50, n, device_id=1).isError()
            assert master.read_holding_registers(50, count=1, device_id=1).registers == [n]
        many = list(range(100, 160))
        written = master.write_registers(30, many, device_id=1)
        assert (written.address, written.count) == (30, 60)
        assert master.read_holding_registers(30, count=60, device_id=1).registers == many
        for refused in (
            master.read_holding_registers(99, count=2, device_id=1),
            master.write_register(100, 1, device_id=1),
            master.write_registers(99, [1, 2], device_id=1),
        ):
            assert (refused.isError(), refused.exception_code) == (True, 2)


def asked_again(ask: Callable[[], T]) -> T:
    """Return the device's answer. It does not answer requests that came while it was held up: they became one frame."""
    for _ in moments("an answer of the device"):
        try:
            return ask()
        except minimalmodbus.NoResponseError:
            continue
        except ModbusIOException as error:
            if "No response received" not in str(error):
                raise
    raise AssertionError


def test_a_firmware_is_silent_for_other_addresses_and_for_broadcasts(slave: str) -> None:
    with ModbusSerialClient(slave, baudrate=19200, timeout=0.5, retries=0) as master:
        for foreign in (2, 7, 247):
            with pytest.raises(ModbusIOException, match="No response received"):
                master.write_register(95, 1, device_id=foreign)
    with serial.Serial(slave, 19200, timeout=0.5) as port, pytest.raises(minimalmodbus.NoResponseError):
        minimalmodbus.Instrument(port, 9).read_register(1)
    with ModbusSerialClient(slave, baudrate=19200, timeout=2.0, retries=0) as master:

        def register() -> int:
            answer = asked_again(partial(master.read_holding_registers, 95, count=1, device_id=1))
            assert answer.function_code == 3
            return int(answer.registers[0])

        assert register() == 95000 % 65536
        for _ in moments("the broadcast's value"):
            master.write_register(95, 5, device_id=0, no_response_expected=True)
            let_pass(0.1)  # the specification's turnaround delay
            if register() == 5:
                break


def test_minimalmodbus_reads_and_writes_the_registers_of_a_firmware(slave: str) -> None:
    with serial.Serial(slave, 19200, timeout=PATIENCE) as port:
        master = minimalmodbus.Instrument(port, 1)
        master.write_register(60, 1234)
        assert master.read_register(60) == 1234
        master.write_registers(61, [1, 2, 3])
        assert master.read_registers(60, 4) == [1234, 1, 2, 3]
        master.write_float(70, 3.5)
        assert master.read_float(70) == 3.5
        port.timeout = 2.0  # it waits for as many bytes as a good answer has
        with pytest.raises(minimalmodbus.IllegalRequestError):
            asked_again(partial(master.read_register, 100))


@pytest.fixture(scope="module", params=["rtu", "ascii"])
def simulated(request: pytest.FixtureRequest) -> Iterator[tuple[str, str]]:
    """Yield the port of `wirebond sim` for the device with the address 1, and the form of its frames."""
    file = CONTRIB / f"modbus_{request.param}.yaml"
    command = [sys.executable, "-m", "wirebond.cli.main", "sim", str(file), "--address", "1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.stdout.readline().split()[-1], request.param
        process.terminate()


def test_pymodbus_is_the_master_of_a_simulated_device(simulated: tuple[str, str]) -> None:
    path, form = simulated
    with ModbusSerialClient(path, framer=FramerType(form), baudrate=19200, timeout=PATIENCE, retries=0) as master:
        for count in (1, 2, 7, 125):
            read = master.read_holding_registers(10, count=count, device_id=1)
            assert not read.isError()
            assert len(read.registers) == count
        written = master.write_register(50, 1234, device_id=1)
        assert (written.address, written.registers) == (50, [1234])
        many = master.write_registers(30, list(range(123)), device_id=1)
        assert (many.address, many.count) == (30, 123)


def test_minimalmodbus_is_the_master_of_a_simulated_device(simulated: tuple[str, str]) -> None:
    path, form = simulated
    with serial.Serial(path, 19200, timeout=PATIENCE) as port:
        master = minimalmodbus.Instrument(port, 1, mode=form)
        for count in (1, 2, 60):
            assert len(master.read_registers(60, count)) == count
        assert 0 <= master.read_register(7) < 65536
        master.write_register(60, 1234)
        master.write_registers(61, [1, 2, 3])
        master.write_float(70, 3.5)


@contextmanager
def pymodbus_slave(path: str) -> Iterator[None]:
    """A slave of a hundred registers, in a thread with an event loop of its own."""
    registers = ModbusSequentialDataBlock(1, [1000 * n % 65536 for n in range(100)])
    context = ModbusServerContext(devices={1: ModbusDeviceContext(hr=registers)}, single=False)
    loop = asyncio.new_event_loop()
    stopping = asyncio.Event()
    running = threading.Event()

    async def serve() -> None:
        server = ModbusSerialServer(context, port=path, baudrate=19200)
        serving = asyncio.ensure_future(server.serve_forever(background=True))
        await serving
        running.set()
        await stopping.wait()
        await server.shutdown()

    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()), daemon=True)
    thread.start()
    assert running.wait(PATIENCE)
    try:
        yield
    finally:
        loop.call_soon_threadsafe(stopping.set)
        thread.join(PATIENCE)
        loop.close()


def answer(link: wirebond.Link) -> wirebond.Message:
    (message,) = link.receive(PATIENCE)
    return message


def test_a_link_is_the_master_of_pymodbus() -> None:
    proto = wirebond.load(CONTRIB / "modbus_rtu.yaml")
    with cable() as (here, there), pymodbus_slave(there), wirebond.open(proto, here) as link:
        for n in range(20):
            link.send("write_register", address=n, value=7 * n)
            written = answer(link)
            assert (written.name, written.fields) == ("write_register", {"address": n, "value": 7 * n})
        link.send("read_holding_registers", first=18, number=4)
        read = answer(link)
        assert (read.name, read.header) == ("holding_registers", {"unit": 1})
        assert read.fields == {"size": 8, "registers": [126, 133, 20000, 21000]}
        link.send("write_registers", first=30, registers=[1, 65535, 3])
        written = answer(link)
        assert (written.name, written.fields) == ("registers_written", {"first": 30, "number": 3})
        link.send("read_holding_registers", first=99, number=2)
        refused = answer(link)
        assert (refused.name, refused.fields) == ("read_refused", {"reason": "address"})
