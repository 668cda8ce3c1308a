"""Finds the serial ports of the machine in sysfs: every real one, and no name without hardware.

The kernel lists terminals of every kind in ``/sys/class/tty``. Three facts of its documentation and sources tell them
apart:

- A terminal with hardware has a link ``device``. Consoles, ptys and the like have none. Two kinds of real ports have
  none either: ``ttyGS`` (this computer is the USB device) and ``rfcomm`` (Bluetooth).
- The driver 8250 makes ``ttyS0`` to ``ttyS31`` in advance. The file ``type`` of a port without a UART is 0
  (Documentation/ABI/testing/sysfs-tty). Bus and driver do not help: since Linux 6.5 both kinds are alike there.
- The strings of a USB device are in the folders above ``device``: first the interface, then the device.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

from wirebond.link.devices import sysfs
from wirebond.link.devices.serial_port import SerialPort, UsbInterface

_REAL_WITHOUT_DEVICE = {
    "ttyGS": "USB gadget: this computer is the USB device",
    "rfcomm": "Bluetooth serial port",
}
_ISA_DRIVER = "serial8250"  # the one that makes ports in advance
_TTYS = "sys/class/tty"
_USB_SERIAL = "sys/bus/usb-serial/devices"


def serial_ports(root: Path = Path("/")) -> list[SerialPort]:
    """Return the serial ports of the machine whose file system begins at `root`; USB first, then by name.

    Reads only small files of sysfs, opens no port, needs no rights. Without sysfs (not Linux) the list is empty.
    """
    folder = root / _TTYS
    links = _Links(root)
    found = [port for name in sysfs.names(folder) if (port := _port(root, folder / name, links)) is not None]
    return sorted(found, key=lambda port: (not port.is_usb, _natural(port.path)))


def can_list_ports(root: Path = Path("/")) -> bool:
    """Return whether this system lists its ports in sysfs. Otherwise ports have only their paths."""
    return (root / _TTYS).is_dir()


def _natural(name: str) -> list[tuple[str, int]]:
    """Return a key that sorts ttyUSB10 after ttyUSB9."""
    return [(letters, int(digits or 0)) for letters, digits in re.findall(r"(\D+)(\d*)", name)]


class _Links:
    """udev's links, by the device that each leads to."""

    def __init__(self, root: Path) -> None:
        self.by_id = self._read(root, "/dev/serial/by-id")
        self.by_path = self._read(root, "/dev/serial/by-path")

    @staticmethod
    def _read(root: Path, folder: str) -> dict[str, str]:
        found: dict[str, str] = {}
        for name in sysfs.names(sysfs.below(root, folder)):
            target = link_target(root, f"{folder}/{name}")
            if target is not None:
                found.setdefault(
                    target, f"{folder}/{name}"
                )  # of several the first: newer udev adds one to the old name
        return found


def link_target(root: Path, link: str) -> str | None:
    """Return the absolute target of the symbolic link at this absolute path, or None if it is not a link."""
    try:
        target = os.readlink(sysfs.below(root, link))  # noqa: PTH115 its text is wanted: it may be absolute
    except OSError:
        return None
    return os.path.normpath(os.path.join(os.path.dirname(link), target))  # noqa: PTH118, PTH120 text, not files


def _port(root: Path, tty: Path, links: _Links) -> SerialPort | None:
    path = "/dev/" + tty.name.replace("!", "/")  # sysfs has no `/` in names
    if (tty / "device").exists():
        parents = list(_parents(root, tty / "device"))
        driver = _driver(parents)
        if _is_empty_place(tty, driver):
            return None
        usb = _usb(parents)
        description = _usb_description(usb) if usb else _uart_description(parents)
    else:
        kind = re.match(r"[a-zA-Z]+", tty.name)
        if kind is None or kind[0] not in _REAL_WITHOUT_DEVICE:
            return None
        usb, driver, description = None, None, _REAL_WITHOUT_DEVICE[kind[0]]
    return SerialPort(
        path=path,
        description=description,
        driver=driver,
        usb=usb,
        by_id=links.by_id.get(path),
        by_path=links.by_path.get(path),
        has_device=sysfs.below(root, path).exists(),
        latency_timer_ms=sysfs.number(root / _USB_SERIAL / tty.name / "latency_timer"),
    )


def _parents(root: Path, device: Path) -> Iterator[Path]:
    """Yield the device and what it is a part of, from within."""
    top = Path(os.path.realpath(root / "sys/devices"))
    at = Path(os.path.realpath(device))
    while at != top and top in at.parents:
        yield at
        at = at.parent


def _driver(parents: list[Path]) -> str | None:
    for parent in parents:
        if sysfs.linked_name(parent / "subsystem") == "serial-base":
            continue  # Linux 6.5 and newer put two devices of their own between; their drivers are `port` and `ctrl`
        driver = sysfs.linked_name(parent / "driver")
        if driver is not None:
            return driver
    return None


def _is_empty_place(tty: Path, driver: str | None) -> bool:
    kind = sysfs.text(tty / "type")
    if kind == "0":
        return True
    # A type may be set by hand (setserial) where there is no hardware; then the place has no address.
    addresses = (sysfs.number(tty / "port", 16), sysfs.number(tty / "iomem_base", 16))
    return driver == _ISA_DRIVER and addresses == (0, 0)


def _usb(parents: list[Path]) -> UsbInterface | None:
    interface = next((parent for parent in parents if (parent / "bInterfaceNumber").exists()), None)
    device = next((parent for parent in parents if (parent / "idVendor").exists()), None)
    if interface is None or device is None:
        return None
    vendor, product = sysfs.number(device / "idVendor", 16), sysfs.number(device / "idProduct", 16)
    if vendor is None or product is None:  # it was unplugged at this moment
        return None
    return UsbInterface(
        vendor_id=f"{vendor:04x}",
        product_id=f"{product:04x}",
        serial=sysfs.text(device / "serial") or None,
        manufacturer=sysfs.text(device / "manufacturer") or None,
        product=sysfs.text(device / "product") or None,
        interface=sysfs.number(interface / "bInterfaceNumber", 16) or 0,
        interface_name=sysfs.text(interface / "interface") or None,
        port_number=sysfs.number(parents[0] / "port_number") or 0,
        location=device.name,
    )


def _usb_description(usb: UsbInterface) -> str:
    said = usb.product or "USB serial port"
    if usb.manufacturer and not said.startswith(usb.manufacturer):
        said = f"{usb.manufacturer} {said}"
    if usb.interface_name and usb.interface_name not in said:
        said = f"{said}, {usb.interface_name}"
    return said


def _uart_description(parents: list[Path]) -> str:
    buses = [sysfs.linked_name(parent / "subsystem") for parent in parents]
    bus = next((bus for bus in buses if bus not in (None, "serial-base")), None)
    return "UART" if bus in (None, "platform", "amba") else f"UART ({bus})"
