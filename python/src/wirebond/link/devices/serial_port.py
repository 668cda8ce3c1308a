"""The facts about one serial port: plain values, and nothing that reads them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class UsbInterface:
    """The part of a USB device that a port belongs to. Ids are four lower-case hex digits, as in ``1a86``.

    ``serial``, ``manufacturer`` and ``product`` are what the device says of itself; many say nothing. ``interface`` is
    its number in the device; a device with several ports has several. ``port_number`` counts the ports of one interface
    (nearly always 0). ``location`` is the socket, as in ``1-1.2``: bus 1, its port 1, port 2 of the hub there.
    """

    vendor_id: str
    product_id: str
    serial: str | None
    manufacturer: str | None
    product: str | None
    interface: int
    interface_name: str | None
    port_number: int
    location: str


@dataclass(frozen=True)
class SerialPort:
    """A serial port of this machine.

    ``path`` is its device now; when it is plugged in again, it may get another one. ``by_id`` and ``by_path`` are
    udev's links to it, where there are any. ``usb`` is None if it is not a USB device. ``has_device`` is False if the
    kernel knows the port, but there is no file ``path``, as in a container that was not given it. ``latency_timer_ms``:
    how long an FTDI adapter holds received bytes back; None for other ports.
    """

    path: str
    description: str
    driver: str | None
    usb: UsbInterface | None
    by_id: str | None
    by_path: str | None
    has_device: bool
    latency_timer_ms: int | None = None

    @property
    def is_usb(self) -> bool:
        return self.usb is not None
