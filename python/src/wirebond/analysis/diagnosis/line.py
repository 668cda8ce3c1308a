"""Finds out what is wrong with a line from its last bytes. Pure: bytes and times in, sentences out.

A healthy line gives nothing. Where something is wrong and nothing explains it, that is said, and no cause is guessed.
"""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter, defaultdict

from wirebond.analysis.diagnosis.finding import Diagnosis, Kind
from wirebond.analysis.diagnosis.other_protocols import own_entries
from wirebond.analysis.diagnosis.recent import recent
from wirebond.analysis.diagnosis.settings_of_line import other_settings, parity_of_seven_bits
from wirebond.analysis.diagnosis.shared_port import changed_settings, other_readers
from wirebond.analysis.explain import Changes, explain
from wirebond.codec import Codec
from wirebond.link import Dump, DumpEntry, Link
from wirebond.link.dump import Piece
from wirebond.protocol.model import End

_NEWEST_BYTES = 1 << 16  # that are looked at
_LEAST_BYTES = 64  # received, before anything is said of them
_BAD = 0.05  # part of the bytes that is discarded, from which on a cause is looked for
_FEW_FRAMES = 0.2  # part of the bytes in frames, below which settings of the line are suspected
_SILENT = 2.0  # seconds
_LEAST = 3  # times that something must be seen
_EXPLAINED_BYTES = 512  # of refused frames that `explain` examines
_MOST_RUNS = 20
_FULL_READS = (512, 64, 62)  # bytes that USB adapters hand over at once, the largest first
_OF_PEER = {
    Changes.CHECK: (Kind.CHECK, "computes its check"),
    Changes.FORMAT: (Kind.FORMAT, "builds its frames"),
}
_TEXT = re.compile(rb"[\x20-\x7e]{8,}")


def diagnose(link: Link, seconds: float = math.inf) -> list[Diagnosis]:
    """Return what is wrong with this link's line, by its last bytes. Empty if it is healthy. Any thread; it may take a
    second or two.

    :param link: an open one, or one that was just closed.
    :param seconds: the time to examine up to now, so that past faults are not reported; default: all bytes.
        A reset loop is reported until the next reset is overdue.
    :returns: causes that the bytes speak for; one of kind ``unknown`` where something is wrong and none is found.
    """
    dump = link.dump()
    pieces: list[Piece] = []
    size = 0
    for piece in reversed(dump.pieces):
        if size > _NEWEST_BYTES:
            break
        pieces.append(piece)
        size += len(piece.bytes)
    dropped = dump.dropped_bytes + len(dump.received) + len(dump.sent) - size
    found = diagnose_dump(dump.with_pieces(pieces[::-1], dropped), link.baud, seconds)
    reader = other_readers(link.device) if found and not link.is_attached else None
    return found if reader is None else [reader, *found]


def diagnose_dump(dump: Dump, baud: int, seconds: float = math.inf) -> list[Diagnosis]:
    """Do the same for a copy of the bytes.

    :param dump: what ``Link.dump`` gives.
    :param baud: the link's rate.
    :param seconds: the time to examine up to now, as in ``diagnose``.
    :returns: as ``diagnose``.
    """
    resets = _resets(dump, seconds)
    dump = recent(dump, seconds)
    collided = _collisions(dump)
    received = own_entries([e for e in dump.entries if e.direction == "received"], dump.other_protocols, _peer(dump))
    data = b"".join(e.bytes for e in received)
    found = [one for one in (changed_settings(dump), collided or _echo(dump), resets) if one is not None]
    if not data:
        return found or _silence(dump)
    bad = sum(len(e.bytes) for e in received if e.kind == "discarded")
    if len(data) < _LEAST_BYTES or bad < _BAD * len(data):
        return found or _silence(dump)
    peer = _peer(dump)
    good = sum(len(e.bytes) for e in received if e.kind == "frame")
    first = (
        _two_writers(dump.codec, received, peer)
        or _lost_reads(dump, received)
        or _other_format(dump.codec, received, peer)
    )
    if first is None and good < _FEW_FRAMES * len(data):
        first = parity_of_seven_bits(data) or other_settings(dump.codec, peer, data, baud)
    found += [] if first is None else [first]
    return found or [_unknown(received, bad, len(data))]


def _peer(dump: Dump) -> End:
    """Return the end whose bytes are received."""
    return End.MCU if dump.role == End.HOST else End.HOST


