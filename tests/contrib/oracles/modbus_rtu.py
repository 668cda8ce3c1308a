"""Modbus RTU and ASCII against pymodbus."""

from __future__ import annotations

import logging
import random
from typing import Any

from pymodbus.framer import FramerAscii, FramerRTU
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu import register_message as registers

from tests.contrib.oracle import Case, Oracle, Wire
from wirebond.protocol.model import End, Message

_DIGITS = set(b"0123456789ABCDEFabcdef")
_REFUSED = {"read_refused": 3, "write_refused": 6, "writes_refused": 16}
logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # refused frames are the point here


class ModbusRtu(Oracle):
    def __init__(self, framer: type[FramerAscii] | type[FramerRTU] = FramerRTU) -> None:
        self._framers = {end: framer(DecodePDU(is_server=end == End.HOST)) for end in (End.HOST, End.MCU)}

    def header(self, message: Message, source: random.Random) -> dict[str, int]:
        return {"unit": source.randrange(1, 248)}

    def values(self, message: Message, source: random.Random) -> dict[str, Any]:
        values = super().values(message, source)
        if "registers" in values:
            number = source.randrange(1, 124)
            values["registers"] = [source.randrange(65536) for _ in range(number)]
        return values

    def encode(self, case: Case) -> bytes | None:
        pdu = _pdu(case.message, case.sender, case.wire)
        return self._framers[case.sender].encode(bytes([pdu.function_code]) + pdu.encode(), case.header["unit"], 0)

    def decode(self, frame: bytes, sender: End) -> Case | None:
        framer = self._framers[sender]
        if len(frame) < framer.MIN_SIZE:
            return None
        if isinstance(framer, FramerAscii):
            if not set(frame[1:-2]) <= _DIGITS:
                return None  # the library ends with an error of Python's, or takes a sign or a space for a digit
            size = (len(frame) - 3) // 2 - 2
        else:
            size = len(frame) - 3
        used, unit, _, data = framer.decode(frame)
        if len(data) != size or used != len(frame):
            return None
        pdu = framer.decoder.decode(data)
        if pdu is None:
            return None
        name, wire = _reading(pdu, sender)
        return Case(name, sender, wire, {"unit": unit})


def _pdu(name: str, sender: End, wire: Wire) -> ModbusPDU:
    if name in _REFUSED:
        return ExceptionResponse(_REFUSED[name], wire[0])
    if name == "read_holding_registers":
        return registers.ReadHoldingRegistersRequest(address=wire[0], count=wire[1])
    if name == "holding_registers":
        return registers.ReadHoldingRegistersResponse(registers=wire[0])
    if name == "write_register":
        host = sender == End.HOST
        kind = registers.WriteSingleRegisterRequest if host else registers.WriteSingleRegisterResponse
        return kind(address=wire[0], registers=[wire[1]])
    if name == "write_registers":
        return registers.WriteMultipleRegistersRequest(address=wire[0], count=len(wire[1]), registers=wire[1])
    return registers.WriteMultipleRegistersResponse(address=wire[0], count=wire[1])


def _reading(pdu: ModbusPDU, sender: End) -> tuple[str, Wire]:
    if isinstance(pdu, ExceptionResponse):
        name = next((n for n, code in _REFUSED.items() if code == pdu.function_code & 0x7F), "unknown")
        return name, [pdu.exception_code]
    if pdu.function_code == 3:
        if sender == End.HOST:
            return "read_holding_registers", [pdu.address, pdu.count]
        return "holding_registers", [pdu.registers]
    if pdu.function_code == 6:
        return "write_register", [pdu.address, pdu.registers[0]]
    if sender == End.HOST:
        return "write_registers", [pdu.address, pdu.registers]
    return "registers_written", [pdu.address, pdu.count]
