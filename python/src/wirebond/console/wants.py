"""What a client of ``/views`` wants to see: its messages, checked. No socket."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from wirebond.errors import UsageError

MOST_PLOTS = 32
MOST_FIELDS = 64  # in all plots together
MOST_FRAMES = 500
MOST_PIXELS = 12_000  # of one plot: three wide screens, so that a hand that moves the range finds the lines there
_TIME = Annotated[float, msgspec.Meta(ge=-1e12, le=1e12)]


class Messages(msgspec.Struct):
    """The table of messages."""

    every: Annotated[float, msgspec.Meta(ge=0.05, le=60)] = 0.1


class Frames(msgspec.Struct):
    """The newest frames; ``message`` None: of all messages."""

    message: str | None = None
    discards: bool = True
    most: Annotated[int, msgspec.Meta(ge=1, le=MOST_FRAMES)] = 50


class Plot(msgspec.Struct):
    """Either the newest ``seconds``, or what lies between ``from`` and ``to``."""

    id: str
    fields: tuple[str, ...] = ()
    seconds: Annotated[float, msgspec.Meta(gt=0, le=1e8)] | None = None
    begin: _TIME | None = msgspec.field(default=None, name="from")
    to: _TIME | None = None
    pixels: Annotated[int, msgspec.Meta(ge=10, le=MOST_PIXELS)] = 800


class OfRecording(msgspec.Struct):
    """A recording in the place of the live link."""

    recording: str


class Views(msgspec.Struct):
    """All that a client wants now."""

    link: bool = False
    messages: Messages | None = None
    frames: Frames | None = None
    events: bool = False
    marks: bool = False
    plots: tuple[Plot, ...] = ()
    source: Literal["live"] | OfRecording = "live"
    at: _TIME | None = None


class Said(msgspec.Struct):
    """One message of a client."""

    views: Views | None = None
    token: str = ""
    acks: bool | None = None  # it tells by ``seen`` which rounds it has drawn
    seen: int | None = None


_decode = msgspec.json.Decoder(Said).decode


def read(text: str | bytes) -> Said:
    """A message of a client.

    :raises UsageError: it is none, with a sentence.
    """
    try:
        said = _decode(text)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise UsageError(f"this says not what to show: {error}; see docs/console-api.md") from None
    if said.views is not None:
        _check(said.views)
    return said


def _check(views: Views) -> None:
    if len(views.plots) > MOST_PLOTS or sum(len(plot.fields) for plot in views.plots) > MOST_FIELDS:
        raise UsageError(f"there are more than {MOST_PLOTS} plots, or more than {MOST_FIELDS} fields in them")
    if len({plot.id for plot in views.plots}) != len(views.plots):
        raise UsageError("two plots have one id; give each its own")
    for plot in views.plots:
        if plot.seconds is None and (plot.begin is None or plot.to is None or not plot.begin < plot.to):
            raise UsageError(f"the plot {plot.id!r:.40} needs `seconds`, or `from` before `to`")
        if plot.seconds is not None and views.source != "live":
            raise UsageError(f"the plot {plot.id!r:.40} is of a recording; give `from` and `to`")
