"""Guesses at the bytes: a bit turned, a byte lost or doubled, what a terminal driver does, stuffing not done."""

from __future__ import annotations

from collections.abc import Iterator

from wirebond.analysis.explain.guesses.guess import Case, Guess, Guesses
from wirebond.analysis.explain.layout import CONSTANTS
from wirebond.analysis.explain.stuffing import stuff
from wirebond.protocol.model import PartKind

_RAW_TTY = "let the tty pass bytes as they are: `stty raw -ixon -icrnl -inlcr`, and no flow control by XON/XOFF"


def _changed(case: Case, block: bytes, text: str, remedy: str = "") -> Guess:
    return Guess(case.protocol, block, case.sender, f"everything holds if {text}", remedy)


def _byte(case: Case, at: int) -> str:
    return f"byte {case.offset + at} ({case.block[at]:02X})"


def one_bit(case: Case) -> Guesses:
    for at, byte in enumerate(case.block):
        for bit in range(8):
            turned = byte ^ (1 << bit)
            block = case.block[:at] + bytes([turned]) + case.block[at + 1 :]
            yield _changed(case, block, f"bit {bit} of {_byte(case, at)} was turned and is {turned:02X}")


def extra_byte(case: Case) -> Guesses:
    """Guess one superfluous byte, anywhere."""
    for at in range(len(case.block)):
        if at and case.block[at] == case.block[at - 1]:
            continue  # the same bytes come out
        block = case.block[:at] + case.block[at + 1 :]
        yield _changed(case, block, f"{_byte(case, at)} is left out")


def lost_constants(case: Case) -> Guesses:
    """Guess that the whole magic, or single bytes of constants, are lost; their places are known."""
    first = case.parts[0]
    for kept in range(first.size if first.kind in CONSTANTS else 0):
        missing = first.value[: first.size - kept]
        if case.block.startswith(first.value[len(missing) :]):
            yield _changed(case, missing + case.block, f"{missing.hex(' ').upper()} comes before byte {case.offset}")
    last = case.parts[-1]
    if last.kind in CONSTANTS:
        for kept in range(last.size):
            missing = last.value[kept:]
            yield _changed(case, case.block + missing, f"{missing.hex(' ').upper()} follows at the end")


def lost_byte(case: Case) -> Guesses:
    """Guess that a byte is lost that is often lost or often there: a zero, FF, one of two equal ones, an escape. Any
    value at all where the checks are wide enough to tell."""
    width = max((part.check_bits for part in case.parts if part.kind == PartKind.CHECK), default=0)
    for at in range(len(case.block) + 1):
        neighbours = set(case.block[max(0, at - 1) : at + 1])
        for value in range(256) if width >= 24 else sorted(neighbours | {0x00, 0xFF}):
            if at and value == case.block[at - 1]:
                continue  # the same bytes as one place earlier
            block = case.block[:at] + bytes([value]) + case.block[at:]
            where = f"after byte {case.offset + at - 1}" if at else f"before byte {case.offset}"
            yield _changed(case, block, f"a byte {value:02X} is put in {where}")


def terminal_driver(case: Case) -> Guesses:
    """Try the changes that a tty makes if it is not in raw mode."""
    for block, text in _translations(case):
        if block != case.block:
            yield _changed(case, block, text, _RAW_TTY)


def _translations(case: Case) -> Iterator[tuple[bytes, str]]:
    block = case.block
    yield block.replace(b"\r\n", b"\n"), "every 0A was sent as 0D 0A by a terminal driver"
    yield block.replace(b"\n", b"\r"), "every 0D was turned into 0A by a terminal driver"
    yield block.replace(b"\r", b"\n"), "every 0A was turned into 0D by a terminal driver"
    for at, byte in enumerate(block):
        if byte == 0x0A:
            yield block[:at] + b"\r" + block[at + 1 :], f"{_byte(case, at)} was a 0D, turned by a terminal driver"
        if byte == 0x0D:
            yield block[:at] + b"\n" + block[at + 1 :], f"{_byte(case, at)} was a 0A, turned by a terminal driver"
    for at in range(len(block) + 1):
        for name, value in (("XON", 0x11), ("XOFF", 0x13)):
            whole = block[:at] + bytes([value]) + block[at:]
            place = f"at place {case.offset + at}"
            yield whole, f"a byte {value:02X} ({name}) {place} was swallowed by software flow control"


def without_delimiters(case: Case) -> Guesses:
    """Guess that the given block has lost the delimiters around it."""
    frame_format = case.protocol.format
    if frame_format.delimiter is None:
        return
    closing = frame_format.delimiter
    opening = frame_format.opening or b""
    inner = case.block.removeprefix(opening).removesuffix(closing)
    if closing not in inner and (not opening or opening not in inner):
        before = f"{opening.hex(' ').upper()} comes before and " if opening else ""
        text = f"{before}{closing.hex(' ').upper()} behind these bytes"
        yield _changed(case, inner, text, "give the delimiters too: they are part of the frame")
    if frame_format.stuffing.hides_delimiters:
        how = f"the sender must stuff it ({frame_format.stuffing}), and put the delimiters around it"
        for data in dict.fromkeys((case.block, inner)):
            yield _changed(case, stuff(frame_format, data), "these are the bytes before stuffing", how)
