"""Compiles many generated protocols into one program, and runs it over streams of all of them."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from tests.conformance.build import BUILD, FLAGS, Result, compiled, read_result, run
from wirebond.generate.code import generate_cpp
from wirebond.generate.code.cpp_names import message_shapes
from wirebond.generate.code.cpp_shape import Shape
from wirebond.generate.code.names import namespace
from wirebond.protocol.model import End, Protocol

SOURCE = Path(__file__).with_name("formats_main.cpp")
# Clang without optimisation is the quickest over this program, by three times.
COMPILE = ("clang++-14", *FLAGS, "-Wconversion", "-Wshadow", "-Wpedantic", "-O0")
SANITIZE = ("-fsanitize=undefined,float-cast-overflow", "-fno-sanitize-recover=all")


@dataclass(frozen=True)
class Chunk:
    time_us: int
    data: bytes


@dataclass(frozen=True)
class Job:
    row: int  # the protocol's place in the list that was built
    sender: End
    chunks: list[Chunk]
    address: int | None = None  # the receiver's own, as bits on the wire; None: the file's default


@dataclass
class Handed:
    """The result of the generated code for a frame of a message."""

    rejected: bool = False
    clamped: bool = False
    wrong_count: bool = False
    values: list[str] | None = None  # handed over: numbers in wire order, `#n` before what varies in number
    again: bytes | None = None  # handed over: the frame that encode gives for them; None: refused
    with_header: bytes | None = None  # the same with the received header; None: refused, or there is none


@dataclass
class Answer:
    deframed: Result
    handed: dict[int, Handed] = field(default_factory=dict)  # by the frame's place in ``deframed``
    addressees: list[int] = field(default_factory=list)  # of each frame, where frames name their receiver


@dataclass
class Answers:
    jobs: list[Answer]
    defaults: dict[tuple[int, int], bytes | None]  # by row and message: the frame of a struct as it was made


def build_formats(
    protocols: list[Protocol], folded: Collection[int], build: Path = BUILD, *, sanitize: bool = False
) -> Path:
    """The program for these protocols, whose names differ; those of ``folded``, by their place, have a deframer and an
    encoder of their own, as firmware has. ``sanitize``: undefined behaviour ends the program. AssertionError with the
    compiler's words when it does not compile.
    """
    build.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=build) as name:
        folder = Path(name)
        headers = {path for protocol in protocols for path in generate_cpp(protocol, folder)}
        rows = folder / "formats.hpp"
        rows.write_text("\n".join(_rows(protocols, folded)), encoding="utf-8")
        command = [*COMPILE, *(SANITIZE if sanitize else ())]
        return compiled(f"formats_{protocols[0].name}", SOURCE, command, [*headers, rows], build)


def decode_all(program: Path, jobs: list[Job], folder: Path) -> Answers:
    """Run a program of ``build_formats``. AssertionError with its words when it fails."""
    file = folder / "jobs.bin"
    with file.open("wb") as out:
        for job in jobs:
            address = (job.address is not None, job.address or 0)
            out.write(struct.pack("<IIIQI", job.row, job.sender == End.MCU, *address, len(job.chunks)))
            for chunk in job.chunks:
                out.write(struct.pack("<QI", chunk.time_us, len(chunk.data)) + chunk.data)
    return _read(run([str(program), str(file)]).splitlines())


def _read(lines: list[str]) -> Answers:
    found: list[list[str]] = []
    defaults: dict[tuple[int, int], bytes | None] = {}
    for line in lines:
        word, *values = line.split()
        if word == "job":
            found.append([])
        elif word == "default":
            defaults[int(values[0]), int(values[1])] = _frame(values[2])
        else:
            found[-1].append(line)
    return Answers([_read_job(job) for job in found], defaults)


def _frame(text: str) -> bytes | None:
    return None if text == "refused" else bytes.fromhex(text)


def _read_job(lines: list[str]) -> Answer:
    deframed, handed, addressees = [], {}, []
    place, current = -1, Handed()
    for line in lines:
        word, *values = line.split()
        if word == "values":
            current.values = values
        elif word == "again":
            current.again = _frame(values[0])
        elif word == "addressee":
            addressees.append(int(values[0]))
        elif word == "with_header":
            current.with_header = _frame(values[0])
        elif word == "rules":
            current.rejected, current.clamped, current.wrong_count = (value != "0" for value in values)
            handed[place] = current
            current = Handed()
        else:
            place += word == "frame"
            deframed.append(line)
    return Answer(read_result(deframed), handed, addressees)


# ---- formats.hpp


def _rows(protocols: list[Protocol], folded: Collection[int]) -> Iterator[str]:
    yield "#pragma once"
    for protocol in protocols:
        yield f'#include "{protocol.name}.hpp"'
    rows = []
    for index, protocol in enumerate(protocols):
        space, shapes = namespace(protocol.name), message_shapes(protocol)
        yield f"namespace {space} {{"
        yield "using conformance::show;"
        for shape in _structs(shapes.values()):
            shown = [f"show(value.{member.name});" for member in shape.members if member.name]
            yield f"inline void show(const {shape.path}&{' value' if shown else ''}) {{ {' '.join(shown)} }}"
        yield "}"
        is_folded = "true" if index in folded else "false"
        types = [f"{space}::{name}" for name in ("FromHost", "FromMcu", *(shape.path for shape in shapes.values()))]
        rows.append(f"row<{is_folded}, {', '.join(types)}>()")
    yield "namespace conformance {"
    yield f"constexpr std::array<Row, {len(rows)}> rows = {{{{"
    yield ",\n".join(rows)
    yield "}};\n}\n"


def _structs(shapes: Collection[Shape]) -> list[Shape]:
    """These and those within them, each once, the inner ones first."""
    found: dict[str, Shape] = {}

    def visit(shape: Shape) -> None:
        for member in shape.members:
            if member.shape is not None and member.name:
                visit(member.shape)
        found.setdefault(shape.path, shape)

    for shape in shapes:
        visit(shape)
    return list(found.values())
