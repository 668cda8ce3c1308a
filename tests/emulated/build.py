"""Compiles programs for the emulated board: the tests' own files, the FreeRTOS kernel, generated headers."""

from __future__ import annotations

import atexit
import dataclasses
import functools
import hashlib
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import wirebond
from tests.conformance.build import run
from tests.shared import PROTOCOLS, ROOT
from wirebond.generate.code import generate_c, generate_cpp

HERE = Path(__file__).parent
BOARD = HERE / "board"
TASKS = ROOT / "ports" / "freertos" / "include"
BUILD = ROOT / "build" / "emulated"
CRATES = ROOT / "build" / "freertos"  # setup/freertos says what lies there
IDLE = 1800.0  # seconds of the machine's time: longer than any pause of ours is for it
KERNEL_FILES = ("tasks.c", "list.c", "portable/GCC/ARM_CM4F/port.c")

PROCESSOR = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]
FLAGS = [*PROCESSOR, "-g1", "-ffunction-sections", "-fdata-sections"]
C_FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Werror"]
CPP_FLAGS = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-fno-exceptions", "-fno-rtti", "-fno-threadsafe-statics"]
LINK_FLAGS = ["-nostartfiles", "--specs=nano.specs", "-Wl,--gc-sections", "-Wl,--fatal-warnings"]


def kernel() -> Path:
    """The kernel's tree. AssertionError, with what to do, where it was not fetched."""
    found = sorted(CRATES.glob("freertos-next-*/FreeRTOS-Kernel"))
    assert found, f"no FreeRTOS kernel lies in {CRATES.relative_to(ROOT)}; `make build/freertos.stamp` fetches it"
    return found[-1]


def without_silence(codec: wirebond.Codec) -> wirebond.Codec:
    """Return the codec of the same protocol for an emulated line: nothing on it is ever a silence.

    The machine skips the time in which it has nothing to do. So if this computer pauses for a moment inside a frame,
    that is for the firmware a silence of any length, which the line never had. Neither end gives up an incomplete frame
    then. Silence inside frames is a matter of the fake UART and of the host's own tests.
    """
    return wirebond.Codec(dataclasses.replace(codec.model, idle=IDLE))


def build(
    program: Path,
    protocol: str,
    *,
    in_c: Path | None = None,
    includes: Sequence[Path] = (),
    definitions: Sequence[str] = (),
    optimise: str = "-O2",
) -> Path:
    """The ELF file of ``program``, a C++ file, with the kernel and the header of ``protocols/<protocol>.yaml``, made as
    `without_silence` says.
    ``in_c``: a file in C beside it, with the protocol's generated C. ``optimise``: the program's level; the kernel's is
    always -O2.

    It is compiled only if none of the same sources, flags and compiler is there. Several processes may ask at once.
    AssertionError with the compiler's words when it does not compile.
    """
    BUILD.mkdir(parents=True, exist_ok=True)
    tree = kernel()
    common = [*FLAGS, optimise, *(f"-D{definition}" for definition in definitions)]
    flags = [*common, *CPP_FLAGS]
    with tempfile.TemporaryDirectory(dir=BUILD) as name:
        folder = Path(name)
        model = without_silence(wirebond.load(PROTOCOLS / f"{protocol}.yaml")).model
        generated = (generate_cpp if in_c is None else generate_c)(model, folder / "generated")
        shared = (TASKS, *includes)
        own = [*BOARD.iterdir(), program, *(path for base in shared for path in base.rglob("*.[ch]pp"))]
        own += [] if in_c is None else [in_c, *in_c.parent.glob("*.h")]
        version = run(["arm-none-eabi-g++", "--version"])
        how = [version, *flags, *LINK_FLAGS, *KERNEL_FILES, tree.parent.name]
        content = hashlib.sha256("\0".join(how).encode())
        for path in sorted([*generated, *own]):
            content.update(path.name.encode() + b"\0" + path.read_bytes())
        elf = BUILD / f"{program.stem}_{content.hexdigest()[:16]}.elf"
        if elf.exists():
            return elf
        made = folder / "made"
        sources = [program, BOARD / "startup.cpp", BOARD / "kernel.cpp", *_kernel_objects(tree)]
        sources += [path for path in generated if path.suffix == ".cpp"]
        folders = [f"-I{path}" for path in (BOARD, folder / "generated", *shared)]
        cpp = ["arm-none-eabi-g++", *flags, *folders, *_kernel_includes(tree)]
        if in_c is not None:
            sources.append(folder / "in_c.o")
            run(["arm-none-eabi-gcc", *common, *C_FLAGS, *folders, "-c", str(in_c), "-o", str(sources[-1])])
        run([*cpp, *map(str, sources), *LINK_FLAGS, "-T", str(BOARD / "stm32f405.ld"), "-o", str(made)])
        shutil.move(made, elf)  # a rename within one file system: others see all of it or nothing
        return elf


@functools.cache
def _kernel_objects(tree: Path) -> list[Path]:
    """Compiled once for each process; each has its own folder, so that none sees a half-written file."""
    folder = Path(tempfile.mkdtemp(dir=BUILD, prefix="kernel_"))
    atexit.register(shutil.rmtree, folder)
    objects = []
    for file in KERNEL_FILES:
        objects.append(folder / f"{Path(file).stem}.o")
        command = ["arm-none-eabi-gcc", *FLAGS, "-O2", *_kernel_includes(tree), f"-I{BOARD}"]
        run([*command, "-c", str(tree / file), "-o", str(objects[-1])])
    return objects


def _kernel_includes(tree: Path) -> list[str]:
    return [f"-isystem{tree / 'include'}", f"-isystem{tree / 'portable/GCC/ARM_CM4F'}"]
