"""The causes that a diagnosis can find, in words."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Kind(StrEnum):
    SHARED_PORT = "shared_port"
    SILENCE = "silence"
    BAUD = "baud"
    PARITY = "parity"
    ECHO = "echo"
    NO_ECHO = "no_echo"
    COLLISIONS = "collisions"
    TWO_WRITERS = "two_writers"
    RESETS = "resets"
    LOST_READS = "lost_reads"
    CHECK = "check"
    FORMAT = "format"
    UNKNOWN = "unknown"  # something is wrong, and nothing above explains it


@dataclass(frozen=True)
class Diagnosis:
    """A cause that the bytes support.

    :ivar kind: which, for programs.
    :ivar sentence: what is wrong.
    :ivar evidence: what speaks for it, in figures.
    :ivar remedy: what to do.
    """

    kind: Kind
    sentence: str
    evidence: str
    remedy: str

    def as_dict(self) -> dict[str, str]:
        """Return it as a dictionary for JSON.

        :returns: the attributes by name.
        """
        return {**vars(self), "kind": str(self.kind)}

    def __str__(self) -> str:
        return f"{self.sentence} ({self.evidence}). {self.remedy}"
