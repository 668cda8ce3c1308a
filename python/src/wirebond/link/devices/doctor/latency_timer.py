"""The latency timer of an FTDI adapter: how long it holds received bytes back."""

from __future__ import annotations

from wirebond.link.devices import sysfs
from wirebond.link.devices.doctor.finding import Finding, Verdict
from wirebond.link.devices.doctor.machine import Machine
from wirebond.link.devices.serial_port import SerialPort

_BEST_MS = 1


def check_latency_timer(machine: Machine, port: SerialPort) -> Finding | None:
    """Check the latency timer; None for a port without one: only the driver ftdi_sio has the file."""
    name = port.path.removeprefix("/dev/")
    path = f"/sys/bus/usb-serial/devices/{name}/latency_timer"
    timer_ms = sysfs.number(sysfs.below(machine.root, path))
    if timer_ms is None:
        return None
    if timer_ms <= _BEST_MS:
        return Finding("latency timer", Verdict.OK, f"it holds bytes back for at most {timer_ms} ms", port.path)
    rule = 'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"'
    return Finding(
        "latency timer",
        Verdict.WARNING,
        f"the adapter may hold received bytes back for {timer_ms} ms. A link of Wirebond asks for {_BEST_MS} ms while "
        f"it is open; other programs wait. The first command sets {_BEST_MS} ms until the adapter is unplugged, the "
        "others for good",
        port.path,
        (
            f"echo {_BEST_MS} | sudo tee {path}",
            f"echo '{rule}' | sudo tee -a /etc/udev/rules.d/70-ftdi-latency.rules",
            "sudo udevadm control --reload",
        ),
    )
