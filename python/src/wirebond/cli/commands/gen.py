"""The command that writes code from a protocol file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from wirebond.cli.output import console, errors, fail, plain
from wirebond.codec import load
from wirebond.console.standalone import page_files
from wirebond.errors import UsageError, WirebondError
from wirebond.generate.code import (
    PORTS,
    PORTS_IN_C,
    STARTER_PORTS,
    c_files,
    cpp_files,
    port_files_in_c,
    port_headers,
    python_files,
    ros2_files,
    stale_files,
    starter_path,
    starter_text,
    write_files,
)
from wirebond.generate.code.amalgamate import amalgamated
from wirebond.generate.code.arduino import library_files
from wirebond.generate.code.cpp_field import comment_text
from wirebond.generate.code.current import Staleness
from wirebond.generate.code.folder import core_headers
from wirebond.generate.new.write import write_new
from wirebond.protocol.model import Protocol
from wirebond.whole_file import write_whole

Texts = Callable[[Protocol, Path], dict[str, str]]  # of the files in a folder, by their names

LANGUAGES: dict[str, Texts] = {
    "cpp": lambda protocol, _: cpp_files(protocol),
    "c": lambda protocol, _: c_files(protocol),
    "python": python_files,
    "ros2": lambda protocol, _: ros2_files(protocol),
}
_NO_PORTS = {
    "python": "a Python program opens its port by itself",
    "ros2": "a package of ROS 2 has messages and opens no port",
}
PAGE = "page"  # the console as static files
AMALGAMATED: dict[str, Texts] = {
    "cpp": lambda protocol, _: cpp_files(protocol, amalgamate=True),
    "c": lambda protocol, _: c_files(protocol, amalgamate=True),
}


@dataclass(frozen=True)
class Starter:
    """The options of ``--starter``: a first source file for this UART."""

    uart: str


def generate(
    path: Path,
    language: str,
    out: Path,
    amalgamate: bool,
    ports: Sequence[str],
    only_check: bool,
    starter: Starter | None = None,
) -> int:
    """Write the files of this language, and the files of these ports, into ``out``; print their paths.

    With ``only_check`` nothing is written: files that are not current are named. 1 where there are any, else 0.
    """
    if language == PAGE:
        return _page(path, out, amalgamate or bool(ports) or starter is not None, only_check)
    _validate(language, amalgamate, ports)
    if starter is not None:
        _validate_starter(amalgamate, ports, only_check)
    model = load(path).model
    _validate_folder(out, amalgamate)
    if starter is not None and (existing := starter_path(out, starter.uart, language)).exists():
        raise UsageError(f"{existing} exists already, and is not changed; leave --starter out")
    files = (AMALGAMATED if amalgamate else LANGUAGES)[language](model, out)
    for port in ports:
        files |= _port_files(port, language, amalgamate)
    if "arduino" in ports:
        files |= library_files(model, f"{model.name}.hpp" if amalgamate else f"{model.name}_link.hpp")
    if only_check:
        return _check(out, files, path)
    try:
        written = write_files(out, files)
    except OSError as error:
        raise WirebondError(f"cannot write {error.filename or out}: {error.strerror}; name another --out") from error
    for name in written:
        console.print(plain(str(name)), soft_wrap=True)
    if starter is not None:
        _write_starter(model, out, language, ports[0], starter)
    elif not amalgamate and list(ports) in [[port] for port in STARTER_PORTS]:
        errors.print("Begin with a source file of your own: `--uart USART3 --starter` writes one with empty handlers.")
    return 0


def _page(path: Path, out: Path, has_options: bool, only_check: bool) -> int:
    if has_options:
        raise UsageError("--amalgamate, --port and --starter are for firmware; a page takes none of them")
    files = page_files(load(path))
    if only_check:
        stale = [out / name for name, data in files.items() if not is_same(out / name, data)]
        for one in stale:
            console.print(plain(f"not current: {one}"), soft_wrap=True)
        return 1 if stale else 0
    try:
        for name, data in files.items():
            (out / name).parent.mkdir(parents=True, exist_ok=True)
            write_whole(out / name, data)
            console.print(plain(str(out / name)), soft_wrap=True)
    except OSError as error:
        raise WirebondError(f"cannot write {error.filename or out}: {error.strerror}; name another --out") from error
    return 0


def is_same(path: Path, data: bytes) -> bool:
    """Return whether the file has these bytes."""
    return path.is_file() and path.read_bytes() == data


def _port_files(port: str, language: str, amalgamate: bool) -> dict[str, str]:
    files = port_files_in_c(port) if language == "c" else port_headers(port)
    if not amalgamate:
        return files
    if language != "c":  # a port's headers are side by side as before; the core is in each
        return {name: amalgamated(text, core_headers()) for name, text in files.items()}
    own = {name: text for name, text in files.items() if "/" not in name}
    return {name: amalgamated(text, core_headers() | port_headers(port)) for name, text in own.items()}


def _write_starter(model: Protocol, out: Path, language: str, port: str, starter: Starter) -> None:
    path = starter_path(out, starter.uart, language)
    write_new(path, starter_text(model, starter.uart, language, port))
    console.print(
        plain(f"{path}: yours to complete; its first lines say what to add to CubeMX's files"), soft_wrap=True
    )


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
        raise UsageError(f"--lang is '{language}'; expected {', '.join([*LANGUAGES, PAGE])}")
    if amalgamate and language not in AMALGAMATED:
        raise UsageError(f"--amalgamate is for --lang {' and '.join(AMALGAMATED)}; leave it out for {language}")
    for port in ports:
        if port not in PORTS:
            raise UsageError(f"--port is '{port}'; expected {', '.join(PORTS)}")
    if ports and language in _NO_PORTS:
        raise UsageError(f"--port is for the C++ of a firmware; {_NO_PORTS[language]}")
    for port in ports if language == "c" else ():
        if port not in PORTS_IN_C:
            raise UsageError(
                f"there is no --port {port} in C, only {', '.join(PORTS_IN_C)}; docs/c.md shows the table of functions"
            )


def _validate_starter(amalgamate: bool, ports: Sequence[str], only_check: bool) -> None:
    if len(ports) != 1 or ports[0] not in STARTER_PORTS:
        raise UsageError(f"--starter is for one --port, which is {' or '.join(STARTER_PORTS)}")
    if amalgamate:
        raise UsageError("--starter includes the files of a folder; leave --amalgamate out")
    if only_check:
        raise UsageError("--starter writes a file that is yours from then on, which --check ignores")


def _validate_folder(out: Path, amalgamate: bool) -> None:
    for folder in (out, *out.parents):
        if folder.exists():
            if not folder.is_dir():
                raise UsageError(f"{folder} is a file; --out names a folder")
            break
    if amalgamate and any((out / "wirebond").glob("*.hpp")):  # a port's headers are in folders of their own
        raise UsageError(
            f"{out} has a generated folder, which cannot be included together with a single header; name another --out"
        )
