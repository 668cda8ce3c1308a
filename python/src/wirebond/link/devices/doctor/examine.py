"""The list of checks, and the ports that each one examines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from wirebond.errors import PortError
from wirebond.link.devices import sysfs
from wirebond.link.devices.discovery import can_list_ports, link_target
from wirebond.link.devices.doctor.brltty import check_brltty
from wirebond.link.devices.doctor.console import check_console
from wirebond.link.devices.doctor.device import check_device, check_permission
from wirebond.link.devices.doctor.driver import check_driver
from wirebond.link.devices.doctor.finding import Finding, Verdict
from wirebond.link.devices.doctor.holder import check_holder
from wirebond.link.devices.doctor.latency_timer import check_latency_timer
from wirebond.link.devices.doctor.machine import Machine
from wirebond.link.devices.doctor.modem_manager import check_modem_manager
from wirebond.link.devices.doctor.power import check_autosuspend
from wirebond.link.devices.doctor.surroundings import check_wsl, container
from wirebond.link.devices.names import matching, resolve, which_there_are
from wirebond.link.devices.serial_port import SerialPort

# None: the question does not arise for this port.
PORT_CHECKS: tuple[Callable[[Machine, SerialPort], Finding | None], ...] = (
    check_device,
    check_permission,
    check_holder,
    check_console,
    check_modem_manager,
    check_latency_timer,
    check_autosuspend,
)


def examine(machine: Machine, name: str | None = None) -> list[Finding]:
    """Return the findings for the port `name`, as `resolve` takes it, or for all ports; and for the machine.

    :raises UsageError: `name` begins with ``usb:`` and is written wrong.
    """
    if not can_list_ports(machine.root):
        said = "obstacles are found in files such as /sys/class/tty, which only Linux has"
        return [Finding("port", Verdict.CANNOT_TELL, said, name)]
    ports, findings = _ports(machine, name)
    for port in ports:
        mine = [finding for check in PORT_CHECKS if (finding := check(machine, port)) is not None]
        findings += mine if name is not None else [_not_asked_for(port, finding) for finding in mine]
    findings += check_brltty(machine)
    findings += check_driver(machine)
    wsl = check_wsl(machine)
    return findings + ([wsl] if wsl is not None else [])


def _not_asked_for(port: SerialPort, finding: Finding) -> Finding:
    """Return a UART of the board, or a port that is in use, may be there for something else: no problem unless
    wanted."""
    may_be_meant = not port.is_usb or finding.check == "holder"
    is_less = may_be_meant and finding.verdict is Verdict.PROBLEM
    return replace(finding, verdict=Verdict.WARNING) if is_less else finding


def _ports(machine: Machine, name: str | None) -> tuple[list[SerialPort], list[Finding]]:
    """Return the ports to be checked, and what there is to say before that."""
    if name is None:
        return machine.ports, [] if machine.ports else [_nothing(machine)]
    if "://" in name:
        said = f"{name} is an address of another machine or program; doctor looks at the serial ports of this machine"
        return [], [Finding("port", Verdict.CANNOT_TELL, said, name)]
    fitting = matching(name, machine.ports) if name.startswith("usb:") else []
    if len(fitting) == 1:
        return fitting, []
    try:
        path = _followed(machine, resolve(name, machine.root))
    except PortError as error:
        return fitting, [Finding("port", Verdict.PROBLEM, str(error), name)]
    known = [port for port in machine.ports if port.path == path]
    if known or sysfs.below(machine.root, path).exists():
        return known or [_other(path)], []
    return [], [Finding("port", Verdict.PROBLEM, f"there is no {path}; {which_there_are(machine.ports)}", name)]


def _followed(machine: Machine, path: str) -> str:
    """Follow links such as those of ``wirebond sim --link`` and boards' ``/dev/serial0``."""
    for _ in range(8):  # a link that leads to itself ends somewhere
        target = link_target(machine.root, path)
        if target is None:
            break
        path = target
    return path


def _other(path: str) -> SerialPort:
    return SerialPort(path, "no serial hardware: a pty, or something else", None, None, None, None, True)


def _nothing(machine: Machine) -> Finding:
    kind = container(machine)
    where = f", and this {kind} sees what its host sees" if kind else ""
    return Finding(
        "port",
        Verdict.PROBLEM,
        f"the kernel has no serial port{where}. Check that the board is plugged in and has power, and that its cable "
        "carries data: some only charge. If the command prints nothing while you plug it in, it is the cable, the "
        "socket or the board",
        None,
        ("sudo dmesg --follow",),
    )
