"""The parts of a link, for packages above this one, such as the server. Programs use ``Link``."""

from __future__ import annotations

from dataclasses import dataclass

from wirebond.link.engine import Engine
from wirebond.link.frame_maker import FrameMaker
from wirebond.link.frame_sender import FrameSender
from wirebond.link.inbox import Inbox
from wirebond.link.owner import LinkServices


@dataclass(frozen=True)
class LinkInternals:
    """None of the parts keeps its link alive.

    :ivar engine: moves the frames.
    :ivar frames: makes them.
    :ivar sender: hands them to the engine.
    :ivar inbox: routes the received messages.
    :ivar services: hello, clock and log lines.
    :ivar actions: of the deadlines at this end, as the engine numbers them.
    """

    engine: Engine
    frames: FrameMaker
    sender: FrameSender
    inbox: Inbox
    services: LinkServices
    actions: list[str]
