"""Names only: what a protocol's names are called in C++ so that no two of them meet.

Which names a file may give at all, and what each is in code, is in ``wirebond.protocol.names``.
"""

from __future__ import annotations

from wirebond.protocol.names import code_name, identifier, python_identifier, type_name

# Functions that C libraries put into the global namespace, where a namespace of the same name would not compile.
# fmt: off
GLOBAL_FUNCTIONS = frozenset({
    "abort", "abs", "accept", "access", "acos", "alarm", "asin", "atan", "atof", "atoi", "bind", "brk",
    "calloc", "ceil", "clock", "close", "connect", "cos", "creat", "ctime", "daemon", "div", "dup", "erf",
    "exit", "exp", "fabs", "floor", "fork", "free", "gamma", "getc", "gets", "index", "ioctl", "isatty", "j0",
    "j1", "jn", "kill", "labs", "link", "listen", "log", "lseek", "malloc", "mktime", "modf", "nice", "open",
    "pause", "pipe", "poll", "pow", "printf", "putc", "puts", "qsort", "raise", "rand", "read", "realloc",
    "recv", "remove", "rename", "rewind", "rindex", "rint", "round", "scanf", "select", "send", "shutdown",
    "signal", "sin", "sinh", "sleep", "socket", "splice", "sqrt", "srand", "strlen", "swab", "sync", "system",
    "tan", "tanh", "tee", "time", "tmpfile", "trunc", "umask", "uname", "ungetc", "unlink", "usleep", "vfork",
    "wait", "write", "y0", "y1", "yn",
})
# fmt: on

# Types that generated headers declare beside the messages or in each of them.
GENERATED_TYPES = frozenset(
    {
        "Action",
        "AtHost",
        "AtMcu",
        "FromHost",
        "FromMcu",
        "HostLink",
        "HostBuffers",
        "Info",
        "LatestMessages",
        "McuBuffers",
        "McuLink",
        "NeverSent",
        "Parity",
        "Receiver",
    }
)


def namespace(protocol: str) -> str:
    """Return the namespace of a protocol. Names of types in C's headers end in ``_t``, as ``uint8_t`` does."""
    is_taken = protocol in GLOBAL_FUNCTIONS or protocol == "main" or protocol.endswith("_t")
    return protocol + "_protocol" if is_taken else protocol


class Scope:
    """Hands out each name once: a name that is taken gets the suffix, then numbers as well."""

    def __init__(self, taken: frozenset[str] = frozenset()) -> None:
        self._taken = set(taken)

    def claim(self, name: str, suffix: str) -> str:
        candidate = name
        number = 1
        while candidate in self._taken:
            candidate = f"{name}{suffix}{number if number > 1 else ''}"
            number += 1
        self._taken.add(candidate)
        return candidate


__all__ = [
    "GENERATED_TYPES",
    "GLOBAL_FUNCTIONS",
    "Scope",
    "code_name",
    "identifier",
    "namespace",
    "python_identifier",
    "type_name",
]
