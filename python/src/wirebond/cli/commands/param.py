"""``wirebond param``: the MCU's parameters listed, read, set, saved to a file and loaded from one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from wirebond.cli.output import console, errors, fail, plain, warn, write
from wirebond.cli.values import parse_header, to_json
from wirebond.codec import load
from wirebond.errors import ParameterError, UsageError, WirebondError
from wirebond.link import open_link
from wirebond.link.parameters import DEFAULT_TIMEOUT, Parameters, Progress
from wirebond.visible import visible


@dataclass(frozen=True)
class Access:
    """Access to the parameters, shared by all of these commands."""

    path: Path
    port: str
    baud: int | None
    timeout: float | None
    header_words: list[str]
    as_json: bool

    @contextmanager
    def opened(self) -> Iterator[tuple[Parameters, float]]:
        """Yield the parameters, and the seconds for each answer."""
        codec = load(self.path)
        header = parse_header(codec.model, self.header_words)
        timeout = DEFAULT_TIMEOUT if self.timeout is None else self.timeout
        if not 0 < timeout <= 60:
            raise UsageError(f"--timeout is {timeout:g}; expected more than 0 and at most 60 seconds")
        if codec.model.service("parameter") is None:
            raise UsageError(f"{codec.name} maps no `parameter` service; see `services` in its file")
        with open_link(codec, self.port, self.baud, clock_sync=False) as link:
            yield link.parameters.at(header) if header else link.parameters, timeout
            if link.peer.state == "different":
                warn(link.peer.why)

    def show(self, values: Mapping[str, float]) -> None:
        """Print names and values."""
        if self.as_json:
            write(to_json(dict(values)) + "\n")
            return
        table = Table(box=None, pad_edge=False, show_header=False)
        for name, value in values.items():
            table.add_row(escape(visible(name)), repr(value).removesuffix(".0"))
        if values:
            console.print(table)


def list_parameters(access: Access) -> int:
    with access.opened() as (parameters, timeout), _progress("reading") as progress:
        found = parameters.list(progress, timeout=timeout)
    access.show(found)
    if not found:
        fail("the MCU has no parameters")
        return 1
    return 0


def get_parameters(access: Access, names: list[str]) -> int:
    with access.opened() as (parameters, timeout):
        found, refused = _each(names, lambda name: parameters.get(name, timeout=timeout))
    access.show(found)
    return _tell(refused)


def set_parameters(access: Access, words: list[str]) -> int:
    wanted: dict[str, float] = {}
    for word in words:
        name, equals, text = word.partition("=")
        if not equals or not name:
            raise UsageError(f"'{word}' is not an assignment; write NAME=VALUE, such as 0=1.5")
        if name in wanted:
            raise UsageError(f"{name} is given twice")
        wanted[name] = _number(name, text)
    with access.opened() as (parameters, timeout):
        found = parameters.set_all(wanted, timeout=timeout)
    access.show(found)
    return 0


def save_parameters(access: Access, out: Path) -> int:
    with access.opened() as (parameters, timeout), _progress("reading") as progress:
        found = parameters.save(out, progress, timeout=timeout)
    errors.print(f"{plain(str(out))} has {len(found)} parameters")
    return 0


def load_parameters(access: Access, source: Path) -> int:
    with access.opened() as (parameters, timeout), _progress("setting") as progress:
        found = parameters.load(source, progress, timeout=timeout)
    access.show(found)
    return 0


# ---- parts of them


def _each(names: list[str], act: Callable[[str], float]) -> tuple[dict[str, float], list[WirebondError]]:
    """Apply an action to each name and collect the results; a refusal does not stop the others."""
    found: dict[str, float] = {}
    refused: list[WirebondError] = []
    for name in names:
        try:
            found[name] = act(name)
        except (ParameterError, ValueError) as error:
            if not isinstance(error, WirebondError) or isinstance(error, UsageError):
                raise
            refused.append(error)
    return found, refused


def _tell(refused: list[WirebondError]) -> int:
    for error in refused:
        fail(str(error))
    return 1 if refused else 0


def _number(name: str, text: str) -> float:
    try:
        if "_" in text or not text.isascii():
            raise ValueError(text)
        return int(text, 0)
    except ValueError:
        pass
    try:
        return float(text.replace("_", "x"))
    except ValueError:
        raise UsageError(f"{name} is '{text}'; expected a number, such as 1.5") from None


@contextmanager
def _progress(what: str) -> Iterator[Progress]:
    """Show a line in the terminal while it lasts."""
    with errors.status(f"{what} parameters") as status:

        def progress(done: int, all_of_them: int) -> Any:
            status.update(f"{what} parameters: {done}{f' of {all_of_them}' if all_of_them else ''}")

        yield progress
