"""Decoded messages of a recording as files of others: CSV, Parquet, MCAP with JSON."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np

from wirebond.codec import Table
from wirebond.errors import UsageError, WirebondError
from wirebond.protocol.model import Message
from wirebond.protocol.problems import no_message
from wirebond.recording.closing import write_mcap
from wirebond.recording.recording import Recording
from wirebond.recording.whole import whole_file

FORMATS = ("csv", "parquet", "mcap")
_TIMES = ("t", "stamp.t", "stamp.error")  # columns that are not fields; seconds
_ROWS = 65536  # written at a time
Progress = Callable[[int, int], object]


def export(
    recording: Recording,
    to: str,
    folder: Path,
    message: str | None = None,
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> list[Path]:
    """Write a file for each message that occurred; for MCAP one file with a channel for each.

    :param to: one of ``FORMATS``.
    :param folder: is made if need be.
    :param message: only this one; None: all.
    :param force: replace files that exist.
    :param progress: called as ``progress(done, size)``.
    :returns: what was written.
    :raises UsageError: another format; the protocol has no such message; or without ``force`` a file exists. Then
        nothing is written.
    :raises WirebondError: pyarrow is missing.
    :raises OSError: a file cannot be written; those that were written before are whole.
    """
    if to not in FORMATS:
        raise UsageError(f"{to!r} is not a format of `export`; expected {', '.join(FORMATS)}, or ros2")
    names = [m.name for m in recording.codec.model.messages]
    if message is not None and message not in (*names, "unknown"):
        raise UsageError(no_message(recording.codec.name, message, names))
    if to == "parquet":
        _pyarrow()
    folder.mkdir(parents=True, exist_ok=True)
    if to == "mcap":
        out = folder / f"{recording.path.stem}-decoded.mcap"
        _refuse_existing([out], force)
        write_mcap(recording, out, raw=False, message=message, new=not force, progress=progress)
        return [out]
    tables = list(_tables(recording, message))
    _refuse_existing([folder / f"{name}.{to}" for name, _, _ in tables], force)
    total, done = sum(len(table) for _, _, table in tables), 0
    written = []
    for name, of, table in tables:
        out = folder / f"{name}.{to}"
        with whole_file(out, new=not force) as file:
            for rows in _write_csv(file, table) if to == "csv" else _write_parquet(file, table, of):
                done += rows
                if progress is not None:
                    progress(done, total)
        written.append(out)
    return written


def _refuse_existing(files: list[Path], force: bool) -> None:
    existing = [] if force else [str(file) for file in files if os.path.lexists(file)]
    if existing:
        more = f" and {len(existing) - 3} more" if len(existing) > 3 else ""
        raise UsageError(
            f"{', '.join(existing[:3])}{more} exist{'s' if len(existing) == 1 else ''} already; nothing was written. "
            "Name another folder with -o, or replace with --force"
        )


def _tables(recording: Recording, message: str | None) -> Iterator[tuple[str, Message | None, Table]]:
    """Yield file name, message and rows. If both ends sent a message, the end is in the name. None: unknown frames."""
    known = {one.name: one for one in recording.codec.model.messages}
    of = {sender: recording.columns(sender) for sender in ("mcu", "host")}
    for sender, columns in of.items():
        for name, table in columns.items():
            if message in (None, name):
                in_both = all(name in other for other in of.values())
                yield (f"{sender}-{name}" if in_both else name), known.get(name), table


def flat_columns(table: Table) -> dict[str, Any]:
    """Return times and fields; an array of fixed size has a column for each element, lists are JSON."""
    times = {"t": table.t, "stamp.t": table.stamp, "stamp.error": table.stamp_error}  # no field has a dot
    found: dict[str, Any] = {name: column for name, column in times.items() if column is not None}
    for name, column in table.items():
        if isinstance(column, np.ndarray) and column.ndim == 2:
            found |= {f"{name}[{i}]": column[:, i] for i in range(column.shape[1])}
        else:
            found[name] = column
    return found


def _cell(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.hex(" ")
    if isinstance(value, list | dict | tuple):
        return json.dumps(value, default=lambda entry: bytes(entry).hex(" "))
    return value


def csv_of(recording: Recording, message: str, sender: str | None = None) -> Iterator[bytes]:
    """Yield one message as CSV, piece by piece. If both ends sent it: the MCU's, unless ``sender`` says otherwise.

    :raises UsageError: no such sender.
    """
    for end in (sender,) if sender is not None else ("mcu", "host"):
        table = recording.columns(end).tables.get(message)
        if table is not None:
            return _csv_pieces(table)
    return iter((b"",))


def _csv_pieces(table: Table) -> Iterator[bytes]:
    file = io.BytesIO()
    for _ in _write_csv(file, table):
        yield file.getvalue()
        file.seek(0)
        file.truncate()
    yield file.getvalue()


def _write_csv(file: IO[bytes], table: Table) -> Iterator[int]:
    columns = flat_columns(table)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for begin in range(0, len(table), _ROWS):
        end = min(begin + _ROWS, len(table))
        parts = []
        for name, column in columns.items():
            part = column[begin:end]
            if not isinstance(part, np.ndarray):
                part = [_cell(value) for value in part]
            elif name in _TIMES:
                part = ["" if np.isnan(value) else value for value in np.round(part, 6).tolist()]
            else:
                part = part.tolist()
            parts.append(part)
        writer.writerows(zip(*parts, strict=True))
        file.write(text.getvalue().encode())
        text.seek(0)
        text.truncate()
        yield end - begin
    file.write(text.getvalue().encode())


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow  # noqa: PLC0415 an optional dependency
        import pyarrow.parquet  # noqa: PLC0415
    except ImportError:
        raise WirebondError(
            "Parquet needs the package pyarrow, which is not installed; install it with "
            "`pip install 'pyarrow>=17'`, or choose `--to csv`"
        ) from None
    return pyarrow, pyarrow.parquet


def _write_parquet(file: IO[bytes], table: Table, message: Message | None) -> Iterator[int]:
    arrow, parquet = _pyarrow()
    columns = flat_columns(table)
    about = {name: _about(name, message) for name in columns}
    schema, writer = None, None
    for begin in range(0, len(table), _ROWS):
        end = min(begin + _ROWS, len(table))
        arrays = {name: arrow.array(_arrow_values(column[begin:end])) for name, column in columns.items()}
        rows = arrow.table(arrays, schema=schema)
        if writer is None:
            schema = arrow.schema([one.with_metadata(about[one.name]) for one in rows.schema])
            rows = rows.cast(schema)
            writer = parquet.ParquetWriter(file, schema)
        writer.write_table(rows)
        yield end - begin
    if writer is not None:
        writer.close()


def _about(column: str, message: Message | None) -> dict[str, str]:
    """Return the metadata of a column: its unit, and the names of its numbers as JSON."""
    if column in _TIMES:
        return {"unit": "s"}
    field = None if message is None else message.field_at(column)
    if field is None:
        return {}
    names = {"enum": field.enum, "flags": field.flags}
    found = {key: json.dumps({str(number): name for name, number in pairs}) for key, pairs in names.items() if pairs}
    return {**({"unit": field.unit} if field.unit else {}), **found}


def _arrow_values(column: Any) -> Any:
    """Keep texts and bytes; write lists and structs as JSON, always, so that each part of a column has one type."""
    if isinstance(column, np.ndarray):
        return column
    return [value if isinstance(value, str | bytes) else _cell(value) for value in column]
