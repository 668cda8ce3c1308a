"""The command that writes code from a protocol file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from wirebond.cli.output import console, fail, plain
from wirebond.codec import load
from wirebond.errors import UsageError, WirebondError
from wirebond.gen import PORTS, c_files, cpp_files, port_headers, python_files, stale_files, write_files
from wirebond.gen.cpp_field import comment_text
from wirebond.gen.current import Staleness
from wirebond.protocol.model import Protocol

Texts = Callable[[Protocol, Path], dict[str, str]]  # of the files in a folder, by their names

LANGUAGES: dict[str, Texts] = {
    "cpp": lambda protocol, _: cpp_files(protocol),
    "c": lambda protocol, _: c_files(protocol),
    "python": python_files,
}
AMALGAMATED: dict[str, Texts] = {
    "cpp": lambda protocol, _: cpp_files(protocol, amalgamate=True),
    "c": lambda protocol, _: c_files(protocol, amalgamate=True),
}


def generate(path: Path, language: str, out: Path, amalgamate: bool, ports: Sequence[str], only_check: bool) -> int:
    """Write the files of this language, and the headers of these ports, into ``out``; print their paths.

    With ``only_check`` nothing is written: files that are not current are named. 1 where there are any, else 0.
    """
    _validate(language, amalgamate, ports)
    model = load(path).model
    _validate_folder(out, amalgamate)
    files = (AMALGAMATED if amalgamate else LANGUAGES)[language](model, out)
    for port in ports:
        files |= port_headers(port)
    if only_check:
        return _check(out, files, path)
    try:
        written = write_files(out, files)
    except OSError as error:
        raise WirebondError(f"cannot write {error.filename or out}: {error.strerror}; name another --out") from error
    for name in written:
        console.print(plain(str(name)), soft_wrap=True)
    return 0


def _check(out: Path, files: dict[str, str], path: Path) -> int:
    stale = stale_files(out, files, comment_text(path.name))
    for one in stale:
        console.print(plain(f"{one.how}: {one.path}"), soft_wrap=True)
    if not stale:
        console.print(plain(f"{out}: {len(files)} generated {'file is' if len(files) == 1 else 'files are'} current"))
        return 0
    advice = "run the command without --check"
    if any(one.how == Staleness.SUPERFLUOUS for one in stale):
        advice += ", and remove the superfluous files"
    fail(f"{out} is not current; {advice}")
    return 1


def _validate(language: str, amalgamate: bool, ports: Sequence[str]) -> None:
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


def _validate_folder(out: Path, amalgamate: bool) -> None:
    for folder in (out, *out.parents):
        if folder.exists():
            if not folder.is_dir():
                raise UsageError(f"{folder} is a file; --out names a folder")
            break
    if amalgamate and any((out / "wirebond").glob("*.hpp")):  # a port's headers lie in folders of their own
        raise UsageError(
            f"{out} has a generated folder, which cannot be included beside one header that has all; name another --out"
        )
