"""Compiles the conformance decoder for a protocol, once for each content, and runs it."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from tests import compilers
from wirebond.generate.code import generate_cpp
from wirebond.generate.code.names import namespace
from wirebond.paths import core_include
from wirebond.protocol.model import End, Protocol
from wirebond.protocol.plan import MatchTest
from wirebond.protocol.planning import plan_for

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "conformance"
SOURCE = Path(__file__).with_name("decode_main.cpp")
SHARED = Path(__file__).with_name("print.hpp")
HOST_HEADERS = sorted((core_include() / "wirebond" / "host").glob("*.hpp"))  # generated folders have none
FLAGS = ("-std=c++17", "-Wall", "-Wextra", "-Werror")
# Without optimisation: the compiler would spend minutes on the sanitizers' checks.
SANITIZE = ("-O0", *compilers.SANITIZE)
OPTIMISE = ("-O2",)
QUICK = ("-O0",)  # to compile


def build_decoder(
    protocol: Protocol,
    sender: End,
    *,
    run_time: bool = False,
    optimise: bool = False,
    sanitize: bool = False,
    build: Path = BUILD,
) -> Path:
    """The program that decodes what ``sender`` sends: with the constant source, or with the run-time source.

    It is compiled only if no program of the same sources, flags and compiler lies in ``build``. Several processes may
    ask for the same program at once. AssertionError with the compiler's words when it does not compile.
    """
    definitions = (
        f'-DPROTOCOL_HEADER="{protocol.name}.hpp"',
        f"-DPROTOCOL={namespace(protocol.name)}",
        f"-DSENDER={'FromMcu' if sender == End.MCU else 'FromHost'}",
        f"-DRUN_TIME={int(run_time)}",
    )
    level = SANITIZE if sanitize else OPTIMISE if optimise else QUICK
    flags = (*FLAGS, *level, *definitions)
    kind = f"{'run_time' if run_time else 'constant'}{'_sanitized' if sanitize else ''}"
    build.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=build) as name:
        folder = Path(name)
        headers = generate_cpp(protocol, folder)
        rows = folder / "message_rows.hpp"
        rows.write_text(_rows(protocol, sender), encoding="utf-8")
        command = [os.environ.get("CXX", compilers.CXX), *flags]
        return compiled(f"{protocol.name}_{sender.value}_{kind}", SOURCE, command, [*headers, rows], build)


def compiled(name: str, source: Path, command: list[str], headers: list[Path], build: Path) -> Path:
    """The program of one source file and these headers, which lie in one folder and below it, in ``build``.

    ``command``: the compiler and its flags.
    """
    folder = Path(os.path.commonpath(headers))
    version = run([command[0], "--version"])
    content = hashlib.sha256("\0".join([version, *command]).encode())
    for path in [*sorted(headers), *HOST_HEADERS, SHARED, source]:
        content.update(path.name.encode() + b"\0" + path.read_bytes())
    program = build / f"{name}_{content.hexdigest()[:16]}"
    if not program.exists():
        made = folder / "made"
        run([*command, f"-I{folder}", f"-I{core_include()}", f"-I{SHARED.parent}", str(source), "-o", str(made)])
        shutil.move(made, program)  # a rename within one file system: others see all of it or nothing
    return program


@dataclass(frozen=True)
class Frame:
    offset: int
    wire: bytes
    id: int
    message: int  # index into Protocol.messages; -1: unknown


@dataclass(frozen=True)
class Result:
    frames: list[Frame]
    account: dict[str, int]  # bytes, frames, …, discarded.<cause>, rejected.<cause>


def decode(program: Path, stream: Path, chunk: int, seed: int = 1, expected: int = -1) -> Result:
    """Run a program of ``build_decoder`` over a file. AssertionError with its words when it fails. ``expected``: index
    of the reply that was asked for."""
    return read_result(run([str(program), str(stream), str(chunk), str(seed), str(expected)]).splitlines())


def read_result(lines: Iterable[str]) -> Result:
    """The lines of print.hpp."""
    result = Result([], {})
    for line in lines:
        word, *values = line.split()
        if word == "frame":
            offset, wire, message_id, index = values
            result.frames.append(Frame(int(offset), bytes.fromhex(wire), int(message_id), int(index)))
        else:
            result.account[word] = int(values[0])
    return result


def _rows(protocol: Protocol, sender: End) -> str:
    plan = plan_for(protocol, sender)
    rows = plan.messages
    flag = {False: "false", True: "true"}
    tests, lines = [], []
    for r in rows:
        begin = f"{r.id}U, {{{r.index}, {r.min_payload}, {r.max_payload}, {r.seed}}}, {flag[r.only_expected]}"
        if r.tests:
            tests.append(
                f"inline constexpr wirebond::MatchTest tests_{r.index}[] = {{{', '.join(map(_test, r.tests))}}};"
            )
            begin += f", {{}}, {{tests_{r.index}, {len(r.tests)}}}"
        lines.append(f"    {{{begin}}},")
    return "\n".join(
        [
            "#pragma once",
            "#include <array>",
            '#include "wirebond/host/runtime_source.hpp"',
            f"inline constexpr bool matches = {flag[plan.matches]};",
            f"inline constexpr bool matches_late = {flag[plan.matches_late]};",
            *tests,
            f"inline constexpr std::array<wirebond::MessageRow, {len(rows)}> message_rows = {{{{",
            *lines,
            "}};",
            "",
        ]
    )


def _test(test: MatchTest) -> str:
    flags = f"{str(test.or_next).lower()}, {str(test.is_one).lower()}"
    number = f"{test.bytes}, wirebond::ByteOrder::{test.order}, {test.shift}, {test.at}"
    return f"{{wirebond::MatchOf::{test.of}, {test.place}, {flags}, {number}, {test.mask}U, {test.low}U, {test.high}U}}"


def run(command: list[str]) -> str:
    """Return the output of a program. AssertionError with its messages if it fails."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}\nends with {done.returncode}\n{done.stderr}"
    return done.stdout
