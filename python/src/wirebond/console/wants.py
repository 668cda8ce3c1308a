"""Checks the messages in which a client of ``/views`` says what it wants to see. No socket."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import msgspec

from wirebond.console.views import VIEWS
from wirebond.errors import UsageError

MOST_PLOTS = 32
MOST_FIELDS = 64  # in all plots together
MOST_PIXELS = 12_000  # of one plot: three wide screens, so that a hand that moves the range finds the lines there
_TIME = Annotated[float, msgspec.Meta(ge=-1e12, le=1e12)]


class Plot(msgspec.Struct):
    """Either the newest ``seconds``, or the range between ``from`` and ``to``."""

    id: str
    fields: tuple[str, ...] = ()
    seconds: Annotated[float, msgspec.Meta(gt=0, le=1e8)] | None = None
    begin: _TIME | None = msgspec.field(default=None, name="from")
    to: _TIME | None = None
    pixels: Annotated[int, msgspec.Meta(ge=10, le=MOST_PIXELS)] = 800


class OfRecording(msgspec.Struct):
    """A recording instead of the live link."""

    recording: str


class _Shown(msgspec.Struct):
    """The views that the client wants."""

    plots: tuple[Plot, ...] = ()
    source: Literal["live"] | OfRecording = "live"
    at: _TIME | None = None


class _Message(msgspec.Struct):
    """A message of a client."""

    views: dict[str, Any] | None = None
    token: str = ""
    acks: bool | None = None  # it acknowledges by ``seen`` the rounds it has drawn
    seen: int | None = None


@dataclass(frozen=True)
class Views:
    """The views that a client wants now.

    :ivar wishes: of each view of `VIEWS` that it wants, what it wants of it.
    """

    wishes: dict[str, Any] = field(default_factory=dict)
    plots: tuple[Plot, ...] = ()
    source: Literal["live"] | OfRecording = "live"
    at: float | None = None


@dataclass(frozen=True)
class Said:
    """A message of a client, checked."""

    views: Views | None
    token: str
    acks: bool | None
    seen: int | None


_decode = msgspec.json.Decoder(_Message).decode


def read(text: str | bytes) -> Said:
    """Return a message of a client.

    :raises UsageError: it is invalid; the sentence says why.
    """
    try:
        said = _decode(text)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise _not_understood("", error) from None
    views = None if said.views is None else _views(said.views)
    return Said(views, said.token, said.acks, said.seen)


def _views(asked: dict[str, Any]) -> Views:
    unknown = asked.keys() - {*VIEWS, *_Shown.__struct_fields__}
    if unknown:
        raise UsageError(f"there is no view {min(unknown)!r:.40}; possible: {', '.join(VIEWS)}, plots")
    wishes = {}
    where = ""
    try:
        shown = msgspec.convert(asked, _Shown)
        for name, view in VIEWS.items():
            where = f" of `{name}`"
            wishes[name] = msgspec.convert(asked.get(name), view.wish | None)
    except msgspec.MsgspecError as error:
        raise _not_understood(where, error) from None
    views = Views({name: wish for name, wish in wishes.items() if wish}, shown.plots, shown.source, shown.at)
    _check(views)
    return views


def _not_understood(where: str, error: Exception) -> UsageError:
    return UsageError(f"this does not name the data to show{where}: {error}; see docs/console-api.md")


def _check(views: Views) -> None:
    if len(views.plots) > MOST_PLOTS or sum(len(plot.fields) for plot in views.plots) > MOST_FIELDS:
        raise UsageError(f"there are more than {MOST_PLOTS} plots, or more than {MOST_FIELDS} fields in them")
    if len({plot.id for plot in views.plots}) != len(views.plots):
        raise UsageError("two plots have the same id; give each its own")
    for plot in views.plots:
        if plot.seconds is None and (plot.begin is None or plot.to is None or not plot.begin < plot.to):
            raise UsageError(f"the plot {plot.id!r:.40} needs `seconds`, or `from` before `to`")
        if plot.seconds is not None and views.source != "live":
            raise UsageError(f"the plot {plot.id!r:.40} is of a recording; give `from` and `to`")
