"""Text of others, made safe to print: everything that could control a terminal or hide text is escaped."""

from __future__ import annotations

from unicodedata import category

# Control characters (C0, DEL, C1), format characters (among them those that turn the direction of writing), surrogates
# and the two separators of lines and paragraphs. Letters, signs and emoji of every script stay.
_UNSAFE = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
_SHORT = {"\n": r"\n", "\r": r"\r", "\t": r"\t"}


def visible(text: str, keep: str = "") -> str:
    """Return ``text`` on one line, with characters that are unsafe in a terminal as escapes: ``\x1b``, ``\u202e``.

    :param text: from a device, a file, a file's name or a command line.
    :param keep: characters that stay as they are; ``"\n"`` for a text of several lines.
    """
    if text.isprintable():
        return text
    return "".join(c if c in keep or category(c) not in _UNSAFE else _SHORT.get(c) or _escape(c) for c in text)


def visible_json(text: str) -> str:
    """Escape unsafe characters of JSON by JSON's own escapes, which a reader restores.

    :param text: JSON on one line. Unsafe characters can only be within its strings.
    """
    if text.isprintable():
        return text
    return "".join(c if category(c) not in _UNSAFE else _json_escape(ord(c)) for c in text)


def _escape(character: str) -> str:
    code = ord(character)
    if 0xDC80 <= code <= 0xDCFF:  # how Python holds a byte of a file's name that is not UTF-8
        code -= 0xDC00
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def _json_escape(code: int) -> str:
    if code < 0x10000:
        return f"\\u{code:04x}"
    code -= 0x10000
    return f"\\u{0xD800 + (code >> 10):04x}\\u{0xDC00 + (code & 0x3FF):04x}"
