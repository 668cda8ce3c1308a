"""Is the port's device there, and may this user read and write it?"""

from __future__ import annotations

from wirebond.link.devices.doctor.finding import Finding, Verdict, udev_rule
from wirebond.link.devices.doctor.machine import Machine
from wirebond.link.devices.doctor.surroundings import container
from wirebond.link.devices.permission import Permission, Refusal, permission, port_group
from wirebond.link.devices.serial_port import SerialPort


def check_device(machine: Machine, port: SerialPort) -> Finding:
    """Check whether a port that the kernel knows has a file."""
    if port.has_device:
        return Finding("device", Verdict.OK, "its device is there", port.path)
    name = port.path.removeprefix("/dev/")
    kind = container(machine)
    if kind is not None:
        run = "podman run" if kind.startswith("Podman") else "docker run"
        major = (machine.text(f"/sys/class/tty/{name}/dev") or "").split(":")[0]
        rule = f" --device-cgroup-rule='c {major}:* rmw'" if major else ""
        return Finding(
            "device",
            Verdict.PROBLEM,
            f"the kernel has the port, but this {kind} was not given {port.path}. Start it as the first command shows; "
            "as in the second, it also finds the port when that is plugged in again and gets another name",
            port.path,
            (f"{run} --device={port.path} ...", f"{run} -v /dev:/dev{rule} ..."),
        )
    return Finding(
        "device",
        Verdict.PROBLEM,
        f"the kernel has the port, but there is no {port.path}: udev does not run, or a rule of udev failed",
        port.path,
        (f"udevadm test /sys/class/tty/{name}", "sudo systemctl restart systemd-udevd"),
        "then plug it in again",
    )


def check_permission(machine: Machine, port: SerialPort) -> Finding | None:
    found = permission(port.path, machine.root, machine.user)
    if found is None:
        return None  # there is no device; the check above says so
    whose = f"{found.mode} {found.owner} {found.group}"
    if found.refusal is None:
        return Finding("permission", Verdict.OK, f"you may read and write it ({whose})", port.path)
    if found.refusal is Refusal.NOT_A_MEMBER:
        return Finding(
            "permission",
            Verdict.PROBLEM,
            f"you may not open it: it belongs to the group {found.group}, and you are not in it",
            port.path,
            (f"sudo usermod -aG {found.group} $USER",),
            "then log out and in again; a shell that is open does not notice",
        )
    if found.refusal is Refusal.OLD_SESSION:
        return Finding(
            "permission",
            Verdict.PROBLEM,
            f"you are in its group {found.group}, but were not when this session began",
            port.path,
            (f"newgrp {found.group}",),
            "that is for this shell; log out and in again for all others",
        )
    return _closed(machine, port, found, whose)


def _closed(machine: Machine, port: SerialPort, found: Permission, whose: str) -> Finding:
    if found.group == "tty":
        return Finding(
            "permission",
            Verdict.PROBLEM,
            f"you may not open it: {whose}. A login console has taken it; once that is ended, udev's rights come back",
            port.path,
        )
    usb = port.usb
    which = (
        f'ATTRS{{idVendor}}=="{usb.vendor_id}", ATTRS{{idProduct}}=="{usb.product_id}"'
        if usb is not None
        else f'KERNEL=="{port.path.removeprefix("/dev/")}"'
    )
    group = port_group(machine.root)
    return Finding(
        "permission",
        Verdict.PROBLEM,
        f"you may not open it, and no group may: {whose}. A rule of udev gives it to the group {group}",
        port.path,
        (
            *udev_rule("70-serial-port.rules", f'SUBSYSTEM=="tty", {which}, GROUP="{group}", MODE="0660"'),
            f"sudo usermod -aG {group} $USER",
        ),
        "then log out and in again",
    )
