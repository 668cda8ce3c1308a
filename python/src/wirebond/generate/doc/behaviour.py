"""The chapters on time and behaviour: schedule, line budget, deadlines, emergency stop, services."""

from __future__ import annotations

from wirebond.analysis.check.line_budget import budgets, scheduled_loads
from wirebond.analysis.check.wording import count, direction, percent, rate, seconds
from wirebond.generate.doc.examples import values_line
from wirebond.generate.doc.table import table
from wirebond.protocol.meaning.messages import spoken
from wirebond.protocol.model import Deadline, GivenMessage, Mismatch, Parity, Protocol, Recover, Start

_RECOVERIES = {
    Recover.NEXT_MESSAGE: "with the next such message",
    Recover.EXPLICIT: "by an explicit call of the program",
}
_SERVICES = {
    "hello": "each end says which protocol it was built from",
    "ping": "the reply carries the request's number back: round trip time",
    "clock": "the MCU's clock against the host's",
    "log": "lines of text from the MCU",
    "parameter": "values on the MCU, read and set by index",
    "counters": "how much the MCU's link received, refused and sent",
}


_ECHO = (
    "One end sends at a time, and hears its own bytes. It drops them. A frame that comes back altered has collided, "
    "and is counted.",
    "",
)


def line_chapter(protocol: Protocol) -> list[str]:
    link = protocol.link
    parity = {Parity.NONE: "no parity", Parity.EVEN: "even parity", Parity.ODD: "odd parity"}[link.parity]
    carried = "in both directions together" if link.echo else "in each direction"
    stop = f"{link.stop_bits:g} stop bit{'s' * (link.stop_bits != 1)}"
    return [
        "## Line",
        "",
        f"{count(link.baud)} baud, {link.data_bits} data bits, {parity}, {stop}: {link.bits_per_byte:g} bits a byte, "
        f"{count(link.baud / link.bits_per_byte)} bytes/s {carried}. The longest frame has "
        f"{protocol.max_wire_bytes()} bytes and takes "
        f"{seconds(protocol.max_wire_bytes() * link.bits_per_byte / link.baud)}.",
        "",
        *(_ECHO if link.echo else ()),
        *(_mismatch(protocol)),
    ]


def _mismatch(protocol: Protocol) -> list[str]:
    if protocol.service("hello") is None:
        return []
    if protocol.link.on_mismatch == Mismatch.ACT:
        return ["The MCU also acts on commands of a host whose hello says another protocol hash.", ""]
    return [
        "The MCU holds back the commands of a host whose hello says another protocol hash, but for the emergency stop.",
        "",
    ]


def schedule_chapter(protocol: Protocol) -> list[str]:
    loads = scheduled_loads(protocol)
    if not loads:
        return []
    lines = ["## Schedule", ""]
    rows = []
    for budget in budgets(protocol, loads):
        for load in budget.loads:
            share = percent(load.byte_rate / budget.capacity)
            rows.append(
                (direction(budget.sender), load.name, rate(load.frames), str(load.bytes), count(load.byte_rate), share)
            )
        if budget.loads:
            total = sum(load.byte_rate for load in budget.loads)
            rows.append(
                (direction(budget.sender), "**together**", "", "", count(total), f"**{percent(budget.share)}**")
            )
    lines += table(("direction", "message", ">frames", ">bytes, at most", ">bytes/s", ">of the line"), rows)
    return [*lines, "", "Replies are counted as often as their scheduled requests.", ""]


def deadlines_chapter(protocol: Protocol) -> list[str]:
    lines: list[str] = []
    if protocol.deadlines:
        rows = [(d.message, spoken(d.at), seconds(d.after), d.then, _ending(d)) for d in protocol.deadlines]
        lines += ["## Deadlines", "", "They run from start-up on, before the first message has come.", ""]
        lines += [*table(("message stays away", "at the", ">for", "then", "ends"), rows), ""]
        for held in (d for d in protocol.deadlines if d.start == Start.HELD):
            lines += [f"From the MCU's start on {held.message} is held back, until {held.then} is ended.", ""]
    stops = [_given(stop) for stop in protocol.emergency_stop]
    if len(stops) == 1:
        lines += ["## Emergency stop", "", f"The message {stops[0]}.", ""]
    elif stops:
        lines += ["## Emergency stop", "", "These messages, in this order:", ""]
        lines += [*(f"{i}. {stop}" for i, stop in enumerate(stops, 1)), ""]
    return lines


def _ending(deadline: Deadline) -> str:
    by = deadline.recover_by
    return _RECOVERIES[deadline.recover] if by is None else f"by the message {_given(by)}"


def _given(message: GivenMessage) -> str:
    values, header = values_line(message.fields), values_line(dict(message.header))
    return f"{message.message}{' with ' + values if values else ''}{', its header with ' + header if header else ''}"


def services_chapter(protocol: Protocol) -> list[str]:
    if not protocol.services:
        return []
    rows = [
        (
            service.name,
            _SERVICES.get(service.name, ""),
            ", ".join(message if role == "message" else f"{role}: {message}" for role, message in service.messages),
        )
        for service in protocol.services
    ]
    return ["## Services", "", *table(("service", "for", "messages"), rows), ""]
