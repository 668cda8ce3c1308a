"""Small C and Python functions that work out a check, made from the algorithm's parameters: to copy, not to link."""

from __future__ import annotations

import re
from collections.abc import Callable

from wirebond.protocol.model import Algorithm, CheckKind


def function_name(algorithm: Algorithm) -> str:
    return re.sub("[^a-z0-9]+", "_", algorithm.name.lower())


def c_function(algorithm: Algorithm) -> list[str]:
    """C99, without tables: eight steps a byte."""
    returned = f"uint{next(bits for bits in (8, 16, 32, 64) if bits >= algorithm.width)}_t"
    register = "uint64_t" if algorithm.width > 32 else "uint32_t"
    steps, after, end = _known(algorithm)[0](algorithm)
    return [
        "#include <stddef.h>",
        "#include <stdint.h>",
        "",
        f"{returned} {function_name(algorithm)}(const uint8_t *data, size_t size) {{",
        f"    {register} value = {_c_number(_begin(algorithm), algorithm)};",
        *_c_halves(algorithm),
        "    for (size_t i = 0; i < size; ++i) {",
        *(f"        {step}" for step in steps),
        "    }",
        *(f"    {line}" for line in after),
        *_c_negated(algorithm, end),
        f"    return ({returned})({_xored(end, algorithm, _c_number)});",
        "}",
    ]


def python_function(algorithm: Algorithm) -> list[str]:
    steps, after, end = _known(algorithm)[1](algorithm)
    return [
        f"def {function_name(algorithm)}(data: bytes) -> int:",
        f"    value = {_hex(_begin(algorithm), algorithm)}",
        *_python_halves(algorithm),
        "    for byte in data:",
        *(f"        {step}" for step in steps),
        *(f"    {line}" for line in after),
        *_python_negated(algorithm, end),
        f"    return {_xored(end, algorithm, _hex)}",
    ]


_Code = tuple[list[str], list[str], str]  # the loop's lines, those behind it, and the name of the result


def _c_negated(algorithm: Algorithm, name: str) -> list[str]:
    return [f"    {name} = (0 - {name}) & {_c_number(_mask(algorithm), algorithm)};"] * algorithm.negate


def _python_negated(algorithm: Algorithm, name: str) -> list[str]:
    return [f"    {name} = -{name} & {_hex(_mask(algorithm), algorithm)}"] * algorithm.negate


def _mask(algorithm: Algorithm) -> int:
    return (1 << algorithm.width) - 1


def _c_halves(algorithm: Algorithm) -> list[str]:
    """Two sums that run side by side."""
    if algorithm.kind != CheckKind.FLETCHER:
        return []
    half = algorithm.width // 2
    return [f"    uint32_t first = value & {hex((1 << half) - 1)}u, second = value >> {half};"]


def _python_halves(algorithm: Algorithm) -> list[str]:
    if algorithm.kind != CheckKind.FLETCHER:
        return []
    half = algorithm.width // 2
    return [f"    first, second = value & {hex((1 << half) - 1)}, value >> {half}"]


def _begin(algorithm: Algorithm) -> int:
    return (
        _reflected(algorithm.init, algorithm) if algorithm.kind == CheckKind.CRC and algorithm.refin else algorithm.init
    )


def _reflected(value: int, algorithm: Algorithm) -> int:
    return int(f"{value:0{algorithm.width}b}"[::-1], 2)


def _hex(value: int, algorithm: Algorithm) -> str:
    return f"0x{value:0{algorithm.width // 4}X}"


def _c_number(value: int, algorithm: Algorithm) -> str:
    return _hex(value, algorithm) + ("ULL" if algorithm.width > 32 else "u")


def _xored(text: str, algorithm: Algorithm, number: Callable[[int, Algorithm], str]) -> str:
    return f"{text} ^ {number(algorithm.xorout, algorithm)}" if algorithm.xorout else text


