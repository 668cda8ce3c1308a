"""Small C and Python functions that work out a check, made from the algorithm's parameters: to copy, not to link."""

from __future__ import annotations

import re
from collections.abc import Callable

from wirebond.protocol.model import Algorithm, ByteOrder, CheckKind, OddTail


def function_name(algorithm: Algorithm) -> str:
    return re.sub("[^a-z0-9]+", "_", algorithm.name.lower())


def c_function(algorithm: Algorithm) -> list[str]:
    """Write a C99 function without tables: eight steps a byte."""
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
        *_c_loop(algorithm, steps),
        *(f"    {line}" for line in after),
        *_c_tail(algorithm),
        *(f"    {end} = {step};" for step in _last_steps(algorithm, end, _c_number, "0 - ")),
        *(f"    {line}" for line in _c_sent(algorithm, end)),
        f"    return ({returned})({_returned(end, algorithm, _c_number)});",
        "}",
    ]


def python_function(algorithm: Algorithm) -> list[str]:
    steps, after, end = _known(algorithm)[1](algorithm)
    return [
        f"def {function_name(algorithm)}(data: bytes) -> int:",
        f"    value = {_hex(_begin(algorithm), algorithm)}",
        *_python_halves(algorithm),
        *_python_loop(algorithm, steps),
        *(f"    {line}" for line in after),
        *_python_tail(algorithm),
        *(f"    {end} = {step}" for step in _last_steps(algorithm, end, _hex, "-")),
        *(f"    {line}" for line in _python_sent(algorithm, end)),
        f"    return {_returned(end, algorithm, _hex)}",
    ]


def _c_loop(algorithm: Algorithm, steps: list[str]) -> list[str]:
    """Write the loop over bytes, or over words; zeros may complete the last word."""
    size = algorithm.unit
    if size == 1:
        return ["    for (size_t i = 0; i < size; ++i) {", *(f"        {step}" for step in steps), "    }"]
    place = "8 * k" if algorithm.unit_order == ByteOrder.LITTLE else f"8 * ({size - 1} - k)"
    is_padded = algorithm.odd == OddTail.PAD
    return [
        f"    for (size_t i = 0; {'i < size' if is_padded else f'i + {size} <= size'}; i += {size}) {{",
        "        uint32_t word = 0;",
        f"        for (size_t k = 0; k < {size}{' && i + k < size' * is_padded}; ++k) {{",
        f"            word |= (uint32_t)data[i + k] << ({place});",
        "        }",
        *(f"        {step}" for step in steps),
        "    }",
    ]


def _python_loop(algorithm: Algorithm, steps: list[str]) -> list[str]:
    size = algorithm.unit
    if size == 1:
        return ["    for byte in data:", *(f"        {step}" for step in steps)]
    end = "len(data)" if algorithm.odd == OddTail.PAD else f"len(data) - len(data) % {size}"
    bytes_ = f"data[i : i + {size}]"
    if algorithm.odd == OddTail.PAD:
        bytes_ += f'.ljust({size}, b"\\0")'
    return [
        f"    for i in range(0, {end}, {size}):",
        f'        word = int.from_bytes({bytes_}, "{algorithm.unit_order.value}")',
        *(f"        {step}" for step in steps),
    ]


def _c_tail(algorithm: Algorithm) -> list[str]:
    if algorithm.odd != OddTail.XOR:
        return []
    return [f"    for (size_t i = size - size % {algorithm.unit}; i < size; ++i) value ^= data[i];"]


def _python_tail(algorithm: Algorithm) -> list[str]:
    if algorithm.odd != OddTail.XOR:
        return []
    return [f"    for byte in data[len(data) - len(data) % {algorithm.unit} :]:", "        value ^= byte"]


