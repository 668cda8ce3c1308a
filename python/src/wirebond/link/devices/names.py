"""Names that stay when a port's device gets another one: how they are written, and which device they mean now.

A port is opened, and opened again after it was away, by a name. `resolve` makes that name a device:

==========================================  =========================================================
``usb:1a86:55d3``                           the USB device with these ids (vendor, product: four hex digits)
``usb:1a86:55d3:5A46083061``                and with this serial number
``usb:5A46083061``                          the USB device with this serial number, whatever its ids are
``usb:0483:5740@2``                         its interface 2, of a device with several ports
``usb:10c4:ea71@0.3``                       the fourth port of its interface 0
``/dev/serial/by-id/...``, ``.../by-path/`` where udev's link leads
anything else                               itself: a device's path, or an address such as ``tcp://``
==========================================  =========================================================
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from wirebond.errors import PortError, UsageError
from wirebond.link.devices import sysfs
from wirebond.link.devices.discovery import can_list_ports, link_target, serial_ports
from wirebond.link.devices.serial_port import SerialPort, UsbInterface

_PREFIX = "usb:"
_LINK_FOLDERS = ("/dev/serial/by-id/", "/dev/serial/by-path/")
_GRAMMAR = (
    "expected usb:VENDOR:PRODUCT, usb:VENDOR:PRODUCT:SERIAL or usb:SERIAL, such as usb:1a86:55d3; append @2 to "
    "select interface 2 of a device with several ports"
)
_ID = re.compile(r"[0-9a-fA-F]{4}")
_MOST_LISTED = 8  # ports that a sentence names


def resolve(name: str, root: Path = Path("/")) -> str:
    """Return the device that `name` means now. Opens nothing and is quick: call it before every attempt to open.

    :raises UsageError: `name` begins with ``usb:`` and is not written as it must be, or this is not Linux. Waiting does
        not help.
    :raises PortError: no port fits now (``errno.ENOENT``), or more than one (``errno`` is None). Both may change.
    """
    if name.startswith(_PREFIX):
        if not can_list_ports(root):
            raise UsageError(f"'{name}' is looked up in /sys/class/tty, which only Linux has; give the port's path")
        return _only_one(_parse(name), serial_ports(root))
    if name.startswith(_LINK_FOLDERS):
        return _link(name, root)
    return name


def matching(name: str, ports: Iterable[SerialPort]) -> list[SerialPort]:
    """Return all of `ports` that match a name with ``usb:``.

    :raises UsageError: as `resolve`.
    """
    wanted = _parse(name)
    return [port for port in ports if wanted.fits(port)]


def stable_name(port: SerialPort, ports: Iterable[SerialPort]) -> str:
    """Return a name that means this port alone among `ports`, and stays: by serial number, by ids, by socket, by
    device."""
    if port.usb is not None:
        ports = list(ports)
        for name in _names(port.usb):
            if matching(name, ports) == [port]:
                return name
    return port.by_path or port.path


def _names(usb: UsbInterface) -> list[str]:
    ids = f"{_PREFIX}{usb.vendor_id}:{usb.product_id}"
    bases = [f"{ids}:{usb.serial}", ids] if usb.serial else [ids]
    parts = ["", f"@{usb.interface}", f"@{usb.interface}.{usb.port_number}"]
    return [base + part for base in bases for part in parts]


@dataclass(frozen=True)
class _Wanted:
    name: str
    ids: tuple[str, str] | None
    serial: str | None
    interface: int | None
    port_number: int | None

    def fits(self, port: SerialPort) -> bool:
        usb = port.usb
        return (
            usb is not None
            and self.ids in (None, (usb.vendor_id, usb.product_id))
            and self.serial in (None, usb.serial)
            and self.interface in (None, usb.interface)
            and self.port_number in (None, usb.port_number)
        )


def _parse(name: str) -> _Wanted:
    text = name.removeprefix(_PREFIX)
    interface = port_number = None
    place = re.search(r"@([0-9]{1,3})(?:\.([0-9]{1,3}))?$", text)
    if place is not None:
        text = text[: place.start()]
        interface = int(place[1])
        port_number = None if place[2] is None else int(place[2])
    words = text.split(":", 2)
    if not text:
        raise UsageError(f"'{name}' names no USB device; {_GRAMMAR}")
    if len(words) == 1 or not (_ID.fullmatch(words[0]) or words[0][:2].lower() == "0x"):
        return _Wanted(name, None, text, interface, port_number)  # also a serial number with colons in it
    for what, word in zip(("vendor", "product"), words, strict=False):
        if not _ID.fullmatch(word):
            raise UsageError(f"'{name}': the {what} '{word}' is not four hex digits; {_GRAMMAR}")
    if words[2:] == [""]:
        raise UsageError(
            f"'{name}' ends where a serial number is expected; leave out the last colon, or give the number"
        )
    serial = words[2] if len(words) == 3 else None
    return _Wanted(name, (words[0].lower(), words[1].lower()), serial, interface, port_number)


def _only_one(wanted: _Wanted, ports: list[SerialPort]) -> str:
    fitting = [port for port in ports if wanted.fits(port)]
    there = [port for port in fitting if port.has_device]
    if len(there) == 1:
        return there[0].path
    if there:
        raise PortError(_several(wanted, there, ports), None, wanted.name)
    if fitting:
        path = fitting[0].path
        raise PortError(
            f"{wanted.name} is plugged in, but there is no {path} here; pass the device to the container: "
            f"`wirebond doctor {wanted.name}` says how",
            errno.ENOENT,
            wanted.name,
        )
    raise PortError(_none(wanted, ports), errno.ENOENT, wanted.name)


def _none(wanted: _Wanted, ports: list[SerialPort]) -> str:
    hint = ""
    if wanted.ids is None and _ID.fullmatch(wanted.serial or ""):
        hint = f" ({wanted.serial} alone is a serial number; ids are written usb:VENDOR:PRODUCT)"
    return f"no USB serial port is {wanted.name} at the moment{hint}; {which_there_are(ports)}"


def which_there_are(ports: list[SerialPort]) -> str:
    """Return the end of a sentence about a port that is not there: the ports that are, or what to do if there is
    none."""
    usable = [port for port in ports if port.has_device]
    if not usable:
        return "there is no serial port at all. Plug it in; `wirebond doctor` finds the obstacle"
    return f"there {'is' if len(usable) == 1 else 'are'} {_listed(usable, ports)}"


def _several(wanted: _Wanted, fitting: list[SerialPort], ports: list[SerialPort]) -> str:
    return f"{wanted.name} fits {len(fitting)} ports; choose one by the name in brackets: {_listed(fitting, ports)}"


def _listed(listed: list[SerialPort], ports: list[SerialPort]) -> str:
    texts = []
    for port in listed[:_MOST_LISTED]:
        name = stable_name(port, ports)
        texts.append(port.path if name == port.path else f"{port.path} ({name})")
    more = len(listed) - len(texts)
    return ", ".join(texts) + (f" and {more} more" if more else "")


def _link(name: str, root: Path) -> str:
    target = link_target(root, name)
    if target is not None:
        return target
    if sysfs.below(root, name).exists():
        return name
    raise PortError(f"there is no {name} at the moment; {which_there_are(serial_ports(root))}", errno.ENOENT, name)
