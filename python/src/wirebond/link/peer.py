"""The other end as its hello describes it: the file from which it was built. No thread, no port, no clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from wirebond.codec import Codec

FIRST_WAIT = 0.5  # seconds for the answer to a hello, before it is said again
LAST_WAIT = 30.0  # seconds: the wait doubles up to this
HELLO_VERSION = 1  # of the hello service itself, as core/include/wirebond/mcu/services.hpp has it
_ANSWER_TIME = 1.0  # seconds in which a hello is the answer to ours; a later one was said by the peer itself


@dataclass(frozen=True)
class Peer:
    """Whether the MCU was built from the same file, as far as it is known.

    :ivar state: ``unknown``: it has not said hello since the port was opened, or the file maps no hello; ``same``: its
        bytes have the same meaning as here; ``different``: they may have another.
    :ivar hash: its protocol hash; None: unknown.
    :ivar version: of its hello service; None: unknown.
    :ivar since: when it first said this, after the port was opened or it restarted, on ``time.monotonic()``; or None.
    :ivar why: a sentence where the state is not ``same``: what is wrong, and what to do.
    """

    state: Literal["unknown", "same", "different"]
    hash: int | None = None
    version: int | None = None
    since: float | None = None
    why: str = ""


class PeerBook:
    """Decides when to say hello, and interprets the answers. One thread at a time.

    :param codec: the protocol.
    :param whom: the other end, for sentences.
    """

    def __init__(self, codec: Codec, whom: str = "MCU") -> None:
        self._whom = whom
        self._name = codec.name
        self._hash = codec.hash
        service = codec.model.service("hello")
        self.message = None if service is None else service.message("message")
        self._asked: list[float] = []  # when; of hellos that are not answered
        self._wait = FIRST_WAIT
        self._connected = 0.0
        self._next = float("inf")  # when to say hello; it is not said without a port, nor to a peer that is known
        self.restarts = 0  # times that the peer said hello by itself after it had been known
        self.peer = self._unknown()

    def connected(self, t: float) -> None:
        """Note that the port is open, or open again: the peer is unknown from now on."""
        self.peer = self._unknown()
        self._asked.clear()
        self._connected = t
        self._wait = FIRST_WAIT
        self._next = t

    def is_due(self, t: float) -> bool:
        """Check whether hello should be sent now."""
        return self.message is not None and t >= self._next

    @property
    def due(self) -> float:
        """Return when the next hello is due."""
        return self._next if self.message is not None else float("inf")

    def asked(self, t: float) -> None:
        """Note that hello was sent, or could not be sent."""
        self._asked.append(t)
        self._next = t + self._wait
        self._wait = min(2 * self._wait, LAST_WAIT)

    def heard(self, protocol_hash: int, version: int, t: float) -> bool:
        """Note that the peer said hello.

        :returns: whether its file is another one than before, or it was not known.
        """
        if t < self._connected:
            return False  # of the device that was there before
        self._asked = [asked for asked in self._asked if t - asked < _ANSWER_TIME]
        before = self.peer
        is_answer = bool(self._asked)
        if is_answer:
            self._asked.pop(0)
        self._next = float("inf")
        if not is_answer and before.since is not None:
            self.restarts += 1
            self._next = t  # it does not know us: the MCU forgets at its start
            self._wait = FIRST_WAIT
        is_known = before.hash == protocol_hash and before.since is not None
        since = before.since if is_known and is_answer else t
        if protocol_hash == self._hash:
            self.peer = Peer("same", protocol_hash, version, since)
        else:
            self.peer = Peer("different", protocol_hash, version, since, self._difference(protocol_hash))
        return not is_known

    def _unknown(self) -> Peer:
        whom, program = self._whom, "firmware" if self._whom == "MCU" else "program"
        if self.message is None:
            return Peer(
                "unknown", why=f"{self._name} maps no `hello` service, so the {whom} cannot say which file it has"
            )
        return Peer("unknown", why=f"the {whom} has not said hello yet; check that its {program} runs")

    def _difference(self, protocol_hash: int) -> str:
        cure = "build the firmware from this file and flash it, or use the file that the firmware was built from"
        if self._whom != "MCU":
            cure = "use the file that the host uses, or give the host this one"
        return (
            f"the {self._whom} was built from another protocol file: its hash is {protocol_hash:016x}, and that of "
            f"{self._name} here is {self._hash:016x}. Messages may mean something else. Compare the two files with "
            f"`wirebond diff`; then {cure}"
        )
