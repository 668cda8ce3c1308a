"""``wirebond diff``: compares two files, for a person or as JSON."""

from __future__ import annotations

from pathlib import Path

from wirebond.analysis.check import Places
from wirebond.analysis.diff import Change, compare
from wirebond.cli.commands.diff_view import print_comparison
from wirebond.cli.given_file import is_stdin, load_given
from wirebond.cli.output import write
from wirebond.cli.values import to_json
from wirebond.errors import Problem, ProtocolFileError, UsageError
from wirebond.protocol.hash import protocol_hash
from wirebond.protocol.model import End, Protocol


def diff_files(old_path: Path, new_path: Path, as_json: bool, updated: str | None) -> int:
    """Compare two files. Returns 1 if a change breaks the link, for the end that is updated or for either; otherwise
    0."""
    if updated not in (None, "host", "mcu"):
        raise UsageError(f"--updated is '{updated}'; expected host or mcu")
    ends = (End.HOST, End.MCU) if updated is None else (End(updated),)
    if is_stdin(old_path) and is_stdin(new_path):
        raise UsageError("only one of the two files can come from stdin (-)")
    problems: list[Problem] = []
    models: list[Protocol] = []
    names: list[Path] = []
    for path in (old_path, new_path):
        try:
            codec, name = load_given(path)
            models.append(codec.model)
            names.append(name)
        except ProtocolFileError as error:
            problems += error.problems
    if problems:
        if as_json:
            rows = [vars(problem) for problem in problems]
            write(to_json({"old": str(old_path), "new": str(new_path), "ok": False, "problems": rows}) + "\n")
            return 1
        raise ProtocolFileError(problems)
    old, new = models
    old_path, new_path = names
    found = compare(old, new)
    ok = all(found.works(end) for end in ends)
    places = {False: Places.of_text(new.text), True: Places.of_text(old.text)}
    paths = {False: new_path, True: old_path}

    def rows_of(change: Change) -> dict[str, object]:
        place = places[change.is_gone].at(*change.place)
        return {"file": str(paths[change.is_gone]), "line": place.line, "column": place.column}

    def place_of(change: Change) -> str:
        place = places[change.is_gone].at(*change.place)
        return f"{paths[change.is_gone]}:{place.line}:{place.column}" if place.line else str(paths[change.is_gone])

    if as_json:
        facts = {
            "old": str(old_path),
            "new": str(new_path),
            "ok": ok,
            "hash": {"old": f"{protocol_hash(old):016x}", "new": f"{protocol_hash(new):016x}"},
            "works": {"new_host_with_old_mcu": found.works(End.HOST), "new_mcu_with_old_host": found.works(End.MCU)},
            "changes": [change.as_dict() | rows_of(change) for change in found.changes],
        }
        write(to_json(facts) + "\n")
    else:
        print_comparison(str(old_path), str(new_path), found, place_of)
    return 0 if ok else 1
