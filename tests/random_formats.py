"""Random protocol files: every part of the frame vocabulary, in every place where it may stand."""

from __future__ import annotations

import random

CHECKS = [
    "xor8", "sum8", "sum8-inverted", "sum8-negated", "sum16", "sum32", "fletcher-16", "fletcher-16/mod256",
    "crc-8/smbus", "crc-16/mcrf4xx", "crc-16/ibm-sdlc", "crc-16/xmodem", "crc-24/openpgp", "crc-32/iso-hdlc",
    "crc-64/xz", "{type: crc, width: 16, poly: 0x8005, init: 0x1234, refin: true, refout: false, xorout: 0x00FF}",
]  # fmt: skip
FIELD_TYPES = ["u8", "i8", "u16", "i16be", "u24", "i24be", "u32be", "i32", "f32", "f64be", "bool", "u64", "i64be"]
NUMBERS = ["u8", "u16", "u16be", "u24", "u32be"]


def random_protocol(source: random.Random, number: int) -> str:
    """The text of a protocol file that loads."""
    framing = source.choice(["start", "start", "start", "cobs", "slip", "hdlc", "escaped", "lines"])
    lines = ["wirebond: 1", f"protocol: random_{number}", f"byte_order: {source.choice(['little', 'big'])}", "frame:"]
    delimited = framing != "start"
    parts, rule = _parts(source, delimited)
    if framing == "start":
        lines += [f"  - {part}" for part in parts]
    elif framing == "lines":  # nothing is stuffed: the test's streams show what is lost then
        lines += [f"  - {part}" for part in parts] + ["  - delimiter: 0x0A"]
    else:
        byte = {"cobs": "0x00", "slip": "0xC0", "hdlc": "0x7E", "escaped": "0x02"}[framing]
        closing = "0x03" if framing == "escaped" else byte
        lines += [f"  - delimiter: {byte}"] if framing == "escaped" or source.random() < 0.8 else []
        inner = ", ".join(f"{{{part}}}" if not part.startswith("{") else part for part in parts)
        stuffed = f"{{escape: 0x1B, xor: 0x40, parts: [{inner}]}}" if framing == "escaped" else f"[{inner}]"
        lines += [f"  - {framing}: {stuffed}", f"  - delimiter: {closing}"]
    lines += _messages(source, rule)
    return "\n".join(lines) + "\n"


def _parts(source: random.Random, delimited: bool) -> tuple[list[str], str]:
    """The parts in wire order, and how the payload's size is known."""
    parts: list[str] = []
    if not delimited or source.random() < 0.3:
        magic = " ".join(f"0x{source.randrange(256):02X}" for _ in range(source.randint(1, 3)))
        parts.append(f"magic: {magic}")
    rule = "rest" if delimited and source.random() < 0.8 else source.choice(["by_length", "by_length", "by_id", "24"])
    header = ["{field: station, type: u8, default: 3}", "reserved: 1", "sequence: u8", "constant: 0x5A"]
    header = source.sample(header, source.randint(0, 3))
    flagged = source.random() < 0.3
    if flagged:
        header.append("{bits: u8, fields: {stamped: 1, spare: 3, version: {bits: 2, constant: 2}, rank: 2}}")
    id_late = rule != "by_id" and source.random() < 0.15
    if not id_late:
        header.insert(source.randint(0, len(header)), f"id: {source.choice(NUMBERS)}")
    if rule == "by_length":
        counts = source.choice(["payload", "payload", "rest", "self_and_rest", "frame"])
        offset = source.choice([0, 0, 1, 4])
        kind = source.choice(NUMBERS)
        header.insert(source.randint(0, len(header)), f"length: {{type: {kind}, counts: {counts}, offset: {offset}}}")
    parts += header
    if parts and source.random() < 0.3:
        parts.append(f"{{check: {source.choice(CHECKS[:12])}, name: header_check}}")
    if flagged:
        parts.append("{reserved: 4, name: stamp, when: stamped & 0x01}")
    trims = rule in ("rest", "by_length") and source.random() < 0.15
    parts.append(f"{{payload: {rule}, trim_zeros: true}}" if trims else f"payload: {rule}")
    if id_late:
        parts.append("id: u16")
    check = source.choice(CHECKS)
    parts.append(f"check: {check}")
    if source.random() < 0.3:
        parts.append("tail: 0x0D 0x55")
    return parts, rule


def _messages(source: random.Random, rule: str) -> list[str]:
    lines = [f"unknown: {source.choice(['deliver', 'reject'])}"] if rule != "by_id" and source.random() < 0.5 else []
    lines.append("messages:")
    for number in range(source.randint(1, 4)):
        sender = source.choice(["host", "mcu", "both"])
        lines += [f"  m{number}:", f"    id: {source.randrange(60) * 4 + number}", f"    sender: {sender}"]
        room = 24
        fields = []
        for index in range(source.randint(0, 4)):
            kind = source.choice(FIELD_TYPES)
            count = source.choice([None, None, None, 2, 3])
            size = {"bool": 1}.get(kind) or int("".join(c for c in kind if c.isdigit())) // 8
            if size * (count or 1) > room:
                continue
            room -= size * (count or 1)
            fields.append(f"      f{index}: {{type: {kind}{f', count: {count}' if count else ''}}}")
        if rule in ("by_length", "rest") and source.random() < 0.2:
            fields.append(f"      rest: {{type: bytes, max: {max(room, 1)}}}")
        lines += ["    fields:", *fields] if fields else []
    return lines
