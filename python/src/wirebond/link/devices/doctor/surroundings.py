"""Detects a container, or Linux on Windows (WSL)."""

from __future__ import annotations

from wirebond.link.devices.doctor.finding import Finding, Verdict
from wirebond.link.devices.doctor.machine import Machine


def container(machine: Machine) -> str | None:
    """Return the kind of container, or None if its files show none."""
    if machine.exists("/.dockerenv"):
        return "Docker container"
    if machine.exists("/run/.containerenv"):
        return "Podman container"
    kind = machine.text("/run/systemd/container")
    return f"{kind} container" if kind else None


def check_wsl(machine: Machine) -> Finding | None:
    """Check the USB devices of WSL; None if this is not WSL. There, Windows has them until they are given to Linux."""
    release = machine.text("/proc/sys/kernel/osrelease") or ""
    if "microsoft" not in release.lower():
        return None
    if any(port.is_usb for port in machine.ports):
        return Finding("wsl", Verdict.OK, "this is WSL, and Windows has given it a USB serial port")
    if "WSL2" not in release and "microsoft-standard" not in release:
        return Finding(
            "wsl",
            Verdict.WARNING,
            "this is WSL 1, which sees no USB devices: COM3 of Windows is /dev/ttyS3 here. WSL 2 can be given USB "
            "devices; the command for PowerShell",
            None,
            ("wsl --set-version <distribution> 2",),
        )
    return Finding(
        "wsl",
        Verdict.PROBLEM,
        "this is WSL 2, and Windows keeps its USB devices until one is given to Linux. The commands are for "
        "PowerShell; the first shows the BUSID, the second needs an administrator",
        None,
        (
            "usbipd list",
            "usbipd bind --busid <BUSID>",
            "usbipd attach --wsl --busid <BUSID> --auto-attach",
        ),
        "if usbipd is not known: winget install usbipd",
    )
