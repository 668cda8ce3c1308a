"""One oracle for each file of protocols/contrib, whose README lists the libraries and their licences."""

from __future__ import annotations

from pymodbus.framer import FramerAscii

from tests.contrib.oracle import Oracle
from tests.contrib.oracles.crsf import Crsf
from tests.contrib.oracles.cyphal_serial import CyphalSerial
from tests.contrib.oracles.dynamixel_1 import Dynamixel1
from tests.contrib.oracles.dynamixel_2 import Dynamixel2
from tests.contrib.oracles.feetech import Feetech
from tests.contrib.oracles.hdlc import Hdlc
from tests.contrib.oracles.ibus import Ibus
from tests.contrib.oracles.lx16a import Lx16a
from tests.contrib.oracles.mavlink import Mavlink
from tests.contrib.oracles.modbus_rtu import ModbusRtu
from tests.contrib.oracles.msp import Msp
from tests.contrib.oracles.nmea import Nmea
from tests.contrib.oracles.ping_sonar import PingSonar
from tests.contrib.oracles.robomaster_referee import RobomasterReferee
from tests.contrib.oracles.rtcm3 import Rtcm3
from tests.contrib.oracles.sbf import Sbf
from tests.contrib.oracles.sbus import Sbus
from tests.contrib.oracles.sensirion_shdlc import SensirionShdlc
from tests.contrib.oracles.slip import Slip
from tests.contrib.oracles.sphero import Sphero
from tests.contrib.oracles.tfmini import Tfmini
from tests.contrib.oracles.tsip import Tsip
from tests.contrib.oracles.ubx import Ubx
from tests.contrib.oracles.vesc import Vesc
from tests.contrib.oracles.xbee_api import XbeeApi

#: By the name of the protocol file.
ORACLES: dict[str, Oracle] = {
    "crsf": Crsf(),
    "cyphal_serial": CyphalSerial(),
    "dynamixel_1": Dynamixel1(),
    "dynamixel_2": Dynamixel2(),
    "feetech": Feetech(),
    "hdlc": Hdlc(),
    "ibus": Ibus(),
    "lx16a": Lx16a(),
    "mavlink": Mavlink(),
    "modbus_ascii": ModbusRtu(FramerAscii),
    "modbus_rtu": ModbusRtu(),
    "msp": Msp(),
    "nmea": Nmea(),
    "ping_sonar": PingSonar(),
    "robomaster_referee": RobomasterReferee(),
    "rtcm3": Rtcm3(),
    "sbf": Sbf(),
    "sbus": Sbus(),
    "sensirion_shdlc": SensirionShdlc(),
    "slip": Slip(),
    "sphero": Sphero(),
    "tfmini": Tfmini(),
    "tsip": Tsip(),
    "ubx": Ubx(),
    "vesc": Vesc(),
    "xbee_api": XbeeApi(),
    "xbee_api_2": XbeeApi(escaped=True),
}
