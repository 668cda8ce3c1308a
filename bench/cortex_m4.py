"""Programs for a Cortex-M: compiled, loaded into an emulator, their functions called, their instructions counted."""

from __future__ import annotations

import struct
import subprocess
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import unicorn
from elftools.elf.constants import SH_FLAGS
from elftools.elf.elffile import ELFFile
from unicorn import arm_const

from bench.native import BUILD

COMPILER = "arm-none-eabi-g++"


@dataclass(frozen=True)
class Processor:
    name: str
    flags: tuple[str, ...]
    model: int  # as unicorn has it


M4 = Processor(
    "cortex-m4",
    ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"),
    arm_const.UC_CPU_ARM_CORTEX_M4,
)
M0 = Processor("cortex-m0", ("-mcpu=cortex-m0", "-mthumb"), arm_const.UC_CPU_ARM_CORTEX_M0)
FLAGS = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-fno-exceptions", "-fno-rtti", "-fno-threadsafe-statics"]
LINK = ["-nostartfiles", "--specs=nano.specs", "--specs=nosys.specs"]  # newlib-nano, as firmware has it

STREX = 0xE840  # its first halfword, but for a register's number
MEMORY = 1 << 20  # from address 0: program, variables and stack
END_OF_CALL = MEMORY - 16  # where a called function returns to; nothing is there
MOST_INSTRUCTIONS = 20_000_000  # of one call


def compile_program(
    source: Path,
    optimise: str,
    includes: Sequence[Path],
    *,
    keep: Sequence[str] = ("receive",),
    processor: Processor = M4,
    more: Sequence[str] = (),
    name: str | None = None,
) -> Path:
    """``source`` as an ELF file. Headers in ``includes`` are taken for a system's: their warnings are not ours.

    ``keep``: functions that are in the program though nothing calls them. ``more``: flags. ``name``: of the file,
    where the source alone does not tell programs apart.
    """
    BUILD.mkdir(parents=True, exist_ok=True)
    program = BUILD / f"{name or source.stem}{optimise}.elf"
    folders = [f"-isystem{folder}" for folder in includes]
    flags = [*processor.flags, *FLAGS, optimise, *more]
    command = [COMPILER, *flags, *folders, str(source), *LINK, f"-Wl,-e,{keep[0]}", *(f"-Wl,-u,{k}" for k in keep)]
    subprocess.run([*command, "-o", str(program)], check=True)
    return program


class Program:
    """An ELF file in an emulated processor's memory. Variables keep their values from call to call."""

    def __init__(self, elf: Path, processor: Processor = M4) -> None:
        with elf.open("rb") as file:
            content = ELFFile(file)
            table = content.get_section_by_name(".symtab")
            self.symbols = {symbol.name: symbol["st_value"] & ~1 for symbol in table.iter_symbols()}
            self.sizes = {symbol.name: symbol["st_size"] for symbol in table.iter_symbols()}
            loaded = [(s["p_paddr"], s.data()) for s in content.iter_segments("PT_LOAD")]
            allocated = [s for s in content.iter_sections() if s["sh_flags"] & SH_FLAGS.SHF_ALLOC]
            self.flash_bytes = sum(s["sh_size"] for s in allocated if s["sh_type"] != "SHT_NOBITS")
            beginnings = content.get_section_by_name(".init_array")
            constructors = [] if beginnings is None else list(struct.iter_unpack("<I", beginnings.data()))
        self._processor = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self._processor.ctl_set_cpu_model(processor.model)
        self._processor.mem_map(0, MEMORY)
        for address, data in loaded:
            self._processor.mem_write(address, data)
        if processor is M4:
            self._processor.reg_write(arm_const.UC_ARM_REG_FPEXC, 0x40000000)
        self.counts: Counter[int] = Counter()
        self.longest_masked = 0  # instructions in a row with interrupts masked, of all calls
        self._masked = 0
        self._processor.hook_add(unicorn.UC_HOOK_CODE, self._count)
        for (address,) in constructors:
            self._run(address)

    def _count(self, processor: unicorn.Uc, address: int, _size: int, _data: object) -> None:
        self.counts[address] += 1
        self._masked = self._masked + 1 if processor.reg_read(arm_const.UC_ARM_REG_PRIMASK) & 1 else 0
        self.longest_masked = max(self.longest_masked, self._masked)

    def call(self, function: str, *arguments: int) -> int:
        """Its first result. ``counts`` has how often each address was executed."""
        registers = (arm_const.UC_ARM_REG_R0, arm_const.UC_ARM_REG_R1, arm_const.UC_ARM_REG_R2, arm_const.UC_ARM_REG_R3)
        for register, value in zip(registers, arguments, strict=False):
            self._processor.reg_write(register, value)
        self.counts.clear()
        self._run(self.symbols[function])
        return int(self._processor.reg_read(arm_const.UC_ARM_REG_R0))

    def _run(self, address: int) -> None:
        self._processor.reg_write(arm_const.UC_ARM_REG_SP, END_OF_CALL - 16)
        self._processor.reg_write(arm_const.UC_ARM_REG_LR, END_OF_CALL | 1)
        self._processor.emu_start(address | 1, END_OF_CALL, count=MOST_INSTRUCTIONS)
        assert self._processor.reg_read(arm_const.UC_ARM_REG_PC) == END_OF_CALL, f"{address:#x} does not end"

    def exclusive_stores(self) -> int:
        """STREX instructions of the last call."""
        return sum(count for address, count in self.counts.items() if self._halfword(address) & 0xFFF0 == STREX)

    def _halfword(self, address: int) -> int:
        return int.from_bytes(self._processor.mem_read(address, 2), "little")

    def write(self, variable: str, content: bytes) -> None:
        self._processor.mem_write(self.symbols[variable], content)

    def read(self, variable: str, size: int) -> bytes:
        return bytes(self._processor.mem_read(self.symbols[variable], size))