def _silence(dump: Dump) -> list[Diagnosis]:
    """Find silence: no byte any more, although the other end should send or was asked."""
    signs = [p.t for p in dump.pieces if p.kind in ("port_up", "received")]
    if not signs or dump.pieces[-1].kind == "port_down" or dump.t - signs[-1] < _SILENT:
        return []
    sends = any(m.every is not None and m.every < _SILENT and m.sent_by(_peer(dump)) for m in dump.codec.model.messages)
    asked = any(e.message is not None and _has_reply(dump.codec, e.message.name) for e in dump.entries)
    if not sends and not asked:
        return []
    return [
        Diagnosis(
            Kind.SILENCE,
            "Nothing is received",
            f"no byte for {dump.t - signs[-1]:.0f} s, and the other end should "
            f"{'send by itself' if sends else 'answer'}",
            "Look at power, ground, and whether transmit and receive are swapped; `wirebond doctor` looks at the port.",
        )
    ]


def _has_reply(codec: Codec, name: str) -> bool:
    return any(m.name == name and m.reply is not None for m in codec.model.messages)


def _echo(dump: Dump) -> Diagnosis | None:
    """Detect a line that returns the host's own bytes."""
    sent = [e for e in dump.entries if e.direction == "sent" and e.kind == "frame" and len(e.bytes) >= 4]
    own = {e.bytes for e in sent if e.message is not None and e.message.sender == dump.role}
    times = [e for e in sent if e.bytes in own]
    if len(times) < _LEAST:
        return None
    data = dump.received
    back = sum(min(count, data.count(frame)) for frame, count in Counter(e.bytes for e in times).items())
    if back < 0.8 * len(times):
        return None
    return Diagnosis(
        Kind.ECHO,
        "The host's bytes come back to it",
        f"{back} of {len(times)} sent frames were received again",
        "On one wire or RS-485 the adapter hears its own bytes: write `echo: true` under `link` of the protocol "
        "file, or switch its receiver off while it sends. Else look for a bridge between transmit and receive, or a "
        "peer that repeats what it gets.",
    )


def _collisions(dump: Dump) -> Diagnosis | None:
    """Find frames that did not come back as they were sent, on a line that echoes."""
    collided = sum(piece.kind == "port_collision" for piece in dump.pieces)
    if collided < _LEAST:
        return None
    sent = max(sum(piece.kind == "sent" for piece in dump.pieces), collided)
    evidence = f"{collided} of {sent} sent frames did not come back as they were sent"
    if collided > 0.9 * sent:
        return Diagnosis(
            Kind.NO_ECHO,
            "Sent bytes do not come back, but the protocol file says `echo: true`",
            evidence,
            "Is the transceiver's driver enabled while this end sends, and its receiver always? If the adapter does "
            "not hear itself, remove `echo: true` from `link` of the protocol file.",
        )
    return Diagnosis(
        Kind.COLLISIONS,
        "Two ends send at the same time",
        evidence,
        "Let one end begin and the others answer; look for two devices with one address, and for a driver that is "
        "enabled for too long.",
    )


def _resets(dump: Dump, seconds: float) -> Diagnosis | None:
    """Detect the same start-up text, or the MCU's hello, again and again."""
    texts: defaultdict[bytes, list[float]] = defaultdict(list)
    for entry in dump.entries:
        if (entry.direction, entry.kind) == ("received", "discarded"):
            for text in set(_TEXT.findall(entry.bytes)):
                texts[text].append(entry.t)
    text, times = max(texts.items(), key=lambda found: len(found[1]), default=(b"", []))
    if len(times) >= _LEAST:
        told = f'"{text[:40].decode()}" came {len(times)} times'
        return None if _is_over(times, dump.t, seconds) else _reset_finding(told)
    codec = dump.codec
    hello = codec.model.service("hello")
    name = None if hello is None else hello.message("message")
    if name is None or codec.model.message(name).every is not None:
        return None
    hellos = [e for e in dump.entries if e.message is not None and e.message.name == name]
    times = [e.t for e in hellos if e.direction == "received"]
    asked = len(hellos) - len(times)
    if len(times) - asked < _LEAST or _is_over(times, dump.t, seconds):
        return None
    return _reset_finding(f"{name} came {len(times)} times and was asked for {asked} times")


def _is_over(starts: list[float], now: float, seconds: float) -> bool:
    """Return whether the next start is overdue."""
    longest = max(after - before for before, after in itertools.pairwise(starts))
    return now - starts[-1] > max(seconds, 2 * longest)


def _reset_finding(evidence: str) -> Diagnosis:
    return Diagnosis(
        Kind.RESETS,
        "The MCU starts again and again",
        evidence,
        "Look at its supply, its watchdog, and whether opening the port resets it (DTR and RTS of the adapter).",
    )


