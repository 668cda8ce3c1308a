"""Names only: what a protocol's names are called in C, where all of them share one scope."""

from __future__ import annotations

from wirebond.protocol.names import code_name, protocol_fault

# Headers of C and POSIX: a generated one of the same name would be found in their place.
# fmt: off
SYSTEM_HEADERS = frozenset({
    "aio", "assert", "complex", "ctype", "dirent", "dlfcn", "endian", "err", "errno", "fcntl", "features", "fenv",
    "float", "glob", "grp", "iconv", "inttypes", "limits", "locale", "malloc", "math", "memory", "netdb", "poll",
    "pthread", "pty", "pwd", "regex", "sched", "search", "semaphore", "setjmp", "signal", "spawn", "stdalign",
    "stdarg", "stdatomic", "stdbool", "stddef", "stdint", "stdio", "stdlib", "stdnoreturn", "string", "strings",
    "syslog", "tar", "termios", "tgmath", "threads", "time", "uchar", "ulimit", "unistd", "utime", "wchar", "wctype",
})
# fmt: on

# Words of C that are none of C++, so that a protocol file may use them.
C_KEYWORDS = frozenset({"restrict"})  # beside those of `names.identifier`
# Macros of C's own headers (complex.h, stdnoreturn.h) that are none in C++.
C_MACROS = frozenset({"complex", "imaginary", "noreturn"})
# Types of members. A member of the same name would hide its type in C++, which reads the header, too.
C_TYPES = frozenset({"size_t", *(f"{sign}int{bits}_t" for sign in ("", "u") for bits in (8, 16, 32, 64))})


def header_name(protocol: str) -> str:
    """Return the name of the C header and of the .cpp next to it, without the ending."""
    return protocol + "_protocol" if protocol in SYSTEM_HEADERS else protocol


def link_name(protocol: str) -> str:
    """Return the same for the link's header and source."""
    return protocol + "_link"


def member_name(name: str) -> str:
    """Return a member of a struct, from what it is called in C++."""
    return name + "_" if name in C_KEYWORDS | C_MACROS | C_TYPES else name


class Names:
    """Hands out identifiers that begin with the protocol's name, each once: one that is taken gets a number."""

    def __init__(self, protocol: str) -> None:
        assert not protocol_fault(protocol)
        self._prefix = protocol
        self._taken: set[str] = set()
        self._tags: set[str] = set()  # of the types' structs

    def claim(self, *words: str, suffix: str = "") -> str:
        """Claim a name: ``claim("velocity", suffix="_t")`` is ``diffdrive_velocity_t``, unless that is taken.

        The struct of a type has the type's name without ``_t``; it may not be another type's name.
        """
        base = "_".join((self._prefix, *map(code_name, words)))
        candidate, number = base, 1
        while not self._is_free(candidate, suffix):
            number += 1
            candidate = f"{base}_{number}"
        self._taken.add(candidate + suffix)
        if suffix:
            self._tags.add(candidate)
        return candidate + suffix

    def _is_free(self, candidate: str, suffix: str) -> bool:
        name = candidate + suffix
        if name in self._taken or name in self._tags:
            return False
        return not suffix or not (candidate.endswith("_t") and candidate in self._taken)

    def prefix_of(self, *words: str) -> str:
        """Return the prefix of the constants that ``words`` groups."""
        return "_".join((self._prefix, *map(code_name, words))).upper()

    def constant(self, *words: str) -> str:
        """Claim a constant's name: ``constant("velocity", "id")`` is ``DIFFDRIVE_VELOCITY_ID``, unless that is
        taken."""
        base = self.prefix_of(*words)
        candidate, number = base, 1
        while candidate in self._taken:
            number += 1
            candidate = f"{base}_{number}"
        self._taken.add(candidate)
        return candidate
