"""The base of a view: what a client may ask to see, and what it then lacks. No socket."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

from wirebond.console.station import Station
from wirebond.recording.history.source import Source

W = TypeVar("W")


@dataclass(frozen=True)
class Scene:
    """The state that all views of one client use in one round.

    :ivar now: monotonic, in seconds.
    :ivar source: the link's history or a recording's; None: there is neither.
    :ivar shown: the time that is shown, on the source's clock.
    :ivar at: the same if a recording is shown; None: the newest is shown.
    """

    now: float
    station: Station
    source: Source | None
    shown: float
    at: float | None


class View(ABC, Generic[W]):
    """A view of one client, from its request until the client changes or ends it. One thread at a time."""

    wish: ClassVar[Any] = bool  # the type of a client's wish; false and null: it does not want the view

    def __init__(self, wish: W) -> None:
        self.wanted = wish
        self._next = 0.0

    @abstractmethod
    def round(self, scene: Scene) -> dict[str, Any] | None:
        """Return what the client lacks now; None: nothing."""

    def moved(self) -> None:
        """Note that another time of the recording is shown from now on."""

    def _is_due(self, now: float, every: float) -> bool:
        """Check whether it is time, at most once in ``every`` seconds."""
        if now < self._next:
            return False
        self._next = now + every
        return True


class SourceView(View[W]):
    """A view of a source; without one it shows nothing."""

    def moved(self) -> None:
        self._next = 0.0

    def round(self, scene: Scene) -> dict[str, Any] | None:
        return None if scene.source is None else self.look(scene.source, scene)

    @abstractmethod
    def look(self, source: Source, scene: Scene) -> dict[str, Any] | None:
        """Return what the client lacks now; None: nothing."""
