"""A machine made of files: what discovery and doctor read of /sys, /dev, /proc, /etc and /run, laid as Linux does."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


class FakeMachine:
    """Each function adds something to the machine; `root` is the top of its file system."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.devices = root / "sys/devices"
        self.devices.mkdir(parents=True)
        (root / "sys/class/tty").mkdir(parents=True)
        (root / "dev").mkdir()

    def write(self, path: str | Path, text: str = "") -> Path:
        file = self.root / str(path).lstrip("/")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return file

    def link(self, path: str | Path, target: str | Path) -> None:
        """A relative link, as those of sysfs are."""
        place = self.root / str(path).lstrip("/")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.symlink_to(os.path.relpath(self.root / str(target).lstrip("/"), place.parent))

    def attributes(self, folder: Path, **values: str | None) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        for name, value in values.items():
            if value is not None:
                (folder / name).write_text(value + "\n")
        return folder

    def bus(self, device: Path, subsystem: str, driver: str | None = None) -> None:
        for kind, name in (("subsystem", f"sys/bus/{subsystem}"), ("driver", f"sys/bus/{subsystem}/drivers/{driver}")):
            if kind == "subsystem" or driver is not None:
                (self.root / name).mkdir(parents=True, exist_ok=True)
                (device / kind).symlink_to(os.path.relpath(self.root / name, device))

    def tty(self, name: str, device: Path | None, has_file: bool = True, dev: str = "188:0", **attributes: str) -> None:
        parent = device or self.devices / "virtual"
        folder = self.attributes(parent / "tty" / name, dev=dev, **attributes)
        if device is not None:
            (folder / "device").symlink_to(os.path.relpath(device, folder))
        self.link(f"sys/class/tty/{name}", folder.relative_to(self.root))
        if has_file:
            self.write(f"dev/{name}")

    def usb_device(self, location: str, ids: str, **said: str | None) -> Path:
        vendor, product = ids.split(":")
        folder = self.devices / f"pci0000:00/0000:00:14.0/usb1/{location}"
        self.attributes(folder, idVendor=vendor, idProduct=product, **said)
        self.bus(folder, "usb", "usb")
        self.attributes(folder / "power", control="on")
        self.link(f"sys/bus/usb/devices/{location}", folder.relative_to(self.root))
        return folder

    def interface(self, device: Path, number: int = 0, driver: str | None = None, **attributes: str) -> Path:
        folder = self.attributes(device / f"{device.name}:1.{number}", bInterfaceNumber=f"{number:02x}", **attributes)
        self.bus(folder, "usb", driver)
        self.link(f"sys/bus/usb/devices/{folder.name}", folder.relative_to(self.root))
        return folder

    def usb_serial(
        self, name: str, location: str, ids: str, driver: str = "ch341", has_file: bool = True, **said: str | None
    ) -> Path:
        """An adapter chip with one port, as ttyUSB0. Gives the device of its port."""
        interface = self.interface(self.usb_device(location, ids, **said), 0, driver)
        port = self.attributes(interface / name, port_number="0")
        self.bus(port, "usb-serial", driver)
        self.link(f"sys/bus/usb-serial/devices/{name}", port.relative_to(self.root))
        self.tty(name, port, has_file, dev=f"188:{name.removeprefix('ttyUSB')}")
        return port

    def acm(self, name: str, device: Path, number: int = 0, has_file: bool = True, **attributes: str) -> Path:
        """A port of a USB device that is its own adapter, as ttyACM0."""
        interface = self.interface(device, number, "cdc_acm", bInterfaceClass="02", **attributes)
        self.tty(name, interface, has_file, dev=f"166:{name.removeprefix('ttyACM')}")
        return interface

    def legacy_uart(self, name: str, kind: str, new_kernel: bool, port: str = "0x0") -> None:
        """A place of the driver 8250, with hardware (kind 4) or without (kind 0)."""
        platform = self.attributes(self.devices / "platform/serial8250")
        if not (platform / "subsystem").exists():
            self.bus(platform, "platform", "serial8250")
        device = platform
        if new_kernel:
            device = self.attributes(platform / "serial8250:0" / f"serial8250:0.{name.removeprefix('ttyS')}")
            self.bus(device, "serial-base", "port")
        self.tty(name, device, type=kind, port=port, iomem_base="0x0", dev=f"4:{64 + int(name.removeprefix('ttyS'))}")

    def uart(self, name: str, bus: str, driver: str, new_kernel: bool = True, **attributes: str) -> None:
        """A UART that a bus or the device tree names, such as ttyAMA0."""
        hardware = self.attributes(self.devices / f"{bus}/{name}-hardware")
        self.bus(hardware, bus, driver)
        device = hardware
        if new_kernel:
            device = self.attributes(hardware / "hardware:0" / "hardware:0.0")
            self.bus(hardware / "hardware:0", "serial-base", "ctrl")
            self.bus(device, "serial-base", "port")
        self.tty(name, device, **({"type": "32"} | attributes))

    def process(self, pid: int, name: str, command: str = "", opens: str | None = None) -> None:
        self.write(f"proc/{pid}/comm", name + "\n")
        self.write(f"proc/{pid}/cmdline", "\0".join((command or name).split()) + "\0")
        (self.root / f"proc/{pid}/fd").mkdir()
        if opens is not None:
            (self.root / f"proc/{pid}/fd/3").symlink_to(opens)


@pytest.fixture
def machine(tmp_path: Path) -> FakeMachine:
    return FakeMachine(tmp_path / "root")
