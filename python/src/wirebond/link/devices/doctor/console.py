"""Is the port a console: of the kernel, which writes its messages there, or of a login, which answers what arrives?"""

from __future__ import annotations

import os
import re

from wirebond.link.devices.discovery import link_target
from wirebond.link.devices.doctor.finding import Finding, Verdict
from wirebond.link.devices.doctor.machine import Machine
from wirebond.link.devices.serial_port import SerialPort

_WANTS = (  # units that systemd starts: its generator chose them from the kernel's command line, or `enable` did
    "/run/systemd/generator/getty.target.wants",
    "/etc/systemd/system/getty.target.wants",
)
_COMMAND_LINE_FILES = (  # files with the kernel's command line, by boot loader
    "/boot/firmware/cmdline.txt",  # Raspberry Pi
    "/boot/cmdline.txt",  # the same, older
    "/boot/extlinux/extlinux.conf",  # U-Boot: Jetson and others
    "/etc/default/grub",
)


def check_console(machine: Machine, port: SerialPort) -> Finding:
    name = port.path.removeprefix("/dev/")
    writes, login = _kernel_writes(machine, name), _login(machine, name)
    if not writes and login is None:
        return Finding("console", Verdict.OK, "it is not a console", port.path)
    said = []
    cure: list[str] = []
    if writes:
        said.append("the kernel writes its messages to it (`console=` on its command line)")
        cure += _without_console(machine)
    if login is not None:
        said.append("a login console runs on it and answers the MCU")
        cure.append(login)
    where = (
        "there" if len(cure) > (login is not None) else "from the kernel's command line, in your boot loader's settings"
    )
    then = f"remove `console={name}...` {where}, and start the computer again" if writes else None
    return Finding("console", Verdict.PROBLEM, ", and ".join(said), port.path, tuple(cure), then)


def _kernel_writes(machine: Machine, name: str) -> bool:
    active = machine.text("/sys/class/tty/console/active")
    if active is not None:
        return name in active.split()
    line = machine.text("/proc/cmdline") or ""
    return name in {_device(machine, found) for found in re.findall(r"\bconsole=([\w.]+)", line)}


def _device(machine: Machine, name: str) -> str:
    """Return the device of a name: `serial0` of a Raspberry Pi is a link to ttyAMA0 or ttyS0."""
    target = link_target(machine.root, f"/dev/{name}")
    return name if target is None else os.path.basename(target)  # noqa: PTH119 text, not a file


def _login(machine: Machine, name: str) -> str | None:
    """Return the command that ends the login console; None if there is none."""
    unit = f"serial-getty@{name}.service"
    runs = any(
        process.name in ("agetty", "getty") and name in " ".join(process.command).replace("/", " ").split()
        for process in machine.processes
    )
    if not runs and not any(machine.exists(f"{folder}/{unit}") for folder in _WANTS):
        return None
    if not runs and link_target(machine.root, f"/etc/systemd/system/{unit}") == "/dev/null":
        return None  # it is masked
    nvidia = "/etc/systemd/system/multi-user.target.wants/nvgetty.service"
    return f"sudo systemctl disable --now {'nvgetty' if machine.exists(nvidia) else unit}"


def _without_console(machine: Machine) -> tuple[str, ...]:
    file = next((file for file in _COMMAND_LINE_FILES if machine.exists(file)), None)
    if file is None:
        return ()
    return (f"sudoedit {file}", *(("sudo update-grub",) if file == "/etc/default/grub" else ()))
