"""Compiles the C++ targets, once for each content, and says what of the core their inputs reach."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path

from tests.fuzz import emit
from tests.fuzz.files import BUILD, HERE
from tests.shared import ROOT

COMPILER = "clang++-14"
CORE = ROOT / "core" / "include"
# Functions that are inlined by force make builds with sanitizers three times as long.
FLAGS = ("-std=c++17", "-Wall", "-Wextra", "-Werror", "-O1", "-DWIREBOND_INLINE=inline", "-DWIREBOND_INLINE_LAMBDA=")
FUZZ = ("-g1", "-fsanitize=fuzzer,address,undefined", "-fno-sanitize-recover=all")
COVERAGE = ("-fsanitize=fuzzer", "-fprofile-instr-generate", "-fcoverage-mapping")


def build_target(name: str, *, core: Path = CORE, coverage: bool = False) -> Path:
    """The program of ``<name>_target.cpp`` over the headers in ``core``.

    It is compiled only if no program of the same sources and flags lies in the build folder. Several processes may ask
    for the same program at once. AssertionError with the compiler's words when it does not compile.
    """
    BUILD.mkdir(parents=True, exist_ok=True)
    flags = (*FLAGS, *(COVERAGE if coverage else FUZZ))
    with tempfile.TemporaryDirectory(dir=BUILD) as temporary:
        folder = Path(temporary)
        sources = emit.write_sources(name, folder)
        content = hashlib.sha256("\0".join(flags).encode())
        for path in sorted([*core.rglob("*.hpp"), *HERE.glob("*.[ch]pp"), *folder.rglob("*.[ch]pp")]):
            content.update(path.name.encode() + b"\0" + path.read_bytes())
        program = BUILD / f"{name}{'_coverage' if coverage else ''}_{content.hexdigest()[:16]}"
        if program.exists():
            return program
        includes = [f"-I{path}" for path in (core, HERE, folder)]
        objects = []
        for source in sources:  # data: neither slowed nor observed
            objects.append(str(source.with_suffix(".o")))
            run([COMPILER, "-std=c++17", "-O0", *includes, "-c", str(source), "-o", objects[-1]])
        made = folder / name
        run([COMPILER, *flags, *includes, str(HERE / f"{name}_target.cpp"), *objects, "-o", str(made)])
        shutil.move(made, program)  # a rename within one file system: others see all of it or nothing
    return program


def core_coverage(name: str, corpora: Iterable[Path]) -> tuple[int, int]:
    """Lines of the core's and the generated headers that the inputs run, and lines that the target has compiled."""
    program = build_target(name, coverage=True)
    with tempfile.TemporaryDirectory(dir=BUILD) as temporary:
        raw, merged = Path(temporary) / "raw", Path(temporary) / "merged"
        environment = os.environ | {"LLVM_PROFILE_FILE": str(raw)}
        run([str(program), "-runs=0", *map(str, corpora)], environment)
        run(["llvm-profdata-14", "merge", "-sparse", str(raw), "-o", str(merged)])
        report = run(["llvm-cov-14", "export", "-summary-only", f"-instr-profile={merged}", str(program)])
    files = json.loads(report)["data"][0]["files"]
    counted = (f for f in files if any(Path(f["filename"]).is_relative_to(folder) for folder in (CORE, BUILD)))
    lines = [f["summary"]["lines"] for f in counted if not f["filename"].endswith("/messages.hpp")]
    return sum(one["covered"] for one in lines), sum(one["count"] for one in lines)


def run(command: list[str], environment: dict[str, str] | None = None) -> str:
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, errors="replace")
    assert done.returncode == 0, f"{' '.join(command)}\nends with {done.returncode}\n{done.stderr[-4000:]}"
    return done.stdout
