"""Writing generated files: templates to text, text to files, and the core headers that go with it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import jinja2

from wirebond.generate.code.names import code_name, identifier
from wirebond.generate.templates import environment
from wirebond.paths import core_include, port_in_c, port_include
from wirebond.whole_file import write_whole

# The ports that a firmware may be given. `fake` is for tests.
PORTS = ("arduino", "bare_metal", "freertos", "gd32_spl", "posix", "stm32_hal", "stm32_ll", "usb_cdc")
PORTS_IN_C = ("stm32_hal", "stm32_ll")
_OF_VENDOR = {"stm32_hal": "stm32", "stm32_ll": "stm32"}  # common to all ports of a vendor, in a folder like theirs
TEMPLATES = Path(__file__).parent / "templates"


@cache
def _environment() -> jinja2.Environment:
    """Return the common environment, which keeps compiled templates."""
    found = environment(TEMPLATES)
    found.filters |= {"code_name": code_name, "identifier": identifier}
    return found


def render(template: str, **values: object) -> str:
    return _environment().get_template(template).render(**values)


def core_headers() -> dict[str, str]:
    """Return the text of each core header that generated code may need, by the name under which it is included.

    Host headers are left out: a firmware has no use for them.
    """
    headers = _headers(core_include())
    return {name: text for name, text in headers.items() if not name.startswith("wirebond/host/")}


def port_headers(port: str) -> dict[str, str]:
    """Return the text of each header of a port, by the name under which it is included. They need those of the core
    alone."""
    return {name: text for folder in _folders(port) for name, text in _headers(folder).items()}


def port_files_in_c(port: str) -> dict[str, str]:
    """Return the text of each file of a port in C, by its name in the folder: a source, its header, and what they
    include."""
    headers = {name: text for folder in _folders(port) for name, text in _texts(folder, "*.h").items()}
    return headers | _texts(port_in_c(port), "*.h", "*.c")


def _folders(port: str) -> list[Path]:
    return [port_include(name) for name in (_OF_VENDOR.get(port), port) if name is not None]


def _headers(folder: Path) -> dict[str, str]:
    return _texts(folder, "*.hpp", "*.h")


def _texts(folder: Path, *patterns: str) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8")
        for pattern in patterns
        for path in folder.rglob(pattern)
    }


def write_files(out: Path, files: Mapping[str, str]) -> list[Path]:
    """Write each text under its name in ``out``; return their paths, sorted.

    A file that already holds its text is not touched, so that a build after it has nothing to do. ``OSError`` when one
    cannot be written.
    """
    for name, text in files.items():
        _write_if_changed(out / name, text)
    return sorted(out / name for name in files)


def _write_if_changed(path: Path, text: str) -> None:
    content = text.encode("utf-8")
    if path.is_file() and path.read_bytes() == content:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, content, lasting=False)  # it can be generated again
