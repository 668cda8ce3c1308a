"""A stable name means one device, the same after it was renamed; if not, a sentence says why and what to do."""

from __future__ import annotations

import errno
import os
import subprocess
import sys

import pytest

from wirebond.errors import PortError, UsageError
from wirebond.link.devices import resolve, serial_ports, stable_name


@pytest.fixture
def desk(machine):
    """Two CH340 without serial numbers, a board with one, a probe with two ports, a UART."""
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523", product="USB Serial")
    machine.usb_serial("ttyUSB1", "1-2", "1a86:7523", product="USB Serial")
    machine.link("dev/serial/by-path/pci-usb-0:1:1.0-port0", "dev/ttyUSB0")
    machine.link("dev/serial/by-path/pci-usb-0:2:1.0-port0", "dev/ttyUSB1")
    machine.link("dev/serial/by-id/usb-1a86-if00-port0", "dev/ttyUSB1")
    machine.acm("ttyACM0", machine.usb_device("1-3", "1a86:55d3", serial="5A46083061"))
    probe = machine.usb_device("1-4", "1d50:6018", serial="7BB1")
    machine.acm("ttyACM1", probe, 0)
    machine.acm("ttyACM2", probe, 2)
    machine.acm("ttyACM3", machine.usb_device("1-5", "303a:1001", serial="7C:DF:A1:00:11:22"))
    machine.legacy_uart("ttyS0", "4", True, port="0x3F8")
    return machine


@pytest.mark.parametrize(
    ("name", "device"),
    [
        ("usb:1a86:55d3", "/dev/ttyACM0"),
        ("usb:1A86:55D3", "/dev/ttyACM0"),
        ("usb:1a86:55d3:5A46083061", "/dev/ttyACM0"),
        ("usb:5A46083061", "/dev/ttyACM0"),
        ("usb:1d50:6018@0", "/dev/ttyACM1"),
        ("usb:1d50:6018@2", "/dev/ttyACM2"),
        ("usb:1d50:6018:7BB1@2.0", "/dev/ttyACM2"),
        ("usb:7BB1@2", "/dev/ttyACM2"),
        ("usb:7C:DF:A1:00:11:22", "/dev/ttyACM3"),
        ("usb:303a:1001:7C:DF:A1:00:11:22", "/dev/ttyACM3"),
        ("/dev/serial/by-id/usb-1a86-if00-port0", "/dev/ttyUSB1"),
        ("/dev/serial/by-path/pci-usb-0:1:1.0-port0", "/dev/ttyUSB0"),
        ("/dev/ttyUSB7", "/dev/ttyUSB7"),
        ("/tmp/mcu", "/tmp/mcu"),
        ("tcp://192.168.0.7:4000", "tcp://192.168.0.7:4000"),
        ("COM3", "COM3"),
    ],
)
def test_a_name_means_one_device(desk, name, device):
    assert resolve(name, desk.root) == device


def test_a_name_means_the_same_device_after_it_was_renamed(machine):
    first = machine.usb_serial("ttyUSB0", "1-1", "10c4:ea60", serial="0001")
    name = stable_name(serial_ports(machine.root)[0], serial_ports(machine.root))
    assert resolve(name, machine.root) == "/dev/ttyUSB0"
    (machine.root / "sys/class/tty/ttyUSB0").unlink()
    (machine.root / "dev/ttyUSB0").unlink()
    with pytest.raises(PortError):
        resolve(name, machine.root)
    first.parent.parent.rename(first.parent.parent.with_name("gone"))
    (machine.root / "sys/bus/usb/devices/1-1").unlink()
    (machine.root / "sys/bus/usb/devices/1-1:1.0").unlink()
    machine.usb_serial("ttyUSB1", "1-1", "10c4:ea60", serial="0001")
    assert resolve(name, machine.root) == "/dev/ttyUSB1"


def test_each_port_has_a_name_of_its_own(desk):
    ports = serial_ports(desk.root)
    names = {port.path: stable_name(port, ports) for port in ports}
    assert names == {
        "/dev/ttyACM0": "usb:1a86:55d3:5A46083061",
        "/dev/ttyACM1": "usb:1d50:6018:7BB1@0",
        "/dev/ttyACM2": "usb:1d50:6018:7BB1@2",
        "/dev/ttyACM3": "usb:303a:1001:7C:DF:A1:00:11:22",
        "/dev/ttyUSB0": "/dev/serial/by-path/pci-usb-0:1:1.0-port0",
        "/dev/ttyUSB1": "/dev/serial/by-path/pci-usb-0:2:1.0-port0",
        "/dev/ttyS0": "/dev/ttyS0",
    }
    for path, name in names.items():
        assert resolve(name, desk.root) == path


