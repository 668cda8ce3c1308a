"""Names only: what a protocol's names are called in C, where all of them share one scope."""

from __future__ import annotations

from wirebond.protocol.names import fault

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
C_KEYWORDS = frozenset({"restrict", "typeof", "typeof_unqual"})


def header_name(protocol: str) -> str:
    """What the C header and the .cpp beside it are called, without the ending."""
    return protocol + "_protocol" if protocol in SYSTEM_HEADERS else protocol


def link_name(protocol: str) -> str:
    """The same for the link's header and source."""
    return protocol + "_link"


def member_name(name: str) -> str:
    """A member of a struct, from what it is called in C++."""
    return name + "_" if name in C_KEYWORDS else name


class Names:
    """Hands out identifiers that begin with the protocol's name, each once: one that is taken gets a number."""

    def __init__(self, protocol: str) -> None:
        assert not fault(protocol)
        self._prefix = protocol
        self._taken: set[str] = set()

    def claim(self, *words: str, suffix: str = "") -> str:
        """``claim("velocity", suffix="_t")`` is ``diffdrive_velocity_t``, unless that is taken."""
        base = "_".join((self._prefix, *words))
        candidate, number = base + suffix, 1
        while candidate in self._taken:
            number += 1
            candidate = f"{base}_{number}{suffix}"
        self._taken.add(candidate)
        return candidate

    def prefix_of(self, *words: str) -> str:
        """What constants begin with that ``words`` group."""
        return "_".join((self._prefix, *words)).upper()

    def constant(self, *words: str) -> str:
        """``constant("velocity", "id")`` is ``DIFFDRIVE_VELOCITY_ID``, unless that is taken."""
        base = self.prefix_of(*words)
        candidate, number = base, 1
        while candidate in self._taken:
            number += 1
            candidate = f"{base}_{number}"
        self._taken.add(candidate)
        return candidate
