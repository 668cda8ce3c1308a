"""Does brltty take an adapter for a braille display? Then the port disappears a moment after it was plugged in.

brltty's udev rules name USB ids, and some of those belong to common adapter chips: 1a86:7523 is the CH340.
The rules of this machine are read, so that a rule that is switched off does not count.
"""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Iterator
from pathlib import Path

from wirebond.link.devices import sysfs
from wirebond.link.devices.doctor.finding import Finding, Verdict
from wirebond.link.devices.doctor.machine import Machine, UsbFolder

_FOLDERS = ("/etc/udev/rules.d", "/run/udev/rules.d", "/usr/lib/udev/rules.d", "/lib/udev/rules.d")  # udev's order


def check_brltty(machine: Machine) -> list[Finding]:
    """Return a finding for each USB device that a rule names; one if there is none."""
    rules = list(_rules(machine))
    found: dict[Path, Finding] = {}
    for interface in machine.usb_interfaces:
        device = UsbFolder(interface.folder.parent, None)
        if device.folder not in found and (file := _named_by(device, rules)) is not None:
            found[device.folder] = _finding(machine, device, file)
    if found:
        return list(found.values())
    said = "its rules name nothing that is plugged in" if rules else "brltty is not installed, or its rules are off"
    return [Finding("brltty", Verdict.OK, said)]


def _rules(machine: Machine) -> Iterator[tuple[str, str]]:
    """Yield file name and line of each rule that names USB ids. A file hides those of its name in later folders."""
    seen: set[str] = set()
    for folder in _FOLDERS:
        for name in machine.names(folder):
            if "brltty" not in name or not name.endswith(".rules") or name in seen:
                continue
            seen.add(name)
            for line in (machine.text(f"{folder}/{name}") or "").splitlines():
                if not line.lstrip().startswith("#") and "ENV{PRODUCT}==" in line:
                    yield name, line


def _named_by(device: UsbFolder, rules: list[tuple[str, str]]) -> str | None:
    vendor, product = device.number("idVendor"), device.number("idProduct")
    if vendor is None or product is None:
        return None
    ids = f"{vendor:x}/{product:x}/{device.number('bcdDevice') or 0:x}"
    for file, line in rules:
        wanted = re.findall(r'ENV\{PRODUCT\}=="([^"]*)"', line)
        said = re.findall(r'ATTRS?\{(\w+)\}=="([^"]*)"', line)
        if any(_matches(ids, one) for one in wanted) and all(_matches(device.text(a) or "", p) for a, p in said):
            return file
    return None


def _matches(value: str, pattern: str) -> bool:
    """Match a pattern of udev: `*`, `?`, `[...]`, and `|` between several."""
    return any(fnmatch.fnmatchcase(value, one) for one in pattern.split("|"))


def _finding(machine: Machine, device: UsbFolder, file: str) -> Finding:
    ids = f"{device.text('idVendor')}:{device.text('idProduct')}"
    name = device.text("product") or "the USB device"
    interfaces = [usb for usb in machine.usb_interfaces if usb.folder.parent == device.folder]
    is_taken = any(usb.driver == "usbfs" for usb in interfaces)
    ports = [port.path for port in machine.ports if port.usb is not None and port.usb.location == device.folder.name]
    what = f"{name} ({ids})"
    if is_taken:
        verdict, said = Verdict.PROBLEM, f"brltty has taken {what} for a braille display, so that it has no port"
    elif ports:
        verdict = Verdict.WARNING
        said = f"brltty takes {what} for a braille display, and may take {ports[0]} away"
    else:
        verdict = Verdict.PROBLEM
        said = f"{what} has no port, and brltty's rules take it for a braille display"
    return Finding(
        "brltty", verdict, f"{said}; if you use no such display, remove brltty", None, _cure(machine, file), _THEN
    )


_THEN = "then plug the adapter in again"


def _cure(machine: Machine, file: str) -> tuple[str, ...]:
    if sysfs.below(machine.root, "/usr/bin/apt").exists():
        return ("sudo apt remove brltty",)
    return (f"sudo ln -s /dev/null /etc/udev/rules.d/{file}", "sudo udevadm control --reload")
