"""Discovery lists every real port once, and no name without hardware."""

from __future__ import annotations

import pytest

from wirebond.link.devices import serial_ports


def paths(machine):
    return [port.path for port in serial_ports(machine.root)]


def test_an_adapter_chip_is_described_by_what_the_usb_device_says(machine):
    machine.usb_serial("ttyUSB0", "1-1.2", "1a86:7523", product="USB Serial", manufacturer="QinHeng")
    machine.link("dev/serial/by-id/usb-1a86_USB_Serial-if00-port0", "dev/ttyUSB0")
    machine.link("dev/serial/by-path/pci-0000:00:14.0-usb-0:1.2:1.0-port0", "dev/ttyUSB0")
    machine.link("dev/serial/by-path/pci-0000:00:14.0-usbv2-0:1.2:1.0-port0", "dev/ttyUSB0")
    (port,) = serial_ports(machine.root)
    assert port.path == "/dev/ttyUSB0"
    assert port.description == "QinHeng USB Serial"
    assert port.driver == "ch341"
    assert port.by_id == "/dev/serial/by-id/usb-1a86_USB_Serial-if00-port0"
    assert port.by_path == "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1.2:1.0-port0"
    assert port.is_usb and port.has_device
    assert (port.usb.vendor_id, port.usb.product_id, port.usb.serial) == ("1a86", "7523", None)
    assert (port.usb.interface, port.usb.port_number, port.usb.location) == (0, 0, "1-1.2")


def test_a_device_with_two_ports_has_two_interfaces(machine):
    device = machine.usb_device("1-3", "1d50:6018", serial="7BB1", product="Black Magic Probe", manufacturer="Black")
    machine.acm("ttyACM0", device, 0, interface="GDB Server")
    machine.acm("ttyACM1", device, 2, interface="UART Port")
    first, second = serial_ports(machine.root)
    assert first.description == "Black Magic Probe, GDB Server"
    assert second.description == "Black Magic Probe, UART Port"
    assert (first.usb.interface, second.usb.interface) == (0, 2)
    assert first.driver == "cdc_acm"
    assert first.usb.serial == "7BB1"


@pytest.mark.parametrize("new_kernel", [False, True], ids=["before 6.5", "since 6.5"])
def test_places_that_the_8250_driver_makes_in_advance_are_no_ports(machine, new_kernel):
    machine.legacy_uart("ttyS0", "4", new_kernel, port="0x3F8")
    machine.legacy_uart(
        "ttyS1", "0", new_kernel, port="0x2F8"
    )  # a PC's second place has an address also without a UART
    for number in range(2, 32):
        machine.legacy_uart(f"ttyS{number}", "0", new_kernel)
    assert paths(machine) == ["/dev/ttyS0"]


def test_a_type_set_by_hand_makes_no_port(machine):
    machine.legacy_uart("ttyS4", "4", True, port="0x0")
    assert paths(machine) == []


@pytest.mark.parametrize("new_kernel", [False, True], ids=["before 6.5", "since 6.5"])
def test_uarts_of_boards_are_ports_whatever_their_address_is(machine, new_kernel):
    machine.uart("ttyAMA0", "amba", "uart-pl011", new_kernel)
    machine.uart("ttySC0", "spi", "sc16is7xx", new_kernel, type="114", port="0x0", iomem_base="0x0")
    machine.uart("ttyS1", "pnp", "serial", new_kernel, type="4", port="0x2F8")
    found = {port.path: (port.driver, port.description) for port in serial_ports(machine.root)}
    assert found == {
        "/dev/ttyAMA0": ("uart-pl011", "UART"),
        "/dev/ttyS1": ("serial", "UART (pnp)"),
        "/dev/ttySC0": ("sc16is7xx", "UART (spi)"),
    }


def test_consoles_and_ptys_are_no_ports_but_gadgets_and_bluetooth_are(machine):
    for name in ("tty0", "tty1", "console", "ptmx", "ttyprintk", "ttyGS0", "rfcomm0"):
        machine.tty(name, None)
    assert paths(machine) == ["/dev/rfcomm0", "/dev/ttyGS0"]


def test_usb_comes_first_and_numbers_are_counted(machine):
    machine.legacy_uart("ttyS0", "4", True, port="0x3F8")
    for number in (10, 9):
        machine.usb_serial(f"ttyUSB{number}", f"1-{number}", "10c4:ea60")
    assert paths(machine) == ["/dev/ttyUSB9", "/dev/ttyUSB10", "/dev/ttyS0"]


def test_a_port_without_its_file_is_listed_and_says_so(machine):
    machine.usb_serial("ttyUSB0", "1-1", "10c4:ea60", has_file=False)
    (port,) = serial_ports(machine.root)
    assert not port.has_device


def test_a_device_that_says_nothing_of_itself_is_listed(machine):
    machine.usb_serial("ttyUSB0", "1-1", "0403:6001", driver="ftdi_sio")
    (port,) = serial_ports(machine.root)
    assert port.description == "USB serial port"
    assert port.usb.manufacturer is None


def test_where_there_is_no_sysfs_there_are_no_ports(tmp_path):
    assert serial_ports(tmp_path) == []


def test_the_root_may_be_relative_and_a_symbolic_link(machine, tmp_path, monkeypatch):
    machine.usb_serial("ttyUSB0", "1-1", "10c4:ea60")
    (tmp_path / "behind").symlink_to(machine.root)
    monkeypatch.chdir(tmp_path)
    (port,) = serial_ports(type(tmp_path)("behind"))
    assert port.usb.vendor_id == "10c4"
    assert port.driver == "ch341"


def test_this_machine_is_read_without_an_error():
    for port in serial_ports():
        assert port.path.startswith("/dev/")
