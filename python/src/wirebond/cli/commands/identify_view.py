"""Shows the result of ``wirebond identify``: the formats that fit, best first, with their evidence; or what to try."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wirebond.analysis.identify.formats import Known
from wirebond.analysis.identify.ranking import Candidate
from wirebond.analysis.infer import Inference
from wirebond.analysis.infer.unfitting import FEW_BYTES, look_at_unfitting
from wirebond.cli.output import write
from wirebond.cli.values import to_json
from wirebond.generate.new import shipped_formats

_MOST_SHOWN = 4
_MOST_MESSAGES = 6
_APART = 0.05  # part of the bytes that are in frames of both formats


def show(candidates: Sequence[Candidate], data: bytes, known: Known, line: str = "") -> None:
    """Print for a person. ``line``: the settings of the port at which the bytes came."""
    size = len(data)
    said = [f"{size} bytes{f' at {line}' if line else ''}, {len(known.formats)} formats tried", ""]
    fitting = [one for one in candidates if one.fits]
    other = look_at_unfitting(data, known.formats, candidates)
    for one in fitting[:_MOST_SHOWN]:
        said += [*_candidate(one), ""]
    if fitting:
        said += verdict(candidates)
    elif other.near:
        said += ["No known format fits as its file says.", *(one.sentence for one in other.near[:_MOST_SHOWN])]
    else:
        said += nothing_fits(size, candidates) if other.seen is None else _seen(other.seen)
        said += [
            f"Too weak to say: {one.format.name}, {one.evidence:.0f} bits" for one in candidates[:3] if one.evidence > 0
        ]
    write("\n".join(said) + "\n")


def _seen(seen: Inference) -> list[str]:
    """Describe the visible structure of an unknown format."""
    return [
        "No known format fits these bytes better than chance. This can be seen in them:",
        "",
        *seen.frame_lines,
        "",
        *(f"Uncertain: {sentence}" for sentence in seen.draft.uncertain),
        f"These frames are {seen.candidate.frame_share:.0%} of the bytes. Write a first protocol file from them: "
        "wirebond infer CAPTURE -o FILE.yaml",
    ]


def show_json(
    candidates: Sequence[Candidate], data: bytes, known: Known, settings: dict[str, Any] | None = None
) -> None:
    """Print for a program."""
    fitting = [one for one in candidates if one.fits]
    told = {
        "bytes": len(data),
        **(settings or {}),
        "formats_tried": len(known.formats),
        "left_out": [str(path) for path in known.unreadable],
        "format": fitting[0].format.name if fitting else None,
        "same_wire": [one.format.name for one in same_wire(candidates)],
        "candidates": [one.as_dict() for one in fitting],
        **look_at_unfitting(data, known.formats, candidates).as_dict(),
    }
    write(to_json(told) + "\n")


def same_wire(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return other formats whose frames look like those of the best one; none if nothing fits."""
    if not candidates or not candidates[0].fits:
        return []
    best = candidates[0]
    return [one for one in candidates[1:] if one.format.wire == best.format.wire]


def verdict(candidates: Sequence[Candidate]) -> list[str]:
    """Return the last words where something fits."""
    best, *others = (one for one in candidates if one.fits)
    twins = same_wire(candidates)
    said = []
    if twins:
        names = " and ".join([best.format.name, *(one.format.name for one in twins)])
        said.append(
            f"{names} are the same wire: their frames look the same. They differ in the messages that they list."
        )
    beside = [one for one in others if one.shared_with(best) < _APART and best.shared_with(one) < _APART]
    if beside:
        mates = [best, *beside[:1]]
        names = " and ".join(one.format.name for one in mates)
        shares = " and ".join(f"{one.frame_share:.0%}" for one in mates)
        said.append(f"{names} share the line: each explains other bytes, {shares} of them.")
        files = " ".join(str(one.format.model.path) for one in mates)
        said.append(f"One port can carry both: wirebond serve {files} PORT, or a CommonPort in Python.")
    rivals = [
        one
        for one in others
        if one not in beside and one.format.wire != best.format.wire and one.evidence > best.evidence / 2
    ]
    if rivals:
        names = ", ".join(one.format.name for one in rivals)
        said.append(f"{names} explains many of the same frames. Compare more bytes to be sure.")
    if best.frame_share + sum(one.frame_share for one in beside[:1]) < 0.5:
        said.append(
            f"{1 - best.frame_share:.0%} of the bytes lie in no frame. They may be messages that the file does not "
            "list, damaged frames, or another device."
        )
    file = Path(best.format.model.path)
    said.append(f"Use it: wirebond decode {file} CAPTURE, or wirebond monitor with a port.")
    if (shipped := shipped_formats().get(file.stem)) is not None and shipped.resolve() == file.resolve():
        said.append(f"To have the file in your folder: wirebond new {file.stem}.yaml --template {file.stem}")
    return said


def nothing_fits(size: int, candidates: Sequence[Candidate] = ()) -> list[str]:
    if size == 0:
        return ["There are no bytes to look at."]
    said = ["No known format fits these bytes better than chance."]
    repeating = [one for one in candidates if one.repeats]
    if repeating:
        said.append(
            f"The same bytes come again and again. {repeating[0].format.name} explains "
            f"{repeating[0].frame_share:.0%} of them, but a frame that repeats counts once. "
            "Make values change, for example move the robot, and try again."
        )
    elif size < FEW_BYTES:
        said.append(f"{size} bytes are few: give some seconds of the line, more than a hundred frames if you can.")
    return [
        *said,
        "What to try:",
        "  - another baud rate or parity: at a wrong one no format fits. `wirebond identify PORT` tries the usual ones",
        "  - swapped or inverted lines: S.BUS and some radios invert the level",
        "  - your own files: --also FOLDER",
        '  - one frame by hand: `wirebond explain FILE --hex "..."` with the file that is nearest',
    ]


def _candidate(one: Candidate) -> list[str]:
    evidence = f"{one.evidence:,.0f}".replace(",", " ")
    known = "" if one.known_frames == one.frames else f", {one.known_frames} of them of messages in the file"
    messages = list(one.messages.items())
    shown = ", ".join(f"{name} {count}" for name, count in messages[:_MOST_MESSAGES])
    shown += f" and {len(messages) - _MOST_MESSAGES} more" if len(messages) > _MOST_MESSAGES else ""
    if one.distinct_frames < one.frames:
        known += f", {one.distinct_frames} of them different"
    return [
        f"{one.format.name}  {one.format.model.path}",
        f"  evidence  {evidence} bits",
        f"  frames    {one.frames}{known}; {one.frame_share:.0%} of the bytes",
        f"  chance    {_chance(one.chance_frames)} such frames in as many random bytes",
        f"  messages  {shown}",
        f"  from      {' and '.join(one.senders) or 'unknown'}",
    ]


def _chance(frames: float) -> str:
    if frames < 1e-6:
        return "less than 0.000001"
    return f"{frames:.2g}"
