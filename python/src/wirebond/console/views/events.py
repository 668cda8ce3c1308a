"""The events of the link, each once."""

from __future__ import annotations

from typing import Any

from wirebond.console.views.view import Scene, SourceView
from wirebond.recording.history.source import Source


class EventsView(SourceView[bool]):
    _known: int | None = None  # the number of the newest that was sent; None: none was, at this time
    _at: float | None = None

    def look(self, source: Source, scene: Scene) -> dict[str, Any] | None:
        if scene.at is not None and scene.at != self._at:
            self._at = scene.at
            self._known = None
        known, newest = self._known, source.happenings.newest
        if known == newest:
            return None
        self._known = newest
        return {"replace": known is None, "events": source.happenings.since(known or 0, scene.at)}
