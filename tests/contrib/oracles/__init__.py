"""One oracle for each file of protocols/contrib, whose README lists the libraries and their licences."""

from __future__ import annotations

from tests.contrib.oracle import Oracle
from tests.contrib.oracles.crsf import Crsf
from tests.contrib.oracles.dynamixel_1 import Dynamixel1
from tests.contrib.oracles.mavlink import Mavlink
from tests.contrib.oracles.modbus_rtu import ModbusRtu
from tests.contrib.oracles.nmea import Nmea
from tests.contrib.oracles.ping_sonar import PingSonar
from tests.contrib.oracles.sbf import Sbf
from tests.contrib.oracles.slip import Slip
from tests.contrib.oracles.tfmini import Tfmini
from tests.contrib.oracles.ubx import Ubx
from tests.contrib.oracles.xbee_api import XbeeApi

#: By the name of the protocol file.
ORACLES: dict[str, Oracle] = {
    "crsf": Crsf(),
    "dynamixel_1": Dynamixel1(),
    "mavlink": Mavlink(),
    "modbus_rtu": ModbusRtu(),
    "nmea": Nmea(),
    "ping_sonar": PingSonar(),
    "sbf": Sbf(),
    "slip": Slip(),
    "tfmini": Tfmini(),
    "ubx": Ubx(),
    "xbee_api": XbeeApi(),
}
