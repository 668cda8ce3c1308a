"""The marks on a line of time: events, bytes in no frame, deadlines at the MCU; each once."""

from __future__ import annotations

from typing import Any

from wirebond.console.views.view import Scene, SourceView
from wirebond.recording.history.source import Source


class MarksView(SourceView[bool]):
    _known: tuple[int, int] | None = None  # the newest event and the newest other mark that were sent

    def look(self, source: Source, _: Scene) -> dict[str, Any] | None:
        known = self._known
        newest = source.happenings.newest, source.marks.newest
        if known == newest:
            return None
        self._known = newest
        events, others = known or (0, 0)
        found = [*source.happenings.since(events), *source.marks.since(others)]
        return {"replace": known is None, "marks": sorted(found, key=lambda mark: mark["t"])}