def _last_steps(algorithm: Algorithm, name: str, number: _Number, minus: str) -> list[str]:
    """Return the expressions that turn the register's value into the check's, one after the other."""
    steps = [f"({minus}{name}) & {number(_mask(algorithm), algorithm)}"] * algorithm.negate
    if algorithm.plus:
        steps.append(f"({name} + {number(algorithm.plus, algorithm)}) & {number(_mask(algorithm), algorithm)}")
    if algorithm.kept != _mask(algorithm):
        steps.append(f"{name} & {number(algorithm.kept, algorithm)}")
    if algorithm.xorout and not _is_xored_last(algorithm):
        steps.append(f"{name} ^ {number(algorithm.xorout, algorithm)}")
    return steps


def _is_xored_last(algorithm: Algorithm) -> bool:
    return not algorithm.bcd and not algorithm.avoided


def _c_sent(algorithm: Algorithm, name: str) -> list[str]:
    """Write the conversion of the check's value to its sent form."""
    lines = []
    if algorithm.bcd:
        places = reversed(range(algorithm.width // 4))
        digits = " | ".join(f"({name} / {10**place}u % 10u) << {4 * place}" for place in places)
        lines.append(f"{name} = {digits};")
    if algorithm.avoided:
        either = " || ".join(_c_between(name, low, high) for low, high in algorithm.avoided)
        plus, mask = (_c_number(value, algorithm) for value in (algorithm.avoided_plus, _mask(algorithm)))
        lines.append(f"if ({either}) {name} = ({name} + {plus}) & {mask};")
    return lines


def _python_sent(algorithm: Algorithm, name: str) -> list[str]:
    lines = []
    if algorithm.bcd:
        places = reversed(range(algorithm.width // 4))
        digits = " | ".join(f"({name} // {10**place} % 10) << {4 * place}" for place in places)
        lines.append(f"{name} = {digits}")
    if algorithm.avoided:
        either = " or ".join(
            f"{name} == 0x{low:02X}" if low == high else f"0x{low:02X} <= {name} <= 0x{high:02X}"
            for low, high in algorithm.avoided
        )
        plus, mask = (_hex(value, algorithm) for value in (algorithm.avoided_plus, _mask(algorithm)))
        lines += [f"if {either}:", f"    {name} = ({name} + {plus}) & {mask}"]
    return lines


def _c_between(name: str, low: int, high: int) -> str:
    if low == high:
        return f"{name} == 0x{low:02X}u"
    return f"{name} <= 0x{high:02X}u" if low == 0 else f"({name} >= 0x{low:02X}u && {name} <= 0x{high:02X}u)"


_Number = Callable[[int, Algorithm], str]
_Code = tuple[list[str], list[str], str]  # the loop's lines, those after it, and the name of the result


def _mask(algorithm: Algorithm) -> int:
    return (1 << algorithm.width) - 1


def _c_halves(algorithm: Algorithm) -> list[str]:
    """Write two sums that run side by side."""
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
    is_mirrored = algorithm.kind == CheckKind.CRC and algorithm.refin and not _goes_by_bits(algorithm)
    return _reflected(algorithm.init, algorithm) if is_mirrored else algorithm.init


def _goes_by_bits(algorithm: Algorithm) -> bool:
    """Return whether a CRC takes its bits one by one, because no byte fits its register's end."""
    return algorithm.unit > 1 or algorithm.width < 8


def _reflected(value: int, algorithm: Algorithm) -> int:
    return int(f"{value:0{algorithm.width}b}"[::-1], 2)


def _hex(value: int, algorithm: Algorithm) -> str:
    return f"0x{value:0{(algorithm.width + 3) // 4}X}"


def _c_number(value: int, algorithm: Algorithm) -> str:
    return _hex(value, algorithm) + ("ULL" if algorithm.width > 32 else "u")


def _returned(name: str, algorithm: Algorithm, number: _Number) -> str:
    is_xored = algorithm.xorout and _is_xored_last(algorithm)
    return f"{name} ^ {number(algorithm.xorout, algorithm)}" if is_xored else name


def _c_bits(algorithm: Algorithm) -> _Code:
    """Return a CRC that takes one bit after the other."""
    bits = 8 * algorithm.unit
    number = "data[i]" if algorithm.unit == 1 else "word"
    place = "bit" if algorithm.refin else f"{bits - 1} - bit"
    poly, mask = (_c_number(value, algorithm) for value in (algorithm.poly, _mask(algorithm)))
    steps = [
        f"for (int bit = 0; bit < {bits}; ++bit) {{",
        f"    uint32_t differs = (({number} >> ({place})) ^ (value >> {algorithm.width - 1})) & 1;",
        f"    value = ((value << 1) ^ (differs ? {poly} : 0)) & {mask};",
        "}",
    ]
    if not algorithm.refout:
        return steps, [], "value"
    mirrored = f"for (int bit = 0; bit < {algorithm.width}; ++bit) mirrored = (mirrored << 1) | ((value >> bit) & 1);"
    return steps, ["uint32_t mirrored = 0;", mirrored], "mirrored"


def _python_bits(algorithm: Algorithm) -> _Code:
    bits = 8 * algorithm.unit
    number = "byte" if algorithm.unit == 1 else "word"
    order = f"range({bits})" if algorithm.refin else f"reversed(range({bits}))"
    steps = [
        f"for bit in {order}:",
        f"    differs = (({number} >> bit) ^ (value >> {algorithm.width - 1})) & 1",
        f"    value = (value << 1 ^ differs * {_hex(algorithm.poly, algorithm)}) & {_hex(_mask(algorithm), algorithm)}",
    ]
    after = [f'value = int(f"{{value:0{algorithm.width}b}}"[::-1], 2)'] * algorithm.refout
    return steps, after, "value"


def _c_crc(algorithm: Algorithm) -> _Code:
    if _goes_by_bits(algorithm):
        return _c_bits(algorithm)
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
    if _goes_by_bits(algorithm):
        return _python_bits(algorithm)
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


def _c_name(algorithm: Algorithm) -> str:
    return "data[i]" if algorithm.unit == 1 else "word"


def _python_name(algorithm: Algorithm) -> str:
    return "byte" if algorithm.unit == 1 else "word"


def _c_sum(algorithm: Algorithm) -> _Code:
    number, width, mask = _c_name(algorithm), algorithm.width, _c_number(_mask(algorithm), algorithm)
    if not algorithm.modulus and not algorithm.end_around:
        return [f"value = (value + {number}) & {mask};"], [], "value"
    steps = [f"uint64_t sum = (uint64_t)value + {number};"]  # a carry out of 32 bits counts
    if algorithm.end_around:
        steps.append(f"while (sum >> {width}) sum = (sum & {mask}) + (sum >> {width});")
        return [*steps, "value = (uint32_t)sum;"], [], "value"
    return [*steps, f"value = (uint32_t)(sum % {algorithm.modulus});"], [], "value"


def _python_sum(algorithm: Algorithm) -> _Code:
    number, width, mask = _python_name(algorithm), algorithm.width, _hex(_mask(algorithm), algorithm)
    if algorithm.end_around:
        carried = f"    value = (value & {mask}) + (value >> {width})"
        return [f"value += {number}", f"while value >> {width}:", carried], [], "value"
    if algorithm.modulus:
        return [f"value = (value + {number}) % {algorithm.modulus}"], [], "value"
    return [f"value = (value + {number}) & {mask}"], [], "value"


def _c_xor(algorithm: Algorithm) -> _Code:
    return [f"value ^= {_c_name(algorithm)};"], [], "value"


def _python_xor(algorithm: Algorithm) -> _Code:
    return [f"value ^= {_python_name(algorithm)}"], [], "value"


def _c_fletcher(algorithm: Algorithm) -> _Code:
    half, modulus = algorithm.width // 2, _modulus(algorithm)
    return (
        [f"first = (first + {_c_name(algorithm)}) % {modulus}u;", f"second = (second + first) % {modulus}u;"],
        [f"value = (second << {half}) | first;"],
        "value",
    )


def _python_fletcher(algorithm: Algorithm) -> _Code:
    half, modulus = algorithm.width // 2, _modulus(algorithm)
    return (
        [f"first = (first + {_python_name(algorithm)}) % {modulus}", f"second = (second + first) % {modulus}"],
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
