"""Makes the rounds for one client of ``/views``: only what it wants, and only what is new. No socket."""

from __future__ import annotations

import time
from typing import Any

import msgspec

from wirebond.as_json import encode
from wirebond.chinese import with_chinese
from wirebond.console.library import Library, Replay
from wirebond.console.plots import PlotFeed
from wirebond.console.station import Station
from wirebond.console.views import VIEWS, Scene, View
from wirebond.console.wants import OfRecording, Plot, Views
from wirebond.errors import UsageError, WirebondError
from wirebond.recording.history.source import Source

ROUND_EVERY = 1 / 30  # seconds: a client gets no more rounds


class Viewer:
    """One thread at a time."""

    def __init__(self, station: Station, library: Library) -> None:
        self._station = station
        self._library = library
        self._wants = Views()
        self._replay: Replay | None = None
        self._of: object = None  # the source that was shown last
        self._views: dict[str, View[Any]] = {}
        self._plots: dict[str, PlotFeed] = {}
        self._out: list[str | bytes] = []

    def want(self, views: Views) -> None:
        """Set the client's wish."""
        before, self._wants = self._wants, views
        if views.source != before.source:
            self._choose(views)
        seen, self._views = self._views, {}
        for name, wish in views.wishes.items():
            is_same = name in seen and seen[name].wanted == wish
            self._views[name] = seen[name] if is_same else VIEWS[name](wish)
        if views.at != before.at:
            for view in self._views.values():
                view.moved()
        before_plots = {plot.id: plot for plot in before.plots}
        feeds, self._plots = self._plots, {}
        for plot in views.plots:
            is_same = plot.id in feeds and before_plots.get(plot.id) == plot
            self._plots[plot.id] = feeds[plot.id] if is_same else self._feed(plot)

    def round(self) -> list[str | bytes]:
        """Return the messages that the client lacks now, in order."""
        wants, now = self._wants, time.monotonic()
        source = self._source()
        if source is not self._of:
            self._of = source
            self._forget()
        shown = now if self._replay is None else (wants.at if wants.at is not None else self._replay.duration)
        scene = Scene(now, self._station, source, shown, None if self._replay is None else shown)
        for name, view in self._views.items():
            told = view.round(scene)
            if told is not None:
                self._tell({"view": name, **told})
        if source is not None:
            for feed in self._plots.values():
                self._plot(feed, source, now)
        return self._taken()

    def _plot(self, feed: PlotFeed, source: Source, now: float) -> None:
        batch = feed.batch(source.history, now)
        if batch is not None:
            self._out.append(batch)

    def _feed(self, plot: Plot) -> PlotFeed:
        """Return the feed of a plot for its known fields; the others are reported."""
        source = self._source()
        known = []
        for name in plot.fields:
            if source is None:
                break
            try:
                source.history.find(name)
                known.append(name)
            except UsageError as error:
                self._tell_error("field", str(error))
        return PlotFeed(msgspec.structs.replace(plot, fields=tuple(known)))

    # ---- inside

    def _source(self) -> Source | None:
        if self._replay is not None:
            return self._replay.source
        if self._wants.source != "live":
            return None  # it could not be opened
        served = self._station.served
        return None if served is None else served.source

    def _choose(self, views: Views) -> None:
        self._replay = None
        if not isinstance(views.source, OfRecording):
            return
        try:
            self._replay = replay = self._library.open(views.source.recording)
        except (WirebondError, OSError) as error:
            self._tell_error("recording", str(error))
            return
        told = {
            "view": "recording",
            "name": replay.name,
            "from": 0.0,
            "to": replay.duration,
            "problems": replay.problems,
        }
        self._tell(with_chinese(told, "problems"))

    def _forget(self) -> None:
        """Forget the sent state: another source is entirely new."""
        self._plots = {plot.id: self._feed(plot) for plot in self._wants.plots}
        self._views = {name: VIEWS[name](view.wanted) for name, view in self._views.items()}

    def _tell_error(self, error: str, text: str) -> None:
        self._tell(with_chinese({"view": "error", "error": error, "text": text}, "text"))

    def _tell(self, value: dict[str, Any]) -> None:
        self._out.append(encode(value).decode())

    def _taken(self) -> list[str | bytes]:
        out, self._out = self._out, []
        return out
