"""The command that writes code from a protocol file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from wirebond.cli.output import console, plain
from wirebond.codec import load
from wirebond.errors import UsageError, WirebondError
from wirebond.gen import PORTS, generate_c, generate_cpp, generate_python, port_headers, write_files
from wirebond.protocol.model import Protocol

Generator = Callable[[Protocol, Path], list[Path]]

LANGUAGES: dict[str, Generator] = {
    "cpp": generate_cpp,
    "c": generate_c,
    "python": generate_python,
}
AMALGAMATED: dict[str, Generator] = {
    "cpp": partial(generate_cpp, amalgamate=True),
    "c": partial(generate_c, amalgamate=True),
}


def generate(path: Path, language: str, out: Path, amalgamate: bool, ports: Sequence[str]) -> None:
    """Write the files of this language, and the headers of these ports, into ``out``; print their paths."""
    if language not in LANGUAGES:
        raise UsageError(f"--lang is '{language}'; expected {', '.join(LANGUAGES)}")
    if amalgamate and language not in AMALGAMATED:
        raise UsageError(
            f"--amalgamate is for --lang {' and '.join(AMALGAMATED)}; a {language} module is one file anyway"
        )
    for port in ports:
        if port not in PORTS:
            raise UsageError(f"--port is '{port}'; expected {', '.join(PORTS)}")
    if ports and language == "python":
        raise UsageError("--port is for the C++ of a firmware; a Python program opens its port by itself")
    if ports and language == "c":
        raise UsageError("--port is for the C++ of a firmware; in C a port is a table of functions, as docs/c.md shows")
    write = AMALGAMATED[language] if amalgamate else LANGUAGES[language]
    model = load(path).model
    for folder in (out, *out.parents):
        if folder.exists():
            if not folder.is_dir():
                raise UsageError(f"{folder} is a file; --out names a folder")
            break
    if amalgamate and (out / "wirebond").is_dir():
        raise UsageError(
            f"{out} has a generated folder, which cannot be included beside one header that has all; name another --out"
        )
    try:
        files = write(model, out)
        for port in ports:
            files += write_files(out, port_headers(port))
    except OSError as error:
        raise WirebondError(f"cannot write {error.filename or out}: {error.strerror}; name another --out") from error
    for written in files:
        console.print(plain(str(written)), soft_wrap=True)