def test_two_ports_of_one_interface_are_distinguished_by_their_number(machine):
    interface = machine.interface(machine.usb_device("1-1", "10c4:ea71"), 0, "mos7840")
    for number in range(2):
        port = machine.attributes(interface / f"ttyUSB{number}", port_number=str(number))
        machine.bus(port, "usb-serial", "mos7840")
        machine.tty(f"ttyUSB{number}", port)
    ports = serial_ports(machine.root)
    assert [stable_name(port, ports) for port in ports] == ["usb:10c4:ea71@0.0", "usb:10c4:ea71@0.1"]
    assert resolve("usb:10c4:ea71@0.1", machine.root) == "/dev/ttyUSB1"


def test_a_serial_number_that_ends_like_an_interface_gets_its_interface_appended(machine):
    machine.acm("ttyACM0", machine.usb_device("1-1", "0483:5740", serial="A@1"))
    ports = serial_ports(machine.root)
    name = stable_name(ports[0], ports)
    assert name == "usb:0483:5740:A@1@0"
    assert resolve(name, machine.root) == "/dev/ttyACM0"


def refused(name, machine):
    with pytest.raises(PortError) as caught:
        resolve(name, machine.root)
    assert caught.value.filename == name
    return caught.value


def test_no_port_fits(desk):
    error = refused("usb:0483:5740", desk)
    assert error.errno == errno.ENOENT
    assert str(error) == (
        "no USB serial port is usb:0483:5740 at the moment; there are /dev/ttyACM0 (usb:1a86:55d3:5A46083061), "
        "/dev/ttyACM1 (usb:1d50:6018:7BB1@0), /dev/ttyACM2 (usb:1d50:6018:7BB1@2), "
        "/dev/ttyACM3 (usb:303a:1001:7C:DF:A1:00:11:22), /dev/ttyUSB0 (/dev/serial/by-path/pci-usb-0:1:1.0-port0), "
        "/dev/ttyUSB1 (/dev/serial/by-path/pci-usb-0:2:1.0-port0), /dev/ttyS0"
    )


def test_there_is_no_port_at_all(machine):
    assert str(refused("usb:0483:5740", machine)) == (
        "no USB serial port is usb:0483:5740 at the moment; there is no serial port at all. Plug it in; `wirebond "
        "doctor` finds the obstacle"
    )


def test_an_id_alone_is_a_serial_number_and_the_sentence_says_so(desk):
    assert "(1a86 alone is a serial number; ids are written usb:VENDOR:PRODUCT)" in str(refused("usb:1a86", desk))


def test_several_ports_fit(desk):
    error = refused("usb:1a86:7523", desk)
    assert error.errno is None
    assert str(error) == (
        "usb:1a86:7523 fits 2 ports; choose one by the name in brackets: "
        "/dev/ttyUSB0 (/dev/serial/by-path/pci-usb-0:1:1.0-port0), "
        "/dev/ttyUSB1 (/dev/serial/by-path/pci-usb-0:2:1.0-port0)"
    )


def test_a_device_whose_file_is_missing(machine):
    machine.usb_serial("ttyUSB0", "1-1", "10c4:ea60", has_file=False)
    error = refused("usb:10c4:ea60", machine)
    assert error.errno == errno.ENOENT
    assert "is plugged in, but there is no /dev/ttyUSB0 here; pass the device to the container" in str(error)


@pytest.mark.parametrize("folder", ["by-id", "by-path"])
def test_a_link_that_is_not_there(desk, folder):
    error = refused(f"/dev/serial/{folder}/usb-other", desk)
    assert error.errno == errno.ENOENT
    assert str(error).startswith(f"there is no /dev/serial/{folder}/usb-other at the moment; there are /dev/ttyACM0 (")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("usb:", "'usb:' names no USB device; expected usb:VENDOR:PRODUCT, "),
        ("usb:@2", "'usb:@2' names no USB device; "),
        ("usb:1a86:55d", "'usb:1a86:55d': the product '55d' is not four hex digits; "),
        ("usb:1a86:", "'usb:1a86:': the product '' is not four hex digits; "),
        ("usb:0x1a86:0x55d3", "'usb:0x1a86:0x55d3': the vendor '0x1a86' is not four hex digits; "),
        ("usb:1a86:55d3@x", "'usb:1a86:55d3@x': the product '55d3@x' is not four hex digits; "),
        ("usb:1a86:55d3:", "'usb:1a86:55d3:' ends where a serial number is expected; "),
    ],
)
def test_a_name_that_is_written_wrong(desk, name, sentence):
    with pytest.raises(UsageError) as caught:
        resolve(name, desk.root)
    assert str(caught.value).startswith(sentence)


def test_a_system_that_is_not_linux_has_paths_only(tmp_path):
    assert resolve("COM3", tmp_path) == "COM3"
    with pytest.raises(UsageError, match="which only Linux has; give the port's path"):
        resolve("usb:1a86:55d3", tmp_path)


@pytest.mark.live
def test_resolving_imports_nothing_heavy():
    program = (
        "import sys; from wirebond.link.devices import resolve; resolve('/dev/ttyUSB0');"
        "print([name for name in ('numpy', 'pydantic', 'rich', 'typer', 'wirebond._engine') if name in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=os.environ, check=True)
    assert run.stdout == "[]\n"
