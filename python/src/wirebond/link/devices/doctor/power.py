"""May Linux put the USB device to sleep?

The file ``power/control`` says ``on`` (never) or ``auto`` (when idle); tools that save power set ``auto``. The drivers
of adapter chips keep an open port awake. The driver cdc_acm lets the device sleep while the port is open. It counts on
the firmware to wake the computer when it has something to send, and not every firmware does.
"""

from __future__ import annotations

from wirebond.link.devices.doctor.finding import Finding, Verdict
from wirebond.link.devices.doctor.machine import Machine
from wirebond.link.devices.serial_port import SerialPort

_SLEEPS_WHILE_OPEN = "cdc_acm"


def check_autosuspend(machine: Machine, port: SerialPort) -> Finding | None:
    """Check autosuspend; None if it is not a USB device."""
    device = machine.usb_device_of(port)
    if device is None or port.usb is None:
        return None
    control = device.text("power/control")
    if control is None:
        return Finding("autosuspend", Verdict.CANNOT_TELL, "its power settings cannot be read", port.path)
    if control != "auto":
        return Finding("autosuspend", Verdict.OK, "Linux keeps it awake", port.path)
    if port.driver != _SLEEPS_WHILE_OPEN:
        return Finding("autosuspend", Verdict.OK, "Linux may put it to sleep, but not while it is open", port.path)
    usb = port.usb
    rule = (
        f'ACTION=="add", SUBSYSTEM=="usb", ATTR{{idVendor}}=="{usb.vendor_id}", '
        f'ATTR{{idProduct}}=="{usb.product_id}", ATTR{{power/control}}="on"'
    )
    return Finding(
        "autosuspend",
        Verdict.WARNING,
        "Linux may put it to sleep when it is idle, also while it is open; bytes that the MCU sends then may be late "
        "or lost. The first command keeps it awake until it is unplugged, the others permanently",
        port.path,
        (
            f"echo on | sudo tee /sys/bus/usb/devices/{usb.location}/power/control",
            f"echo '{rule}' | sudo tee -a /etc/udev/rules.d/70-usb-awake.rules",
            "sudo udevadm control --reload",
        ),
    )
