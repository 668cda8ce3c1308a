"""Finds what keeps a program from using a serial port of this machine, with the command that fixes it.

Each check is a file: a function over a `Machine` that reads its files, changes nothing, and needs no rights.
"""

from wirebond.link.devices.doctor.examine import examine
from wirebond.link.devices.doctor.finding import Finding, Verdict
from wirebond.link.devices.doctor.machine import Machine

__all__ = ["Finding", "Machine", "Verdict", "examine"]
