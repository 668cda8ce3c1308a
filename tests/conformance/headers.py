"""Compiles a program that sends and receives a protocol's frames with header values, and runs it."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

from tests.conformance.build import BUILD, FLAGS, compiled
from wirebond.generate.code import generate_cpp
from wirebond.generate.code.cpp_names import struct_names
from wirebond.generate.code.names import namespace
from wirebond.protocol.model import End, Protocol

SOURCE = Path(__file__).with_name("headers_main.cpp")
COMPILE = ("clang++-14", *FLAGS, "-O0", "-fsanitize=undefined", "-fno-sanitize-recover=all")


def build_headers(protocol: Protocol, sender: End, build: Path = BUILD) -> Path:
    """The program for frames of ``sender``. AssertionError with the compiler's words when it does not compile."""
    build.mkdir(parents=True, exist_ok=True)
    definitions = (
        f'-DPROTOCOL_HEADER="{protocol.name}.hpp"',
        f"-DPROTOCOL={namespace(protocol.name)}",
        f"-DSENDER={'FromMcu' if sender == End.MCU else 'FromHost'}",
    )
    with tempfile.TemporaryDirectory(dir=build) as name:
        folder = Path(name)
        headers = generate_cpp(protocol, folder)
        rows = folder / "header_rows.hpp"
        rows.write_text(_rows(protocol, sender), encoding="utf-8")
        command = [*COMPILE, *definitions]
        return compiled(f"{protocol.name}_{sender.value}_headers", SOURCE, command, [*headers, rows], build)


def answers(program: Path, requests: list[tuple[int, list[int]]]) -> list[tuple[bytes | None, list[int] | None]]:
    """For each message index and its header's wire numbers: the frame, None where it is refused; and the numbers that a
    handler found in it, None where it got nothing."""
    lines = [" ".join(map(str, [index, *numbers])) for index, numbers in requests]
    done = subprocess.run(
        [str(program)], input="\n".join([*lines, ""]), capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    told = iter(done.stdout.splitlines())
    found: list[tuple[bytes | None, list[int] | None]] = []
    for line in told:
        if line == "refused":
            found.append((None, None))
            continue
        word, *numbers = next(told).split()
        assert word in ("header", "none"), f"{line}: {word}"
        found.append((bytes.fromhex(line.removeprefix("frame ")), [int(n) for n in numbers] if numbers else None))
    assert len(found) == len(requests)
    return found


def _rows(protocol: Protocol, sender: End) -> str:
    structs = struct_names(protocol)
    cases = [
        f"    case {index}: return encoded<{namespace(protocol.name)}::{structs[message.name]}>(header);"
        for index, message in enumerate(protocol.messages)
        if message.sent_by(sender)
    ]
    head = "Frame encoded(int index, const Header& header) {\n  switch (index) {"
    return "\n".join([head, *cases, "    default: return {};", "  }", "}", ""])
