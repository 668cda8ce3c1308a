"""A machine as its files show it: ports, processes, USB devices, what udev knows. No judgement."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from wirebond.link.devices import sysfs
from wirebond.link.devices.discovery import serial_ports
from wirebond.link.devices.permission import User
from wirebond.link.devices.processes import Process, other_processes
from wirebond.link.devices.serial_port import SerialPort


@dataclass(frozen=True)
class UsbFolder:
    """A USB device or one of its interfaces, in sysfs."""

    folder: Path
    driver: str | None

    def text(self, attribute: str) -> str | None:
        return sysfs.text(self.folder / attribute)

    def number(self, attribute: str) -> int | None:
        return sysfs.number(self.folder / attribute, 16)


class Machine:
    """The machine whose file system begins at `root`, as `user` sees it; default: the user of this process.

    Each fact is read once, when it is first needed: make a new one to read them again.
    """

    def __init__(self, root: Path = Path("/"), user: User | None = None) -> None:
        self.root = root
        self.user = user

    def text(self, path: str) -> str | None:
        return sysfs.text(sysfs.below(self.root, path))

    def exists(self, path: str) -> bool:
        return os.path.lexists(sysfs.below(self.root, path))

    def names(self, path: str) -> list[str]:
        return sysfs.names(sysfs.below(self.root, path))

    @cached_property
    def ports(self) -> list[SerialPort]:
        return serial_ports(self.root)

    @cached_property
    def processes(self) -> list[Process]:
        """The others."""
        return other_processes(self.root)

    def runs(self, name: str) -> Process | None:
        """Return the process of this name; None if there is none."""
        return next((process for process in self.processes if process.name == name), None)

    @cached_property
    def usb_interfaces(self) -> list[UsbFolder]:
        return [usb for usb in self._usb() if (usb.folder / "bInterfaceNumber").exists()]

    def _usb(self) -> Iterator[UsbFolder]:
        top = sysfs.below(self.root, "/sys/bus/usb/devices")
        for name in sysfs.names(top):
            folder = Path(os.path.realpath(top / name))
            yield UsbFolder(folder, sysfs.linked_name(folder / "driver"))

    def usb_device_of(self, port: SerialPort) -> UsbFolder | None:
        if port.usb is None:
            return None
        folder = sysfs.below(self.root, f"/sys/bus/usb/devices/{port.usb.location}")
        return UsbFolder(Path(os.path.realpath(folder)), sysfs.linked_name(folder / "driver"))

    def interface_of(self, port: SerialPort) -> UsbFolder | None:
        device = self.usb_device_of(port)
        if device is None or port.usb is None:
            return None
        for usb in self.usb_interfaces:
            if usb.folder.parent == device.folder and usb.number("bInterfaceNumber") == port.usb.interface:
                return usb
        return None

    def udev_properties(self, port: SerialPort) -> dict[str, str]:
        """Return udev's properties of the port and of its USB device."""
        name = port.path.removeprefix("/dev/").replace("/", "!")
        found: dict[str, str] = {}
        if (device := self.usb_device_of(port)) is not None:
            found |= self._udev_data(device.text("dev"))
        return found | self._udev_data(self.text(f"/sys/class/tty/{name}/dev"))

    def _udev_data(self, number: str | None) -> dict[str, str]:
        lines = (self.text(f"/run/udev/data/c{number}") or "").splitlines() if number else []
        pairs = (line[2:].partition("=") for line in lines if line.startswith("E:"))
        return {name: value for name, _, value in pairs}
