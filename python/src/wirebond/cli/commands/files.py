"""Commands that work on files and bytes: no port, no clock."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

from wirebond.arguments import hex_bytes
from wirebond.cli.output import ReaderGone, errors, write
from wirebond.cli.shown import print_message, stats_line
from wirebond.cli.values import hex_of, parse_assignments, parse_header, to_json
from wirebond.codec import load
from wirebond.errors import MessageError, UsageError, WirebondError
from wirebond.protocol.model import Message, Protocol
from wirebond.protocol.problems import no_message

_CHUNK = 65536  # bytes read at a time


def find_message(model: Protocol, name: str) -> Message:
    """Return the message of this name, or a MessageError that lists the names there are."""
    try:
        return model.message(name)
    except KeyError:
        raise MessageError(no_message(model.name, name, [m.name for m in model.messages])) from None


def encode_message(
    path: Path, name: str, words: list[str], as_json: bool, sender: str | None, header_words: list[str]
) -> None:
    codec = load(path)
    values = parse_assignments(find_message(codec.model, name), words)
    header = parse_header(codec.model, header_words)
    frame = codec.encode(name, values, header=header, sender=sender)
    if as_json:
        told = {"message": name, **({"header": header} if header else {}), "fields": values, "bytes": hex_of(frame)}
        write(to_json(told) + "\n")
    else:
        write(hex_of(frame) + "\n")


def decode_bytes(
    path: Path,
    source: str | None,
    sender: str | None,
    hex_text: str | None,
    expect: str | None,
    header_words: list[str],
) -> int:
    if (source is None) == (hex_text is None):
        raise UsageError('give bytes one way: --hex "AA 55 …", the path of a capture, or - for stdin')
    codec = load(path)
    decoder = codec.decoder(sender)
    if header_words and expect is None:
        raise UsageError("--header applies to the request; add --expect REQUEST")
    decoder.expect(expect, header=parse_header(codec.model, header_words) or None)
    chunks = iter([hex_bytes(hex_text)]) if hex_text is not None else _chunks(source or "-")
    try:
        for chunk in chunks:
            for message in decoder.feed(chunk):
                print_message(message, codec)
        for message in decoder.finish():
            print_message(message, codec)
    except (KeyboardInterrupt, ReaderGone):
        errors.print(stats_line(decoder.stats))
        raise
    stats = decoder.stats
    errors.print(stats_line(stats))
    return 1 if stats.bytes and not stats.frames else 0


def _chunks(source: str) -> Iterator[bytes]:
    if source == "-":
        try:
            while chunk := os.read(sys.stdin.fileno(), _CHUNK):  # available bytes, without waiting for more
                yield chunk
        except OSError as error:
            raise WirebondError(
                f"standard input cannot be read ({error.strerror}); pipe bytes into it, or name a file"
            ) from error
        return
    if "\0" in source:
        raise UsageError("a file's name cannot contain a zero byte; name the capture")
    from wirebond.recording.capture import captured  # noqa: PLC0415 it takes long to import

    yield from captured(Path(source))
