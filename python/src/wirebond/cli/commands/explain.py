"""Shows an explanation: a table of bytes and names for each stretch, in colour on a terminal, or as JSON."""

from __future__ import annotations

import io
from pathlib import Path

from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from wirebond import paths
from wirebond.analysis.explain import Applied, Explanation, FittingGuess, Kind, Row, State, Stretch, explain
from wirebond.analysis.explain.data import explanation_dict
from wirebond.analysis.explain.explanation import most_bytes
from wirebond.analysis.explain.window import first_refused
from wirebond.cli.given_bytes import given_bytes
from wirebond.cli.output import console, errors, write
from wirebond.cli.values import hex_of, to_json
from wirebond.codec import Codec, load
from wirebond.errors import ProtocolFileError, UsageError
from wirebond.protocol import load as load_model
from wirebond.protocol.model import Protocol

_MOST_PEERS = 40  # files beside the protocol file that are compared with
_COLOURS = {State.GOOD: "green", State.WRONG: "bold red", State.NAMED: ""}
_TITLES = {Kind.FRAME: "frame", Kind.REFUSED: "refused", Kind.NOISE: "noise", Kind.FILL: "fill"}
_TITLE_COLOURS = {Kind.FRAME: "bold green", Kind.REFUSED: "bold red", Kind.NOISE: "bold yellow", Kind.FILL: "dim"}
_PLAIN_WIDTH = 120
_ROW_BYTES = 16  # of hex in a line
_MOST_COUNTED = 1_000_000  # guesses that are tried one by one; more are those that equations rule out at once


def explain_bytes(path: Path, source: str | None, hex_text: str | None, sender: str | None, as_json: bool) -> int:
    """Exit code 1 where bytes were given and not all of them belong to frames."""
    codec = load(path)
    data = given_bytes(source, hex_text, sender)
    if not data:
        raise UsageError('there are no bytes to explain; give some, such as "AA 55 01"')
    data = _most_telling(codec, data, sender)
    explanation = explain(codec.model, data, codec.tables.sender_for(sender), _peers(path, codec.model))
    if as_json:
        write(to_json(explanation_dict(explanation)) + "\n")
    else:
        _show([*map(_stretch, explanation.stretches), _summary(explanation, len(data)), *_together(explanation)])
    return 0 if all(stretch.kind in (Kind.FRAME, Kind.FILL) for stretch in explanation.stretches) else 1


def _most_telling(codec: Codec, data: bytes, sender: str | None) -> bytes:
    """Select as many bytes as can be explained at once: those around the first refused ones."""
    most = most_bytes(codec.model)
    if len(data) <= most:
        return data
    begin = first_refused(codec, data, sender, most)
    part = data[begin : begin + most]
    errors.print(
        f"{len(data)} bytes are too many to explain at once: these are {len(part)} from byte {begin} on"
        + (", the frame before the first refused ones" if begin else "")
    )
    return part


def _peers(path: Path, own: Protocol) -> list[Protocol]:
    """Return the protocols beside this file, and those that come with the package."""
    folders = (path.parent, paths.protocols())
    files = {file.resolve() for folder in folders for file in folder.glob("*.yaml") if file.is_file()}
    files.discard(path.resolve())
    found = []
    for file in sorted(files)[:_MOST_PEERS]:
        try:
            peer = load_model(file)
        except ProtocolFileError:
            continue  # not what the user asked for
        if peer != own:
            found.append(peer)
    return found


# ---- for a person ----


def _show(blocks: list[RenderableType]) -> None:
    """Print: unchanged in a terminal; otherwise plain, of a fixed width and without blanks at the ends of lines."""
    if console.is_terminal:
        for block in blocks:
            console.print(block)
        return
    plain = Console(file=io.StringIO(), width=_PLAIN_WIDTH, highlight=False, color_system=None)
    with plain.capture() as capture:
        for block in blocks:
            plain.print(block)
    write("".join(line.rstrip() + "\n" for line in capture.get().splitlines()))


def _stretch(stretch: Stretch) -> RenderableType:
    size = len(stretch.wire)
    title = Text()
    title.append(_TITLES[stretch.kind], _TITLE_COLOURS[stretch.kind])
    title.append(f"  offset {stretch.offset}, {size} byte{'s' * (size != 1)}")
    title.append(f"  {stretch.cause}" if stretch.cause else "", "red")
    lines: list[RenderableType] = [title, Padding(Text(stretch.summary), (0, 0, 0, 2))]
    if stretch.kind == Kind.FILL:
        return Group(title, Text())
    if stretch.rows:
        lines.append(Padding(_rows(stretch.rows), (1, 0, 0, 2)))
    if stretch.kind == Kind.REFUSED and stretch.rules:
        lines.append(Padding(_rules(stretch.rules), (1, 0, 0, 2)))
    notes = _notes(stretch)
    if notes:
        lines.append(Padding(Group(*notes), (1, 0, 0, 2)))
    return Group(*lines, Text())


