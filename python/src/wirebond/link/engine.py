"""The seam below a `Link`: the operations of an engine, which the native, the Python and the attached one have.

Message indices are those of the protocol; an address is a number as on the wire; times are microseconds of
``time.monotonic()`` unless a name says otherwise. Any thread may call any method.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Protocol

from wirebond.codec import Message
from wirebond.errors import WirebondError
from wirebond.link.engine_settings import SafeValue

SENT, DOWN, FULL, STOPPED = range(4)  # answers to `send` and `repeat`

RawPiece = tuple[str, int, int, bytes]  # kind, start and end of a read, bytes


class Engine(Protocol):
    """A supervised port, or the connection to a server that has one."""

    # ---- sending

    def send(self, message: int, frame: bytes, reply: int, takes_number: bool, address: int, /) -> int:
        """Queue one frame. Returns `SENT`, or the reason for its refusal."""

    def send_all(self, frames: list[tuple[int, bytes]], /) -> list[int] | list[int | WirebondError]:
        """Queue frames without reply or address. Returns one answer for each, as `send` does, or an error."""

    def repeat(self, message: int, frame: bytes, hold: float, reply: int, takes_number: bool, address: int, /) -> int:
        """Begin or renew a lease of ``hold`` seconds. Returns as `send` does."""

    def stop_repeating(self, message: int, address: int | None, /) -> None:
        """End the lease of this address, or of all addresses, without a last value."""

    def end_safely(self, message: int, address: int, /) -> bool:
        """End this lease with its safe value, which leaves first. False: there is none."""

    def end_if_moved(self, message: int, address: int, /) -> bool:
        """Do as `end_safely`, unless the safe value was the last one sent."""

    def hand_over(self) -> None:
        """Send no safe value at the end for anything sent so far."""

    def note_safe(self, safe: SafeValue, /) -> bool:
        """Add a safe value to those of the settings. False: the table is full."""

    def stop(self) -> bool:
        """Latch the emergency stop. False: the link has ended, and nothing was sent."""

    def is_stopped(self) -> bool:
        """Return whether the emergency stop is latched."""

    def set_address(self, address: int, /) -> None:
        """Set the own address."""

    def listen_to_all(self, all: bool, /) -> None:
        """Deliver frames for other addresses too, or stop doing so."""

    # ---- receiving

    def receive(self, timeout: float, /) -> Iterable[Message]:
        """Take the messages since the last call; wait up to ``timeout`` seconds for the first, or for a change."""

    def attend(self, timeout: float, /) -> Iterable[Message]:
        """Do as `receive`, for the one thread that always takes; only `recall` ends its wait early."""

    def recall(self) -> None:
        """End the wait of the current or the next `attend`."""

    def wait_unattended(self, timeout: float, /) -> None:
        """Wait until something can be taken and no thread is in `attend`, or the link has ended."""

    def changes(self) -> Iterable[tuple[str, int, int]]:
        """Take what has changed since the last call."""

    def set_stamper(self, stamper: Callable[[Message], tuple[float, float] | None] | None, /) -> None:
        """Set the source of stamps for messages that are taken from now on."""

    # ---- supervision

    def state(self) -> str:
        """Return ``up``, ``stale`` or ``down``."""

    def why(self) -> str:
        """Return why the port is away; empty while it is there."""

    def line(self) -> dict[str, Any] | None:
        """Return the driver's line settings; None: there are none, or the port was never open."""

    def stats(self) -> dict[str, Any]:
        """Return both accounts, as the fields of ``wirebond.LinkStats``."""

    def struck_deadlines(self) -> list[int]:
        """Return the indices of the actions that have struck and not ended."""

    def recover_deadline(self, action: int, /) -> None:
        """End a deadline with ``recover: explicit``."""

    # ---- recording

    def recent(self) -> tuple[list[tuple[str, int, bytes]], int]:
        """Return the last pieces with their kinds and times, and the number of older bytes that were dropped."""

    def open_tap(self, capacity: int, /) -> int:
        """Begin to keep every read, write and event, up to ``capacity`` bytes. Returns the tap's number."""

    def take_tap(self, tap: int, /) -> tuple[list[RawPiece], int, int, int]:
        """Take what the tap holds, with the pieces and bytes of each direction that it had to drop."""

    def close_tap(self, tap: int, /) -> None:
        """Stop keeping."""

    def note(self, text: str, /) -> None:
        """Put an event of the program into every tap."""

    # ---- the end

    def is_closed(self) -> bool:
        """Return whether it was closed. Raises `LinkDownError` in a forked child."""

    def begin_close(self) -> None:
        """End every lease and accept nothing more. Does not wait."""

    def close(self) -> None:
        """End every lease, let queued frames leave (a second at most), and give the port back."""

    def after_fork(self) -> None:
        """Forget the link in a forked child; it belongs to the parent."""
