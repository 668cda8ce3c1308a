"""Compares two files apart from frames and messages: the line, deadlines, the stop, services, texts."""

from __future__ import annotations

from collections.abc import Iterator

from wirebond.analysis.diff.change import Change, Effect, Sides, carries, changed, harmless
from wirebond.analysis.diff.messages import period, too_slow
from wirebond.protocol.model import Deadline, End, Protocol, Service


def behaviour_changes(old: Protocol, new: Protocol, routes: list[Sides]) -> Iterator[Change]:
    if old.name != new.name:
        yield harmless("protocol", f"{old.name} became {new.name}: generated code has other names", place=("protocol",))
    if old.description != new.description:
        yield harmless("protocol", "has another description", place=("description",))
    yield from _line(old, new, routes)
    yield from _silence(old, new, routes)
    yield from _deadlines(old, new, routes)
    yield from _stop(old, new, routes)
    yield from _services(old, new, routes)
    if old.fixed != new.fixed:
        ends = [p.fixed.value if p.fixed else "none" for p in (old, new)]
        yield harmless("fixed", f"{ends[0]} became {ends[1]}", place=("fixed",))
    if old.examples != new.examples:
        yield harmless("examples", "have changed", place=("examples",))


def _line(old: Protocol, new: Protocol, routes: list[Sides]) -> Iterator[Change]:
    before, after = old.link, new.link
    for key in ("baud", "data_bits", "parity"):
        one, other = getattr(before, key), getattr(after, key)
        if one != other:
            effects = [Effect(s.flow, True, "the bytes are read as others") for s in routes]
            yield changed("link", f"{key} {one} became {other}", effects, place=("link", key))
    if before.stop_bits != after.stop_bits:
        effects = [
            Effect(s.flow, True, f"the {s.receiving} waits for a longer stop bit, and sees framing errors")
            for s in routes
            if s.sender.link.stop_bits < s.receiver.link.stop_bits
        ]
        sentence = f"stop_bits {before.stop_bits:g} became {after.stop_bits:g}"
        yield changed("link", sentence, effects, place=("link", "stop_bits"))
    if before.echo != after.echo:
        words = {False: "an end does not hear its own bytes", True: "an end hears its own bytes"}
        yield harmless("link", f"{words[before.echo]} became: {words[after.echo]}", place=("link", "echo"))
    if before.on_mismatch != after.on_mismatch:
        sentence = f"on_mismatch {before.on_mismatch} became {after.on_mismatch}"
        yield harmless("link", sentence, place=("link", "on_mismatch"))
    for key in ("max_run", "max_age"):
        one, other = getattr(before, key), getattr(after, key)
        if one != other:
            yield harmless("link", f"{key} {period(one)} became {period(other)}", place=("link", key))


def _silence(old: Protocol, new: Protocol, routes: list[Sides]) -> Iterator[Change]:
    if not (old.format.ends_by_silence and new.format.ends_by_silence):
        if old.idle != new.idle:
            yield harmless("idle", f"{period(old.idle)} became {period(new.idle)}", place=("idle",))
    elif old.idle != new.idle:
        effects = [
            Effect(s.flow, True, f"the {s.receiving} takes two frames with a shorter pause for one")
            for s in routes
            if s.sender.idle_seconds < s.receiver.idle_seconds
        ]
        sentence = f"silence {period(old.idle)} became {period(new.idle)}"
        yield changed("frame", sentence, effects, place=("frame",))


def _stop(old: Protocol, new: Protocol, routes: list[Sides]) -> Iterator[Change]:
    """Yield the changes of the stop, which cannot wait until both ends know it."""
    if old.emergency_stop == new.emergency_stop:
        return
    effects = []
    for sides in routes:
        if sides.flow.sender != End.HOST:
            continue
        known = {m.id if m.has_id else m.name for m in sides.receiver.messages if carries(sides, m)}
        for stop in sides.sender.emergency_stop:
            message = sides.sender.message(stop.message)
            if (message.id if message.has_id else message.name) not in known:
                effects.append(
                    Effect(sides.flow, True, f"the {sides.receiving} does not know {stop.message}, and moves on")
                )
    if effects:
        yield changed("emergency_stop", "has other messages", effects, place=("emergency_stop",))
    else:
        yield harmless("emergency_stop", "has other messages, values or header fields", place=("emergency_stop",))


def _deadlines(old: Protocol, new: Protocol, routes: list[Sides]) -> Iterator[Change]:
    before, after = {_key(d): d for d in old.deadlines}, {_key(d): d for d in new.deadlines}
    for index, deadline in enumerate(new.deadlines):
        was = before.get(_key(deadline))
        if was == deadline:
            continue
        if was is None:
            sentence = f"is new at the {deadline.at}, after {period(deadline.after)}: {deadline.then}"
        elif was.after != deadline.after:
            sentence = f"after {period(was.after)} became {period(deadline.after)}"
        elif was.recover != deadline.recover:
            sentence = f"recover {was.recover} became {deadline.recover}"
        elif was.start != deadline.start:
            sentence = f"start {was.start} became {deadline.start}"
        else:
            sentence = "is ended by another message, or by other values (recover_by)"
        effects = _strikes(deadline, routes)
        what, place = f"deadline of {deadline.message}", ("deadlines", index)
        yield changed(what, sentence, effects, place=place) if effects else harmless(what, sentence, place=place)
    for index, deadline in enumerate(old.deadlines):
        if _key(deadline) not in after:
            what, sentence = f"deadline of {deadline.message}", f"is gone from the {deadline.at}: {deadline.then}"
            yield Change(what, sentence, harmless(what, "").verdict, (), ("deadlines", index), is_gone=True)


def _key(deadline: Deadline) -> tuple[str, End, str]:
    return deadline.message, deadline.at, deadline.then


def _strikes(deadline: Deadline, routes: list[Sides]) -> list[Effect]:
    """Return the effects if the sender's period is longer than this deadline of the new file."""
    here = tuple(s for s in routes if not s.flow.from_new and s.flow.receiver == deadline.at)
    both = tuple(s for s in here if any(m.name == deadline.message and carries(s, m) for m in s.sender.messages))
    return too_slow(deadline.message, both)


def _services(old: Protocol, new: Protocol, routes: list[Sides]) -> Iterator[Change]:
    before, after = {s.name: s for s in old.services}, {s.name: s for s in new.services}
    for name, service in after.items():
        was = before.get(name)
        if was == service:
            continue
        place = ("services", name)
        if was is None:
            effects = _unserved(service, routes, from_new=True)
            yield changed(f"service {name}", "is new", effects, place=place)
        else:
            effects = [Effect(s.flow, True, f"the {s.receiving} knows {name} by other messages") for s in routes]
            yield changed(f"service {name}", "has other messages", effects, place=place)
    for name, service in before.items():
        if name not in after:
            effects = _unserved(service, routes, from_new=False)
            yield changed(f"service {name}", "is gone", effects, place=("services", name), gone=True)


def _unserved(service: Service, routes: list[Sides], *, from_new: bool) -> list[Effect]:
    """Return the effects of a service that only the sender has."""
    return [
        Effect(s.flow, not from_new, f"the {s.receiving} does nothing with {service.name}")
        for s in routes
        if s.flow.from_new == from_new
        and any(carries(s, m) for m in s.sender.messages if m.name in dict(service.messages).values())
    ]
