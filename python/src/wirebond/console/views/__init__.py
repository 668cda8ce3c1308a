"""The views for a client of ``/views``, apart from plots: one file each. Values only; no socket."""

from typing import Any

from wirebond.console.views.events import EventsView
from wirebond.console.views.frames import FramesView
from wirebond.console.views.link import LinkView
from wirebond.console.views.marks import MarksView
from wirebond.console.views.messages import MessagesView
from wirebond.console.views.view import Scene, View

__all__ = ["VIEWS", "Scene", "View"]

# One entry for each view, in the order in which a round has them. The name is its key in a client's request, and the
# answer's `view`.
VIEWS: dict[str, type[View[Any]]] = {
    "link": LinkView,
    "messages": MessagesView,
    "frames": FramesView,
    "events": EventsView,
    "marks": MarksView,
}
