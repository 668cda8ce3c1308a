"""Random checks: the parts of which a check may be made, combined as a file may combine them."""

from __future__ import annotations

import random

from wirebond.protocol import loads
from wirebond.protocol.model import Algorithm, PartKind


def random_check(chance: random.Random) -> tuple[str, int]:
    """Return the text for a file from ``type`` on, such as ``sum, width: 16, unit: 2``, and the bytes of the value."""
    kind = chance.choice(("crc", "sum", "xor", "fletcher"))
    width = _width(kind, chance)
    every = (1 << width) - 1
    options = [kind, f"width: {width}"]
    begin = every
    if kind == "crc":
        options.append(f"poly: {chance.randint(0, every) | 1:#x}")
        options += [f"{name}: {chance.choice(('true', 'false'))}" for name in ("refin", "refout")]
    elif kind in ("sum", "fletcher") and chance.random() < 0.4:
        modulo = chance.choice(
            [n for n in (100, 255, 256, 65521, 65535) if n <= every and (kind == "sum" or n**2 <= every + 1)] or [3]
        )
        options.append(f"modulo: {modulo}")
        begin = min(begin, modulo - 1)
    elif kind == "sum" and chance.random() < 0.4:
        options.append("carry: end_around")
    if kind != "fletcher" and chance.random() < 0.4:
        options.append(f"init: {chance.randint(0, begin):#x}")
    options += _words(kind, width, chance)
    options += _last_steps(kind, every, chance)
    options += _sent(kind, width, random.Random(", ".join(options)))  # so that these draws move no others
    return ", ".join(options), (width + 7) // 8


def algorithm_of(check: str) -> Algorithm:
    """Return the loader's algorithm for it."""
    over = "over: payload, " if "refuse" in check else ""
    text = (
        f"wirebond: 1\nprotocol: check\nframe: [magic: 0xA5, payload: 4, check: {{{over}type: {check}}}]\n"
        "messages: {number: {sender: mcu, fields: {number: u32}}}\n"
    )
    part = loads(text).format.part(PartKind.CHECK)
    assert part is not None
    assert part.algorithm is not None
    return part.algorithm


def _width(kind: str, chance: random.Random) -> int:
    if kind == "crc":
        return chance.choice((*range(3, 65), 8, 16, 16, 32))
    if kind == "fletcher":
        return chance.choice((8, 16, 32))
    return chance.choice((7, 8, 8, 12, 16, 16, 24, 32))


def _words(kind: str, width: int, chance: random.Random) -> list[str]:
    """Words that its register has room for."""
    room = {"crc": 32, "sum": 32, "xor": width, "fletcher": width // 2}[kind]
    units = [unit for unit in (2, 4) if 8 * unit <= room]
    if not units or width > 32 or chance.random() < 0.4:
        return []
    options = [f"unit: {chance.choice(units)}"]
    if chance.random() < 0.5:
        options.append(f"unit_order: {chance.choice(('little', 'big'))}")
    if chance.random() < 0.4:
        options.append("odd: xor" if kind != "crc" and chance.random() < 0.7 else "odd: refuse")
    return options


def _last_steps(kind: str, every: int, chance: random.Random) -> list[str]:
    options = []
    if kind == "sum" and chance.random() < 0.3:
        options.append(f"sums_to: {chance.randint(0, every):#x}")
    else:
        options += ["negate: true"] * (chance.random() < 0.25)
        options += [f"plus: {chance.randint(0, every):#x}"] * (chance.random() < 0.2)
    options += [f"mask: {chance.randint(0, every):#x}"] * (chance.random() < 0.2)
    options += [f"xorout: {chance.randint(0, every):#x}"] * (chance.random() < 0.4)
    return options


def _sent(kind: str, width: int, chance: random.Random) -> list[str]:
    """From the number that the check is to the one that is sent."""
    options = ["bcd: true"] * (kind == "sum" and width % 4 == 0 and chance.random() < 0.2)
    if 5 <= width <= 8 and chance.random() < 0.2:
        high = chance.randint(1, (1 << width - 1) - 1)
        values = chance.choice((f"0..{high:#x}", f"[0, {high}]"))
        options.append(f"avoid: {{values: {values}, plus: {high + 1}}}")
    return options