def _two_writers(codec: Codec, received: list[DumpEntry], peer: End) -> Diagnosis | None:
    """Return a frame in the middle of another one: without it the bytes around it are a frame."""
    torn = 0
    for before, inner, after in zip(received, received[1:], received[2:], strict=False):
        if (before.kind, inner.kind, after.kind) != ("discarded", "frame", "discarded"):
            continue
        decoder = codec.decoder(peer)
        joined = before.bytes + after.bytes
        frames = [*decoder.feed(joined), *decoder.finish()]
        seam = len(before.bytes)
        torn += any(f.offset < seam < f.offset + len(f.raw) for f in frames)
    if torn < _LEAST:
        return None
    return Diagnosis(
        Kind.TWO_WRITERS,
        "Two senders write on one line",
        f"{torn} frames are in the middle of another frame, which is whole without them",
        "Let one task, or one device, send at a time: a lock around the transmit call, or the send queue of Wirebond.",
    )


def _lost_reads(dump: Dump, received: list[DumpEntry]) -> Diagnosis | None:
    """Find damage at the end of full reads: the bytes after them were lost."""
    reads = [p for p in dump.pieces if p.kind == "received"]
    size = next((s for s in _FULL_READS if sum(len(p.bytes) % s == 0 for p in reads) > 0.3 * len(reads)), None)
    if size is None or len(reads) < 2 * _LEAST:
        return None
    full_ends = set()
    at = 0
    for piece in reads:
        at += len(piece.bytes)
        if len(piece.bytes) % size == 0:
            full_ends.add(at)
    runs: list[tuple[int, int]] = []
    at = 0
    for entry in received:
        end = at + len(entry.bytes)
        if entry.kind == "discarded":
            runs = [*runs[:-1], (runs[-1][0], end)] if runs and runs[-1][1] == at else [*runs, (at, end)]
        at = end
    hit = sum(any(start < end < stop for end in full_ends) for start, stop in runs)
    chance = min(1.0, sum(stop - start for start, stop in runs) / max(1, len(runs)) * len(full_ends) / max(1, at))
    if hit < 2 * _LEAST or hit < 0.8 * len(runs) or chance > 0.5 or hit * -math.log2(chance) < 20:
        return None
    return Diagnosis(
        Kind.LOST_READS,
        f"Bytes are lost in the buffers of a USB adapter, {size} bytes at a time",
        f"{hit} of {len(runs)} losses lie where a read of {size} bytes, or a multiple, ends; by chance {chance:.0%}",
        "Take load off the computer or the USB hub, use flow control, a lower rate, or an adapter with larger buffers.",
    )


def _other_format(codec: Codec, received: list[DumpEntry], peer: End) -> Diagnosis | None:
    """Return the peer computes its check, or builds its frames, in another way: one change to the file fits the refused
    frames together."""
    refused = b"".join(_runs(received))[:_EXPLAINED_BYTES]
    together = explain(codec.model, refused, peer, quick=True).together
    if not together or together[0].changes not in _OF_PEER or together[0].fits < max(_LEAST, 0.6 * together[0].of):
        return None
    best = together[0]
    kind, what = _OF_PEER[best.changes]
    return Diagnosis(
        kind,
        f"The peer {what} in another way. {best.what.rstrip('.')}",
        f"the same explanation fits {best.fits} of {best.of} refused frames",
        best.remedy,
    )


def _runs(received: list[DumpEntry]) -> list[bytes]:
    """Join discarded bytes that are next to each other, also across reads."""
    runs: list[bytes] = []
    is_open = False
    for entry in received:
        if entry.kind == "discarded":
            runs = [*runs[:-1], runs[-1] + entry.bytes] if is_open else [*runs, entry.bytes]
        is_open = entry.kind == "discarded"
        if len(runs) > _MOST_RUNS:
            break
    return runs


def _causes(received: list[DumpEntry]) -> Counter[str]:
    causes: Counter[str] = Counter()
    for entry in received:
        causes.update(entry.causes)
    return causes


def _unknown(received: list[DumpEntry], bad: int, size: int) -> Diagnosis:
    most = ", ".join(f"{count} {cause}" for cause, count in _causes(received).most_common(3))
    return Diagnosis(
        Kind.UNKNOWN,
        "Many bytes are not frames, and I do not know why",
        f"{bad} of {size} bytes: {most}",
        "Look at one of them with `wirebond explain`, let `wirebond identify` try other formats and rates, and look at "
        "cable length, ground and shielding.",
    )
