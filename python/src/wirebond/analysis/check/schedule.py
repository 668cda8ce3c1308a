"""Schedules and deadlines that do not go together, and what nobody would miss."""

from __future__ import annotations

from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.fixed_end import is_fixed
from wirebond.analysis.check.places import Places
from wirebond.analysis.check.wording import seconds
from wirebond.protocol.controlled import is_controlled
from wirebond.protocol.model import End, Field, Message, Protocol

_LOST_FRAMES = 2  # periods within a deadline: one lost frame must not trip it


def period_of(protocol: Protocol, name: str) -> float | None:
    """Return the period of a message: its own `every`, or that of the request that it answers."""
    periods = [m.every for m in protocol.messages if m.every is not None and name in (m.name, m.reply)]
    return min(periods, default=None)


def assess_deadlines(protocol: Protocol, places: Places) -> list[Finding]:
    found = _fed_by_own_end(protocol, places)
    unscheduled: set[str] = set()
    for index, deadline in enumerate(protocol.deadlines):
        period = period_of(protocol, deadline.message)
        if period is None:
            if deadline.message in unscheduled:
                continue
            unscheduled.add(deadline.message)
            place = places.at("deadlines", index, "message")
            found.append(
                Finding(
                    "unscheduled-deadline",
                    Severity.NOTE,
                    f"`{deadline.message}` has a deadline of {seconds(deadline.after)} and no schedule",
                    "nothing says how often it is to be sent, so neither tools nor the other end can keep it alive",
                    f"write in `{deadline.message}` how often the device sends it, as its manual says: `every: ...`"
                    if _sender_is_fixed(protocol, deadline.message)
                    else f"write `every: {seconds(deadline.after / 5)}` in `{deadline.message}`",
                    place.line,
                    place.column,
                )
            )
        elif deadline.after < _LOST_FRAMES * period:
            place = places.at("deadlines", index, "after")
            found.append(
                Finding(
                    "tight-deadline",
                    Severity.WARNING,
                    f"the deadline of `{deadline.message}` ({seconds(deadline.after)}) is "
                    f"{deadline.after / period:.2g} times its period ({seconds(period)})",
                    f"one lost frame and a little delay are taken for silence, and `{deadline.then}` is done",
                    f"write `after: {seconds(3 * period)}` or more"
                    + ("" if _sender_is_fixed(protocol, deadline.message) else ", or send it more often"),
                    place.line,
                    place.column,
                )
            )
    return found


def _fed_by_own_end(protocol: Protocol, places: Places) -> list[Finding]:
    """Find deadlines on messages that the watching end sends, too. With ``echo: true`` a link drops its own frames."""
    found = []
    both = {message.name for message in protocol.messages if message.sender == End.BOTH}
    for index, deadline in enumerate(protocol.deadlines):
        if deadline.message not in both or protocol.link.echo or _sender_is_fixed(protocol, deadline.message):
            continue
        place = places.at("deadlines", index, "message")
        found.append(
            Finding(
                "deadline-on-both",
                Severity.WARNING,
                f"`{deadline.message}` has a deadline at the {_end_word(deadline.at)}, which sends "
                f"`{deadline.message}` as well",
                f"if TX touches RX, or a transceiver hears itself, the frames of the {_end_word(deadline.at)} come "
                f"back to it; unless its link recognises each of them, `{deadline.then}` does not act although no "
                "other end is there",
                f"let each end send a message of its own: `sender: {_other(deadline.at).value}` for the one with the "
                "deadline",
                place.line,
                place.column,
            )
        )
    return found


def _end_word(end: End) -> str:
    return "MCU" if end == End.MCU else "host"


def _other(end: End) -> End:
    return End.HOST if end == End.MCU else End.MCU


def assess_safety(protocol: Protocol, places: Places) -> list[Finding]:
    """Assess the host's commands: is their silence noticed, and is there a stop?"""
    commands = [message for message in protocol.messages if _is_command(protocol, message)]
    if not commands or is_fixed(protocol, End.HOST):
        return []
    found = []
    names = ", ".join(f"`{message.name}`" for message in commands[:4]) + (" …" if len(commands) > 4 else "")
    watched = {deadline.message for deadline in protocol.deadlines if deadline.at == End.MCU}
    if not watched & {message.name for message in commands}:
        place = places.at("messages", commands[0].name)
        found.append(
            Finding(
                "no-deadline",
                Severity.NOTE,
                f"no deadline watches the host's commands ({names})",
                "when the cable is pulled or the program hangs, the MCU goes on with the last command",
                "look in the device's manual for its reaction; if it stops after some time, write that as a deadline "
                "`at: mcu`, so that `wirebond sim` stops as well"
                if is_fixed(protocol, End.MCU)
                else f"add `deadlines: [{{message: {commands[0].name}, at: mcu, after: 200 ms, then: stop}}]`",
                place.line,
                place.column,
            )
        )
    if not protocol.emergency_stop:
        place = places.at("messages")
        found.append(
            Finding(
                "no-emergency-stop",
                Severity.NOTE,
                f"the host commands something ({names}) and the file has no `emergency_stop`",
                "tools and `link.emergency_stop()` do not know how to stop this robot",
                "add `emergency_stop:` with the message and the values that stop it",
                place.line,
                place.column,
            )
        )
    found += _outside_the_stop(protocol, commands, places)
    return found


def _outside_the_stop(protocol: Protocol, commands: list[Message], places: Places) -> list[Finding]:
    """Find commands with a physical quantity that every program may send, even during the emergency stop."""
    free = [m for m in commands if not is_controlled(protocol, m) and _has_unit(m.fields)]
    if not free or not protocol.emergency_stop:
        return []
    many = len(free) > 1
    names = ", ".join(f"`{message.name}`" for message in free[:4]) + (" …" if len(free) > 4 else "")
    place = places.at("messages", free[0].name)
    return [
        Finding(
            "outside-the-stop",
            Severity.NOTE,
            f"the emergency stop does not hold back {names}, and any program may send {'them' if many else 'it'}",
            "without an `every`, a deadline at the MCU or an entry in `emergency_stop`, a message counts as one that "
            "moves nothing",
            f"if {'one' if many else 'it'} moves something, list it under `emergency_stop` with its safe values",
            place.line,
            place.column,
        )
    ]


def _has_unit(fields: tuple[Field, ...]) -> bool:
    return any(field.unit or _has_unit(field.fields) for field in fields)


def _sender_is_fixed(protocol: Protocol, name: str) -> bool:
    sender = protocol.message(name).sender
    return is_fixed(protocol, End.HOST if sender == End.HOST else End.MCU)


def _is_command(protocol: Protocol, message: Message) -> bool:
    """Check whether the host sends it with values, without asking for a reply, and not as a service."""
    of_services = {name for service in protocol.services for _, name in service.messages}
    return (
        message.sender == End.HOST
        and bool(message.fields)
        and message.reply is None
        and message.name not in of_services
    )
