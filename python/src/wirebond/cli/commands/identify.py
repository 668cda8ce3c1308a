"""``wirebond identify`` on bytes: where they come from, and the exit code."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from wirebond.analysis.identify.formats import Known, known_formats
from wirebond.analysis.identify.ranking import rank
from wirebond.cli.commands.identify_view import show, show_json
from wirebond.cli.given_bytes import given_bytes
from wirebond.cli.output import errors, plain


def identify_bytes(source: str | None, hex_text: str | None, also: Sequence[Path], as_json: bool) -> int:
    """Exit code 1 where no known format fits."""
    data = given_bytes(source, hex_text)
    known = formats_with(also)
    candidates = rank(data, known.formats)
    (show_json if as_json else show)(candidates, data, known)
    return 0 if candidates and candidates[0].fits else 1


def formats_with(also: Sequence[Path]) -> Known:
    """Return the formats to try; files that cannot be used are named on stderr."""
    known = known_formats(also)
    for path, reason in known.unreadable.items():
        errors.print(f"{plain(str(path))} is left out: {plain(reason.splitlines()[0])}")
    return known
