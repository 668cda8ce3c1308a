"""The accounts of a link: the outcome of every frame that was offered, and of every received byte."""

from __future__ import annotations

from dataclasses import dataclass, field

from wirebond.codec import Stats


@dataclass(frozen=True)
class SendStats:
    """Count the frames of each outcome. Exact at any time:

    ``offered == accepted + refused_down + refused_full + refused_stopped``
    ``accepted == sent + queued + replaced + expired + overruled + aborted``

    Repeated values, safe values and stops are offered each time that they are due.
    """

    offered: int
    accepted: int
    refused_down: int  #: the port was away, or the link closed
    refused_full: int  #: the queue was full
    refused_stopped: int  #: an emergency stop held the message
    sent: int  #: handed to the port whole
    sent_bytes: int
    queued: int  #: waiting now, or under way
    replaced: int  #: a repeated value, a stop or one of `queue: latest`, by the next one of its message
    expired: int  #: the port went away, or it waited longer than the file's ``max_age``
    overruled: int  #: waited when a stop, a safe value or ``stop_repeating`` dropped it
    aborted: int  #: the port went away in its middle
    messages: dict[str, int] = field(
        default_factory=dict
    )  #: of ``sent``, by message; those that never left are not here


@dataclass(frozen=True)
class LinkStats:
    """The accounts of a link: ``receive`` closes as a decoder's does, ``send`` by its two sums."""

    receive: Stats
    send: SendStats
    dropped_messages: int  #: came in, were not taken by the program, and made room for newer ones
    late: int  #: as old as the shortest of their deadlines at the host: not given to the program
    held_back: int  #: one of their deadlines with ``recover: explicit`` had struck: not given to the program
    reconnects: int  #: times that the port came back
    echoed_bytes: int  #: own bytes that came back, where the file says ``echo: true``; not in ``receive``
    collisions: int  #: frames that did not come back as they were sent, where the file says ``echo: true``
    handler_errors: int = 0  #: times that a handler raised
