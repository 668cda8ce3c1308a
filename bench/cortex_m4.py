"""Programs for a Cortex-M4: compiled, loaded into an emulator, their functions called, their instructions counted."""

from __future__ import annotations

import subprocess
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import unicorn
from elftools.elf.elffile import ELFFile
from unicorn import arm_const

from bench.native import BUILD

COMPILER = "arm-none-eabi-g++"
PROCESSOR = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]
FLAGS = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-fno-exceptions", "-fno-rtti", "-fno-threadsafe-statics"]
LINK = ["-nostartfiles", "--specs=nano.specs", "--specs=nosys.specs"]  # newlib-nano, as firmware has it

MEMORY = 1 << 20  # from address 0: program, variables and stack
END_OF_CALL = MEMORY - 16  # where a called function returns to; nothing is there
MOST_INSTRUCTIONS = 20_000_000  # of one call


def compile_program(source: Path, optimise: str, includes: Sequence[Path]) -> Path:
    """``source`` as an ELF file. Headers in ``includes`` are taken for a system's: their warnings are not ours."""
    BUILD.mkdir(parents=True, exist_ok=True)
    program = BUILD / f"{source.stem}{optimise}.elf"
    folders = [f"-isystem{folder}" for folder in includes]
    command = [COMPILER, *PROCESSOR, *FLAGS, optimise, *folders, str(source), *LINK, "-Wl,-e,receive"]
    subprocess.run([*command, "-o", str(program)], check=True)
    return program


class Program:
    """An ELF file in an emulated processor's memory. Variables keep their values from call to call."""

    def __init__(self, elf: Path) -> None:
        with elf.open("rb") as file:
            content = ELFFile(file)
            table = content.get_section_by_name(".symtab")
            self.symbols = {symbol.name: symbol["st_value"] & ~1 for symbol in table.iter_symbols()}
            loaded = [(s["p_paddr"], s.data()) for s in content.iter_segments("PT_LOAD")]
        self._processor = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self._processor.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M4)
        self._processor.mem_map(0, MEMORY)
        for address, data in loaded:
            self._processor.mem_write(address, data)
        self._processor.reg_write(arm_const.UC_ARM_REG_FPEXC, 0x40000000)
        self.counts: Counter[int] = Counter()
        self._processor.hook_add(unicorn.UC_HOOK_CODE, self._count)

    def _count(self, _processor: unicorn.Uc, address: int, _size: int, _data: object) -> None:
        self.counts[address] += 1

    def call(self, function: str, *arguments: int) -> int:
        """Its first result. ``counts`` has how often each address was executed."""
        registers = (arm_const.UC_ARM_REG_R0, arm_const.UC_ARM_REG_R1, arm_const.UC_ARM_REG_R2, arm_const.UC_ARM_REG_R3)
        for register, value in zip(registers, arguments, strict=False):
            self._processor.reg_write(register, value)
        self._processor.reg_write(arm_const.UC_ARM_REG_SP, END_OF_CALL - 16)
        self._processor.reg_write(arm_const.UC_ARM_REG_LR, END_OF_CALL | 1)
        self.counts.clear()
        self._processor.emu_start(self.symbols[function] | 1, END_OF_CALL, count=MOST_INSTRUCTIONS)
        assert self._processor.reg_read(arm_const.UC_ARM_REG_PC) == END_OF_CALL, f"{function} does not end"
        return int(self._processor.reg_read(arm_const.UC_ARM_REG_R0))

    def write(self, variable: str, content: bytes) -> None:
        self._processor.mem_write(self.symbols[variable], content)

    def read(self, variable: str, size: int) -> bytes:
        return bytes(self._processor.mem_read(self.symbols[variable], size))
