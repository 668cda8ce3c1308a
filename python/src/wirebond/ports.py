"""List this machine's serial ports and resolve their stable names. Opens none. See docs/ports.md.

>>> from wirebond.ports import resolve, serial_ports
>>> [port.path for port in serial_ports()]  # doctest: +SKIP
['/dev/ttyACM0', '/dev/ttyUSB0']
>>> resolve("usb:1a86:55d3")  # doctest: +SKIP
'/dev/ttyACM0'
"""

from wirebond.link.devices import SerialPort, UsbInterface, resolve, serial_ports, stable_name

__all__ = ["SerialPort", "UsbInterface", "resolve", "serial_ports", "stable_name"]
