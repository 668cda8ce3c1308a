"""Is a serial adapter plugged in for which no driver is loaded? Then it has no port."""

from __future__ import annotations

from wirebond.link.devices.doctor.finding import Finding, Verdict
from wirebond.link.devices.doctor.machine import Machine, UsbFolder

# Kernel modules by the ids in their tables (drivers/usb/serial), of adapter chips that are on boards and in cables.
_MODULES = {
    "1a86:7523": ("CH340", "ch341"),
    "1a86:7522": ("CH340", "ch341"),
    "1a86:5523": ("CH341", "ch341"),
    "10c4:ea60": ("CP210x", "cp210x"),
    "10c4:ea70": ("CP2105", "cp210x"),
    "10c4:ea71": ("CP2108", "cp210x"),
    "0403:6001": ("FT232R", "ftdi_sio"),
    "0403:6010": ("FT2232", "ftdi_sio"),
    "0403:6011": ("FT4232H", "ftdi_sio"),
    "0403:6014": ("FT232H", "ftdi_sio"),
    "0403:6015": ("FT230X", "ftdi_sio"),
    "067b:2303": ("PL2303", "pl2303"),
}
_CDC_ACM = (2, 2)  # class and subclass of a USB device that is its own serial adapter


def check_driver(machine: Machine) -> list[Finding]:
    """Return a finding for each adapter without a driver."""
    found = []
    for interface in machine.usb_interfaces:
        adapter = _adapter(interface)
        if interface.driver is not None or adapter is None:
            continue
        name, module = adapter
        found.append(
            Finding(
                "driver",
                Verdict.PROBLEM,
                f"{name} is plugged in ({interface.folder.parent.name}), and no driver has taken it, so that it has no "
                f"port. If the command finds no module, this kernel was built without {module}",
                None,
                (f"sudo modprobe {module}",),
            )
        )
    return found


def _adapter(interface: UsbFolder) -> tuple[str, str] | None:
    """Return the kind of adapter and its kernel module."""
    device = UsbFolder(interface.folder.parent, None)
    ids = f"{device.text('idVendor')}:{device.text('idProduct')}".lower()
    if ids in _MODULES:
        return _MODULES[ids]
    if (interface.number("bInterfaceClass"), interface.number("bInterfaceSubClass")) == _CDC_ACM:
        return f"{device.text('product') or 'a USB serial device'} ({ids})", "cdc_acm"
    return None
