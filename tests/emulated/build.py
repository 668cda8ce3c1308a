"""Compiles programs for the emulated board: the tests' own files, the FreeRTOS kernel, generated headers."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import wirebond
from tests.conformance.build import run
from tests.shared import PROTOCOLS, ROOT
from wirebond.codegen import generate_cpp

HERE = Path(__file__).parent
BOARD = HERE / "board"
BUILD = ROOT / "build" / "emulated"
CRATES = ROOT / "build" / "freertos"  # setup/freertos says what lies there
KERNEL_FILES = ("tasks.c", "list.c", "portable/GCC/ARM_CM4F/port.c")

PROCESSOR = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]
SHARED_FLAGS = ["-O2", "-g1", "-ffunction-sections", "-fdata-sections"]
CPP_FLAGS = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-fno-exceptions", "-fno-rtti", "-fno-threadsafe-statics"]
LINK_FLAGS = ["-nostartfiles", "--specs=nano.specs", "-Wl,--gc-sections", "-Wl,--fatal-warnings"]


def kernel() -> Path:
    """The kernel's tree. AssertionError, with what to do, where it was not fetched."""
    found = sorted(CRATES.glob("freertos-next-*/FreeRTOS-Kernel"))
    assert found, f"no FreeRTOS kernel lies in {CRATES.relative_to(ROOT)}; `make build/freertos.stamp` fetches it"
    return found[-1]


def build(program: Path, protocol: str, *, includes: Sequence[Path] = (), definitions: Sequence[str] = ()) -> Path:
    """The ELF file of ``program``, a C++ file, with the kernel and the header of ``protocols/<protocol>.yaml``.

    It is compiled only if none of the same sources, flags and compiler is there. Several processes may ask at once.
    AssertionError with the compiler's words when it does not compile.
    """
    BUILD.mkdir(parents=True, exist_ok=True)
    tree = kernel()
    flags = [*PROCESSOR, *SHARED_FLAGS, *(f"-D{definition}" for definition in definitions)]
    kernel_includes = [f"-isystem{tree / 'include'}", f"-isystem{tree / 'portable/GCC/ARM_CM4F'}"]
    with tempfile.TemporaryDirectory(dir=BUILD) as name:
        folder = Path(name)
        headers = generate_cpp(wirebond.load(PROTOCOLS / f"{protocol}.yaml").model, folder / "generated")
        own = [*BOARD.iterdir(), program, *(path for base in includes for path in base.rglob("*.[ch]pp"))]
        version = run(["arm-none-eabi-g++", "--version"])
        how = [version, *flags, *CPP_FLAGS, *LINK_FLAGS, *KERNEL_FILES, tree.parent.name]
        content = hashlib.sha256("\0".join(how).encode())
        for path in sorted([*headers, *own]):
            content.update(path.name.encode() + b"\0" + path.read_bytes())
        elf = BUILD / f"{program.stem}_{content.hexdigest()[:16]}.elf"
        if elf.exists():
            return elf
        objects = []
        for file in KERNEL_FILES:
            objects.append(folder / f"{Path(file).stem}.o")
            c = ["arm-none-eabi-gcc", *flags, *kernel_includes, f"-I{BOARD}"]
            run([*c, "-c", str(tree / file), "-o", str(objects[-1])])
        made = folder / "made"
        sources = [str(path) for path in (program, BOARD / "startup.cpp", BOARD / "kernel.cpp", *objects)]
        folders = [f"-I{path}" for path in (BOARD, folder / "generated", *includes)]
        cpp = ["arm-none-eabi-g++", *flags, *CPP_FLAGS, *folders, *kernel_includes]
        run([*cpp, *sources, *LINK_FLAGS, "-T", str(BOARD / "stm32f405.ld"), "-o", str(made)])
        shutil.move(made, elf)  # a rename within one file system: others see all of it or nothing
        return elf
