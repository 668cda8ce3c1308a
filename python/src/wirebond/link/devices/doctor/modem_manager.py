"""Does ModemManager take the port for a modem, and send it AT commands when it is plugged in?

What it probes is its filter's policy (freedesktop.org, ModemManager reference, "Modem filter"). Under ``strict``, the
default, these are ports that declare themselves for AT commands: USB class 2, subclass 2, protocol 1 to 6. Many
firmwares do so, because their vendor's example does. Other policies probe more.
"""

from __future__ import annotations

from itertools import pairwise

from wirebond.link.devices.doctor.finding import Finding, Verdict, udev_rule
from wirebond.link.devices.doctor.machine import Machine
from wirebond.link.devices.processes import Process
from wirebond.link.devices.serial_port import SerialPort

_IGNORED = ("ID_MM_DEVICE_IGNORE", "ID_MM_PORT_IGNORE")
_WANTED = "ID_MM_DEVICE_PROCESS"
_CAREFUL = ("strict", "allowlist-only", "whitelist-only")


def check_modem_manager(machine: Machine, port: SerialPort) -> Finding | None:
    """Check whether ModemManager may open the port; None if it is not a USB device: those it leaves alone."""
    if port.usb is None:
        return None
    daemon = machine.runs("ModemManager")
    if daemon is None:
        return Finding("modem manager", Verdict.OK, "ModemManager does not run", port.path)
    known = machine.udev_properties(port)
    if any(known.get(name) == "1" for name in _IGNORED):
        return Finding("modem manager", Verdict.OK, "a rule of udev tells ModemManager to leave it alone", port.path)
    policy = _policy(daemon)
    is_careful = policy in _CAREFUL and not (policy == "strict" and _is_for_commands(machine, port))
    if is_careful and known.get(_WANTED) != "1":
        return Finding("modem manager", Verdict.OK, f"ModemManager leaves it alone (policy {policy})", port.path)
    ids = f'ATTRS{{idVendor}}=="{port.usb.vendor_id}", ATTRS{{idProduct}}=="{port.usb.product_id}"'
    return Finding(
        "modem manager",
        Verdict.WARNING,
        "ModemManager takes it for a modem. When the board is plugged in, ModemManager opens the port for some seconds "
        "and sends AT commands to the MCU. These commands add a rule of udev against that",
        port.path,
        udev_rule("78-no-modem.rules", f'{ids}, ENV{{ID_MM_DEVICE_IGNORE}}="1"'),
        "then plug it in again",
    )


def _policy(daemon: Process) -> str:
    """Return the policy with which it was started; ``strict`` by default."""
    words = [word for part in daemon.command for word in part.split("=", 1)]
    return dict(pairwise(words)).get("--filter-policy", "strict").lower()


def _is_for_commands(machine: Machine, port: SerialPort) -> bool:
    interface = machine.interface_of(port)
    if interface is None or port.driver != "cdc_acm":
        return False
    kind = (interface.number("bInterfaceClass"), interface.number("bInterfaceSubClass"))
    return kind == (2, 2) and 1 <= (interface.number("bInterfaceProtocol") or 0) <= 6
