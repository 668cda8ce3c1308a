"""What is in the way between a program and a serial port on this machine, with the command that cures it.

Each check is a file: a function over a `Machine` that reads its files, changes nothing, and needs no rights.
"""

from wirebond.ports.doctor.examine import examine
from wirebond.ports.doctor.finding import Finding, Verdict
from wirebond.ports.doctor.machine import Machine

__all__ = ["Finding", "Machine", "Verdict", "examine"]