def _rows(rows: tuple[Row, ...]) -> Table:
    stuffed = any(row.wire != row.data for row in rows if row.data)
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("at", justify="right")
    table.add_column("on the wire" if stuffed else "bytes")
    if stuffed:
        table.add_column("unstuffed")
    table.add_column("part")
    table.add_column("meaning", overflow="fold")
    for row in rows:
        colour = _COLOURS[row.state]
        indent = "  " * row.level
        cells = [Text(str(row.offset), "dim"), Text(_hex_lines(row.wire, indent), colour or "cyan")]
        if stuffed:
            cells.append(Text(_hex_lines(row.data, indent), colour or "cyan"))
        cells += [Text(indent + row.name, colour), Text(row.meaning, colour if row.state == State.WRONG else "")]
        table.add_row(*cells)
    return table


def _hex_lines(data: bytes, indent: str) -> str:
    chunks = [data[at : at + _ROW_BYTES] for at in range(0, len(data), _ROW_BYTES)]
    return "\n".join(indent + hex_of(chunk) for chunk in chunks)


def _rules(rules: tuple[Applied, ...]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for title in ("rule", "expected", "found", ""):
        table.add_column(title, overflow="fold")
    for rule in rules:
        colour = _COLOURS[State.GOOD if rule.holds else State.WRONG]
        answer = "holds" if rule.holds else "fails"
        table.add_row(rule.rule, rule.expected, Text(rule.found, colour), Text(answer, colour))
    return table


def _notes(stretch: Stretch) -> list[Text]:
    notes = [Text(f"field rule broken: {fault}", "yellow") for fault in stretch.faults]
    if stretch.repaired:
        notes.append(Text(f"If the file is right: {stretch.repaired}."))
    for guess in stretch.guesses:
        notes.append(_guess(guess, said=stretch.repaired))
    if stretch.kind in (Kind.REFUSED, Kind.NOISE) and not stretch.guesses and stretch.tried:
        tried = f"None of {stretch.tried} guesses at the file and the bytes explains it better."
        notes.append(Text(tried, "dim"))
    if not stretch.searched_all:
        notes.append(Text("Not every guess was tried: give fewer bytes to have all tried.", "dim"))
    return notes


def _guess(guess: FittingGuess, said: str) -> Text:
    text = Text()
    text.append("Nearest: ", "bold yellow")
    text.append(guess.what)
    if guess.remedy:
        text.append(f"\n  {guess.remedy}", "cyan")
    if guess.reading and not said.endswith(guess.reading):
        text.append(f"\n  The bytes then say {guess.reading}.")
    text.append(f"\n  {_likelihood(guess)}" if guess.chance is not None else "", "dim")
    return text


def _likelihood(guess: FittingGuess) -> str:
    assert guess.chance is not None
    others = f"; {guess.others} more of them fit{'s' * (guess.others == 1)}" if guess.others else ""
    if guess.tried > _MOST_COUNTED:
        guesses = f"determined by the frames, of about 2^{guess.tried.bit_length() - 1} possible ones"
    else:
        guesses = f"{guess.tried} guess{'es' * (guess.tried != 1)} of this kind tried{others}"
    if guess.of > 1:
        guesses += f"; it makes {guess.fits} frame{'s' * (guess.fits > 1)} of {guess.of} refused ones"
    if guess.chance < 1e-6:
        return f"{guesses}; that it fits by chance can be ruled out."
    return f"{guesses}; by chance one fits in 1 of {max(1, round(1 / guess.chance)):,} cases.".replace(",", " ")


def _summary(explanation: Explanation, size: int) -> str:
    frames = explanation.frames
    parts = [f"{size} bytes: {len(frames)} frame{'s' * (len(frames) != 1)}"]
    parts += [f"{count} discarded as {cause}" for cause, count in explanation.discarded_bytes.items()]
    return ", ".join(parts)


def _together(explanation: Explanation) -> list[Text]:
    """Describe the change that makes frames of several refused blocks, once for all of them."""
    return [
        Text(f"{guess.fits} of {guess.of} refused frames together: {guess.remedy or guess.what}", "cyan")
        for guess in explanation.together[:1]
    ]
