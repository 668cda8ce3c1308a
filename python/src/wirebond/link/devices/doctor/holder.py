"""Does another process have the port open?"""

from __future__ import annotations

from wirebond.link.devices.doctor.finding import Finding, Verdict
from wirebond.link.devices.doctor.machine import Machine
from wirebond.link.devices.processes import Process, named
from wirebond.link.devices.serial_port import SerialPort

# What keeps a port for itself as a service: ending the process does not help, it would be started again.
_SERVICES = {
    "ModemManager": ("sudo systemctl disable --now ModemManager",),
    "brltty": ("sudo systemctl disable --now brltty",),
    "gpsd": ("sudo systemctl disable --now gpsd.socket gpsd",),
    "ser2net": ("sudo systemctl disable --now ser2net",),
}
_GETTYS = ("agetty", "getty", "login")


def check_holder(machine: Machine, port: SerialPort) -> Finding:
    holders = [process for process in machine.processes if process.uses(port.path)]
    if holders:
        verb = "has" if len(holders) == 1 else "have"
        return Finding("holder", Verdict.PROBLEM, f"{named(holders)} {verb} it open", port.path, _cure(holders, port))
    hidden = sum(process.opened is None and bool(process.command) for process in machine.processes)
    if hidden:
        return Finding(
            "holder",
            Verdict.CANNOT_TELL,
            f"no process that you may look into has it open; into {hidden} you may not",
            port.path,
            (f"sudo fuser -v {port.path}",),
        )
    return Finding("holder", Verdict.OK, "no other process has it open", port.path)


def _cure(holders: list[Process], port: SerialPort) -> tuple[str, ...]:
    commands: list[str] = []
    for process in holders:
        if process.name in _GETTYS:
            unit = f"serial-getty@{port.path.removeprefix('/dev/')}.service"
            commands.append(f"sudo systemctl disable --now {unit}")
        else:
            commands += _SERVICES.get(process.name, (f"kill {process.pid}",))
    return tuple(dict.fromkeys(commands))
