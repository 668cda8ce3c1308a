"""The serial ports of this machine: their list, their names, who may open them. Opens none.

>>> from wirebond.link.devices import resolve, serial_ports
>>> [port.path for port in serial_ports()]  # doctest: +SKIP
['/dev/ttyACM0', '/dev/ttyUSB0']
>>> resolve("usb:1a86:55d3")  # doctest: +SKIP
'/dev/ttyACM0'
"""

from wirebond.link.devices.discovery import can_list_ports, serial_ports
from wirebond.link.devices.names import resolve, stable_name, which_there_are
from wirebond.link.devices.permission import group_of, no_permission
from wirebond.link.devices.serial_port import SerialPort, UsbInterface

__all__ = [
    "SerialPort",
    "UsbInterface",
    "can_list_ports",
    "group_of",
    "no_permission",
    "resolve",
    "serial_ports",
    "stable_name",
    "which_there_are",
]
