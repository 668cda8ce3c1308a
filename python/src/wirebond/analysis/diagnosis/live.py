"""Diagnosis while a link runs: a thread checks every few seconds, and ended faults are no longer reported."""

from __future__ import annotations

import threading
import time

from wirebond.analysis.diagnosis.finding import Diagnosis, Kind
from wirebond.analysis.diagnosis.line import diagnose
from wirebond.link import Link

_EVERY = 2.0  # seconds between two checks; one takes a second if much is wrong
_RECENT = 5.0  # seconds of the past that are checked


class LiveDiagnosis:
    """Asks by one thread at a time. Each one ends by itself, and holds the link until then."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._next = time.monotonic() + _EVERY
        self._thread: threading.Thread | None = None
        self._looked: list[Diagnosis] | None = None
        self._found: list[Diagnosis] = []
        self._was_healthy = True  # in the last check
        self._told: set[Kind] = set()

    def found(self) -> list[Diagnosis]:
        """Return the current findings. A finding stays until two examinations in a row do not find it, so that it does
        not flicker. Never waits."""
        if self._thread is not None and not self._thread.is_alive():
            self._thread = None
            self._next = time.monotonic() + _EVERY
        if self._thread is None and time.monotonic() >= self._next:
            self._thread = threading.Thread(target=self._look, name="diagnosis", daemon=True)
            self._thread.start()
        looked, self._looked = self._looked, None
        if looked is not None:
            if looked or self._was_healthy:
                self._found = looked
            self._was_healthy = not looked
        return self._found

    def changed(self) -> list[Diagnosis] | None:
        """Return the current findings if they changed since the last call; empty: none any more. None: no change. Never
        waits."""
        found = self.found()
        if (kinds := {one.kind for one in found}) == self._told:
            return None
        self._told = kinds
        return found

    def _look(self) -> None:
        self._looked = diagnose(self._link, _RECENT)
