"""The MCU's link as C: what its handlers, functions and macros are called, and the sizes that suit the line."""

from __future__ import annotations

from dataclasses import dataclass

from wirebond.generate.code.c_header import handlers_with_header, names_receiver
from wirebond.generate.code.c_names import Names
from wirebond.generate.code.c_struct import MessageView
from wirebond.generate.code.cpp_header import address_type, fields_of
from wirebond.protocol.model import End, Protocol
from wirebond.protocol.names import code_name
from wirebond.protocol.planning import plan_for

# The least frequent polls that the default receive ring is meant for: a slow loop as far as this many bytes do, and at
# any baud rate one that keeps up with fast lines.
_SLOW_POLL_SECONDS = 0.020
_SLOW_POLL_BYTES = 512
_POLL_SECONDS = 0.005
_FUNCTIONS = (
    "open", "poll", "poll_ms", "log", "recover", "struck", "on_received", "on_transmitted", "on_error", "on_pended",
    "state", "peer", "why", "stop", "start", "next_due_us",
    "counters", "send_account", "receive_account", "account", "violations",
)  # fmt: skip
_ADDRESS_FUNCTIONS = ("set_address", "address", "listen_to_all", "addressee")


@dataclass(frozen=True)
class LinkView:
    type_name: str
    handlers_type: str
    guard: str
    functions: dict[str, str]
    macros: dict[str, str]
    default_bytes: dict[str, int]  # of the rings
    poll_ms: int  # the default receive ring holds twice the bytes of that time
    received: tuple[MessageView, ...]
    scheduled: tuple[MessageView, ...]
    sent: tuple[tuple[MessageView, str], ...]  # with its function
    sent_with_header: tuple[tuple[MessageView, str], ...]  # the same; empty where frames have no header field
    max_sent: int  # bytes of the largest frame on the wire
    actions: tuple[tuple[str, str], ...]  # with its handler
    services: frozenset[str]
    counters: str  # the message that the link fills by itself; empty: none
    listens: bool  # do received frames say for whom they are?


def link_view(protocol: Protocol, names: Names, messages: list[MessageView]) -> LinkView:
    """Return the view of the link. ``names`` has given names to ``<protocol>.h`` before: one file includes both
    headers."""
    mine = [message for message in protocol.messages if message.sent_by(End.MCU)]
    scheduled = {message.name for message in mine if message.every is not None}
    sent = [view for view in messages if view.sender in (End.MCU, End.BOTH)]
    received = tuple(view for view in messages if view.sender in (End.HOST, End.BOTH))
    max_sent = max((protocol.max_wire_bytes(message.max_payload) for message in mine), default=1)
    has_header = bool(fields_of(protocol))
    more = (
        *(("header",) if has_header else ()),
        *(_ADDRESS_FUNCTIONS if address_type(protocol) else ()),
        *(("sequence",) if plan_for(protocol, End.HOST).sequence is not None else ()),
    )
    bytes_per_second = protocol.link.baud / protocol.link.bits_per_byte
    receive_bytes = _power_of_two(
        max(
            64,
            2 * protocol.max_wire_bytes(sender=End.HOST),
            2 * _POLL_SECONDS * bytes_per_second,
            min(2 * _SLOW_POLL_SECONDS * bytes_per_second, _SLOW_POLL_BYTES),
        )
    )
    return LinkView(
        type_name=names.claim("link", suffix="_t"),
        handlers_type=names.claim("link", "handlers", suffix="_t"),
        guard=f"WIREBOND_GENERATED_{protocol.name.upper()}_LINK_H",
        functions={verb: names.claim("link", verb) for verb in (*_FUNCTIONS, *more)},
        macros={
            word: names.constant("link", word)
            for word in ("count", "receive_bytes", "send_bytes", "send_frames", "dma_memory")
        },
        default_bytes={
            "receive": receive_bytes,
            "send": _power_of_two(max(256, 4 * max_sent)),
        },
        received=received,
        scheduled=tuple(view for view in sent if view.name in scheduled),
        sent=tuple((view, names.claim("send", view.name)) for view in sent),
        sent_with_header=tuple(
            (view, names.claim("send", view.name, "with_header")) for view in (sent if has_header else [])
        ),
        poll_ms=int(500 * receive_bytes / bytes_per_second),
        max_sent=max_sent,
        actions=_actions(
            protocol,
            {f"on_{code_name(view.name)}" for view in received}
            | ({*handlers_with_header("on", [m.name for m in protocol.messages]).values()} if has_header else set()),
        ),
        services=frozenset(service.name for service in protocol.services),
        counters=next(
            (service.message("message") or "" for service in protocol.services if service.name == "counters"), ""
        ),
        listens=names_receiver(protocol, End.HOST),
    )


def _actions(protocol: Protocol, taken: set[str]) -> tuple[tuple[str, str], ...]:
    """Return each action of the MCU with its handler, whose name differs from all messages'."""
    found: dict[str, str] = {}
    for action in dict.fromkeys(d.then for d in protocol.deadlines if d.at in (End.MCU, End.BOTH)):
        handler, number = f"on_{code_name(action)}", 1
        while handler in taken:
            number += 1
            handler = f"on_{code_name(action)}_{number}"
        taken.add(handler)
        found[action] = handler
    return tuple(found.items())


def _power_of_two(least: float) -> int:
    return 1 << (int(least) - 1).bit_length()