def _c_crc(algorithm: Algorithm) -> _Code:
    top = _c_number(1 << (algorithm.width - 1), algorithm)
    mask = _c_number(_mask(algorithm), algorithm)
    if algorithm.refin:
        poly = _c_number(_reflected(algorithm.poly, algorithm), algorithm)
        steps = [
            "value ^= data[i];",
            f"for (int bit = 0; bit < 8; ++bit) value = (value & 1) ? (value >> 1) ^ {poly} : value >> 1;",
        ]
    else:
        poly = _c_number(algorithm.poly, algorithm)
        cast = "(uint64_t)" if algorithm.width > 32 else "(uint32_t)"
        shift = f" << {algorithm.width - 8}" if algorithm.width > 8 else ""
        steps = [
            f"value ^= {cast}data[i]{shift};",
            f"for (int bit = 0; bit < 8; ++bit) value = (value & {top}) ? (value << 1) ^ {poly} : value << 1;",
            f"value &= {mask};",
        ]
    after = []
    if algorithm.refin != algorithm.refout:
        register = "uint64_t" if algorithm.width > 32 else "uint32_t"
        after = [
            f"{register} mirrored = 0;",
            f"for (int bit = 0; bit < {algorithm.width}; ++bit) mirrored = (mirrored << 1) | ((value >> bit) & 1);",
        ]
    return steps, after, "mirrored" if after else "value"


def _python_crc(algorithm: Algorithm) -> _Code:
    if algorithm.refin:
        poly = _hex(_reflected(algorithm.poly, algorithm), algorithm)
        steps = [
            "value ^= byte",
            "for _ in range(8):",
            f"    value = value >> 1 ^ {poly} if value & 1 else value >> 1",
        ]
    else:
        poly, top = _hex(algorithm.poly, algorithm), _hex(1 << (algorithm.width - 1), algorithm)
        steps = [
            f"value ^= byte << {algorithm.width - 8}" if algorithm.width > 8 else "value ^= byte",
            "for _ in range(8):",
            f"    value = value << 1 ^ {poly} if value & {top} else value << 1",
            f"value &= {_hex(_mask(algorithm), algorithm)}",
        ]
    after = []
    if algorithm.refin != algorithm.refout:
        after = [f'value = int(f"{{value:0{algorithm.width}b}}"[::-1], 2)']
    return steps, after, "value"


def _c_sum(algorithm: Algorithm) -> _Code:
    mask = _c_number(_mask(algorithm), algorithm)
    return [f"value = (value + data[i]) & {mask};"], [], "value"


def _python_sum(algorithm: Algorithm) -> _Code:
    mask = _hex(_mask(algorithm), algorithm)
    return [f"value = (value + byte) & {mask}"], [], "value"


def _c_xor(_: Algorithm) -> _Code:
    return ["value ^= data[i];"], [], "value"


def _python_xor(_: Algorithm) -> _Code:
    return ["value ^= byte"], [], "value"


def _c_fletcher(algorithm: Algorithm) -> _Code:
    half, modulus = algorithm.width // 2, _modulus(algorithm)
    return (
        [f"first = (first + data[i]) % {modulus}u;", f"second = (second + first) % {modulus}u;"],
        [f"value = (second << {half}) | first;"],
        "value",
    )


def _python_fletcher(algorithm: Algorithm) -> _Code:
    half, modulus = algorithm.width // 2, _modulus(algorithm)
    return (
        [f"first = (first + byte) % {modulus}", f"second = (second + first) % {modulus}"],
        [f"value = second << {half} | first"],
        "value",
    )


def _modulus(algorithm: Algorithm) -> int:
    return algorithm.modulus or 1 << algorithm.width // 2


_Maker = Callable[[Algorithm], _Code]

# One entry for each kind of algorithm in the model: C and Python.
_KINDS: dict[str, tuple[_Maker, _Maker]] = {
    CheckKind.CRC: (_c_crc, _python_crc),
    CheckKind.SUM: (_c_sum, _python_sum),
    CheckKind.XOR: (_c_xor, _python_xor),
    CheckKind.FLETCHER: (_c_fletcher, _python_fletcher),
}


def _known(algorithm: Algorithm) -> tuple[_Maker, _Maker]:
    if algorithm.kind not in _KINDS:
        raise NotImplementedError(f"snippets.py has no entry for the kind of check '{algorithm.kind}'")
    return _KINDS[algorithm.kind]
