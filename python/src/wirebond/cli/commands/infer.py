"""``wirebond infer``: turns bytes of an unknown format into a first protocol file, with the evidence as comments."""

from __future__ import annotations

from pathlib import Path

from wirebond.analysis.infer import infer
from wirebond.cli.given_bytes import given_bytes
from wirebond.cli.output import errors, plain, write
from wirebond.errors import UsageError
from wirebond.generate.new.write import protocol_name, write_new
from wirebond.protocol.model import End


def infer_file(source: str | None, hex_text: str | None, out: Path | None, sender: str | None) -> int:
    """Exit code 1 where nothing in the bytes repeats as frames do."""
    if sender not in (None, End.MCU, End.HOST):
        raise UsageError(f"--sender is {sender}; write mcu or host")
    data = given_bytes(source, hex_text, sender)
    named = "bytes" if source is None or not Path(source).is_file() else Path(source).name
    found = infer(data, protocol_name(out or Path(named)), plain(named), End(sender or End.MCU))
    if found is None:
        errors.print(
            f"In these {len(data)} bytes nothing repeats as frames do. Give bytes of one sender, more than a hundred "
            "frames if you can, with values that change; at a wrong baud rate nothing repeats."
        )
        return 1
    one = found.candidate
    errors.print(
        f"{one.frames} frames, {one.frame_share:.0%} of {one.size} bytes; evidence {one.evidence:.0f} bits. The "
        "comments give the evidence for each line, and say what is uncertain."
    )
    if out is None:
        write(found.text)
        return 0
    write_new(out, found.text)
    errors.print(plain(f"{out} is written. Next: wirebond check {out}, and wirebond decode {out} CAPTURE"))
    return 0
