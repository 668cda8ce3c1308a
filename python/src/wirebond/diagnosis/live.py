"""Diagnosis while a link runs: a thread looks every few seconds, and tells when what is wrong has changed."""

from __future__ import annotations

import threading
import time

from wirebond.diagnosis.finding import Diagnosis, Kind
from wirebond.diagnosis.line import diagnose
from wirebond.link import Link

_EVERY = 2.0  # seconds between two looks; a look takes a second where much is wrong


class LiveDiagnosis:
    """One thread asks. What it starts ends by itself, and holds the link meanwhile."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._next = time.monotonic() + _EVERY
        self._thread: threading.Thread | None = None
        self._found: list[Diagnosis] | None = None
        self._told: set[Kind] = set()

    def changed(self) -> list[Diagnosis] | None:
        """What is wrong now, where it is something else than the last time; empty: nothing any more. None: no change.
        Never waits."""
        if self._thread is not None and not self._thread.is_alive():
            self._thread = None
            self._next = time.monotonic() + _EVERY
        if self._thread is None and time.monotonic() >= self._next:
            self._thread = threading.Thread(target=self._look, name="diagnosis", daemon=True)
            self._thread.start()
        found, self._found = self._found, None
        if found is None or (kinds := {one.kind for one in found}) == self._told:
            return None
        self._told = kinds
        return found

    def _look(self) -> None:
        self._found = diagnose(self._link)
