"""The messages of two protocols: which came and went, and what a receiver makes of frames that it knows otherwise."""

from __future__ import annotations

from collections.abc import Iterator

from wirebond.analysis.diff.change import Change, Effect, Sides, carries, changed, end_name, harmless
from wirebond.analysis.diff.fields import field_changes, zeros_or_ignored
from wirebond.analysis.diff.where import Where
from wirebond.protocol.decimals import decimal_text
from wirebond.protocol.matching import covers, id_key, overlap, told_by
from wirebond.protocol.model import End, Field, Message, Part, PartKind, PayloadRule, Protocol
from wirebond.protocol.spelling import match_text, match_texts


def message_changes(old: Protocol, new: Protocol, routes: list[Sides]) -> Iterator[Change]:
    before, after = {m.name: m for m in old.messages}, {m.name: m for m in new.messages}
    renamed = _renamed(before, after)
    for name, message in after.items():
        if name in before:
            yield from _pair(before[name], message, routes)
        elif name in renamed:
            was = before[renamed[name]]
            sentence = f"was called {was.name}; its id and its fields stayed"
            yield changed(name, sentence, place=("messages", name))
            yield from _pair(was, message, routes)
        else:
            yield _new(message, routes, [m for m in old.messages if m.name not in renamed.values()])
    for name, message in before.items():
        if name not in after and name not in renamed.values():
            yield _gone(message, routes)


def _renamed(before: dict[str, Message], after: dict[str, Message]) -> dict[str, str]:
    """Return the old name by the new one, if id, sender and payload are the same."""
    found: dict[str, str] = {}
    for name, message in after.items():
        if name in before:
            continue
        for was in before.values():
            same = (told_by(was), was.has_id, was.sender, was.seed) == (
                told_by(message),
                message.has_id,
                message.sender,
                message.seed,
            )
            if was.name not in after and was.name not in found.values() and same and _alike(was.fields, message.fields):
                found[name] = was.name
                break
    return found


def _alike(one: tuple[Field, ...], other: tuple[Field, ...]) -> bool:
    """Check whether the layout is the same, whatever the names."""
    return [_layout(f) for f in one] == [_layout(f) for f in other]


def _layout(field: Field) -> tuple[object, ...]:
    inner = tuple(_layout(f) for f in field.fields)
    return (
        field.kind,
        field.coding,
        field.width,
        field.order,
        field.count,
        field.max_count,
        field.max_size,
        field.scale,
        inner,
    )


# ---- messages that only one file has


def _new(message: Message, routes: list[Sides], before: list[Message]) -> Change:
    effects = []
    for sides in routes:
        if not carries(sides, message):
            continue
        taken = [
            m.name
            for m in before
            if overlap(m, message) is not None and carries(sides, m) and m.name not in _names(sides.new)
        ]
        if taken:
            way = (message.name, taken[0]) if sides.flow.from_new else (taken[0], message.name)
            effects.append(Effect(sides.flow, True, f"{way[0]} is taken for {way[1]}"))
        elif sides.flow.from_new:
            effects.append(Effect(sides.flow, False, _unknown(sides, message)))
        elif message.every is not None or _deadline(sides.receiver, message.name, sides.flow.receiver):
            effects.append(Effect(sides.flow, _deadline(sides.receiver, message.name, sides.flow.receiver),
                                  f"the {sides.sending} never sends it" + _strikes(sides, message.name)))  # fmt: skip
    return changed(message.name, f"is new, from the {_senders(message)}", effects, place=("messages", message.name))


def _gone(message: Message, routes: list[Sides]) -> Change:
    effects = []
    for sides in routes:
        if not carries(sides, message):
            continue
        if sides.flow.from_new:
            sentence = f"the {sides.sending} never sends it" + _strikes(sides, message.name)
        else:
            sentence = _unknown(sides, message)
        effects.append(Effect(sides.flow, True, sentence))
    return changed(message.name, "is gone", effects, place=("messages", message.name), gone=True)


def _names(protocol: Protocol) -> set[str]:
    return {m.name for m in protocol.messages}


def _senders(message: Message) -> str:
    return "host and the MCU" if message.sender == End.BOTH else end_name(message.sender)


def _deadline(protocol: Protocol, name: str, at: End) -> bool:
    return any(d.message == name and d.at == at for d in protocol.deadlines)


def _strikes(sides: Sides, name: str) -> str:
    then = [d.then for d in sides.receiver.deadlines if d.message == name and d.at == sides.flow.receiver]
    return f", and its deadline strikes there ({', '.join(dict.fromkeys(then))})" if then else ""


def _unknown(sides: Sides, message: Message) -> str:
    """Describe the receiver's reaction to a message with an unknown id."""
    receiver = sides.receiver.format
    if not receiver.deliver_unknown:
        return f"the {sides.receiving} discards its frames as unknown_message, and looks through their bytes"
    most = receiver.max_payload_from(sides.flow.sender)
    if message.max_payload > most:
        return f"the {sides.receiving} discards its frames: they are longer than its max_payload, {most}"
    return f"the {sides.receiving} delivers it as unknown"


# ---- messages that both files have


def _pair(old: Message, new: Message, routes: list[Sides]) -> Iterator[Change]:
    place: tuple[str | int, ...] = ("messages", new.name)
    both = tuple(s for s in routes if carries(s, old) and carries(s, new))
    if old.sender != new.sender:
        yield _other_sender(old, new, routes)
    if (told_by(old), old.has_id) != (told_by(new), new.has_id):
        was, now = (_identity(m) for m in (old, new))
        sentence = f"{was} became {now.removeprefix('id ') if old.has_id else now}"
        effects = [Effect(s.flow, True, _other_id(s, old, new)) for s in both if not _still_it(s, old, new)]
        key = "id" if (id_key(old), old.ids) != (id_key(new), new.ids) else "match"
        yield changed(new.name, sentence, effects, place=(*place, key))
    if old.seed != new.seed:
        effects = [Effect(s.flow, True, "its check never fits") for s in both]
        yield changed(new.name, f"seed {old.seed} became {new.seed}", effects, place=(*place, "seed"))
    if old.reply != new.reply:
        yield _other_reply(old, new, routes)
    if old.every != new.every:
        yield _other_rate(old, new, both)
    tail = _Tail(old, new)
    yield from field_changes(old.fields, new.fields, Where(new.name, place, both, tail))
    for key, one, other in (
        ("queue", old.queue.value, new.queue.value),
        ("log", old.log, new.log),
        ("level", old.log_level.value, new.log_level.value),
    ):
        if one != other:
            yield harmless(new.name, f"{key} {one or 'none'} became {other or 'none'}", place=(*place, key))
    if old.description != new.description:
        yield harmless(new.name, "has another description", place=(*place, "description"))


def _other_sender(old: Message, new: Message, routes: list[Sides]) -> Change:
    effects = []
    for sides in routes:
        before, after = old.sent_by(sides.flow.sender), new.sent_by(sides.flow.sender)
        if before == after:
            continue
        knows_more = sides.flow.from_new == after
        if knows_more:
            effects.append(Effect(sides.flow, not after, _unknown(sides, old if before else new)))
        else:
            strikes = _strikes(sides, new.name)
            sentence = f"the {sides.sending} never sends it{strikes}"
            effects.append(Effect(sides.flow, before or bool(strikes), sentence))
    sentence = f"sender {old.sender} became {new.sender}"
    return changed(new.name, sentence, effects, place=("messages", new.name, "sender"))


def _identity(message: Message) -> str:
    """Return the identity of its frames: ``id 0x01``, ``id 0x80..0xff with kind 1``."""
    if message.ids is not None:
        number = f"id {match_text(message.ids).replace('0x', '#').lower().replace('#', '0x')}"
    else:
        number = f"id {message.id:#04x}" if message.has_id else "no id"
    texts = match_texts(message)
    return f"{number} with {' and '.join(texts)}" if texts else number


def _still_it(sides: Sides, old: Message, new: Message) -> bool:
    """Return whether the receiver still takes every frame of the sender for the message."""
    sent, read = (new, old) if sides.flow.from_new else (old, new)
    return covers(read, sent)


def _other_id(sides: Sides, old: Message, new: Message) -> str:
    sent = new if sides.flow.from_new else old
    read = old if sides.flow.from_new else new
    meant = [m.name for m in sides.receiver.messages if covers(m, sent) and carries(sides, m)]
    if meant:
        return f"it is taken for {meant[0]}"
    some = "" if overlap(read, sent) is None else "of some of its frames: "
    return some + _unknown(sides, sent)


def _other_reply(old: Message, new: Message, routes: list[Sides]) -> Change:
    effects = []
    for sides in routes:
        asked = new if sides.flow.from_new else old
        known = old if sides.flow.from_new else new
        if carries(sides, new) and asked.reply is not None:
            answer = f"the {sides.receiving} answers with {known.reply}" if known.reply else "it is not answered"
            effects.append(Effect(sides.flow, not sides.flow.from_new or known.reply is not None,
                                  f"the {sides.sending} waits for {asked.reply}; {answer}"))  # fmt: skip
    sentence = f"reply {old.reply or 'none'} became {new.reply or 'none'}"
    return changed(new.name, sentence, effects, place=("messages", new.name, "reply"))


def _other_rate(old: Message, new: Message, routes: tuple[Sides, ...]) -> Change:
    place = ("messages", new.name, "every")
    sentence = f"every {period(old.every)} became {period(new.every)}"
    effects = too_slow(new.name, routes)
    return changed(new.name, sentence, effects, place=place) if effects else harmless(new.name, sentence, place=place)


def too_slow(name: str, routes: tuple[Sides, ...]) -> list[Effect]:
    """Return the effects if a receiver's deadline is shorter than its sender's period."""
    effects = []
    for sides in routes:
        sent = next((m for m in sides.sender.messages if m.name == name), None)
        for deadline in sides.receiver.deadlines:
            ours = deadline.message == name and deadline.at == sides.flow.receiver
            if sent is not None and ours and sent.every is not None and sent.every >= deadline.after:
                effects.append(
                    Effect(
                        sides.flow,
                        True,
                        f"it comes every {period(sent.every)}, and the deadline of the {sides.receiving} strikes after "
                        f"{period(deadline.after)} ({deadline.then})",
                    )
                )
    return effects


def period(seconds: float | None) -> str:
    if seconds is None:
        return "none"
    return f"{decimal_text(seconds, 6)} s" if seconds >= 1 else f"{decimal_text(seconds * 1000, 6)} ms"


# ---- payloads that end sooner or later than the receiver's


class _Tail:
    """The receiver's reaction to a payload of another size, by how its frame gives the size."""

    def __init__(self, old: Message, new: Message) -> None:
        self._old = old
        self._new = new

    def __call__(self, sides: Sides, name: str) -> Effect:
        sent, read = (self._new, self._old) if sides.flow.from_new else (self._old, self._new)
        is_new = self._new.max_payload > self._old.max_payload
        payload = _payload(sides.receiver)
        receiver = sides.receiver.format
        if payload.payload == PayloadRule.FIXED:
            return zeros_or_ignored(sides, name, is_new=is_new)
        if payload.payload == PayloadRule.BY_ID:
            return Effect(sides.flow, True, f"the {sides.receiving} expects frames of another size")
        if sent.min_payload < read.min_payload:
            if payload.trims_zeros:
                return zeros_or_ignored(sides, name, is_new=is_new)
            refused = "delivers it as unknown: it is too short" if receiver.deliver_unknown else "discards its frames"
            return Effect(sides.flow, True, f"the {sides.receiving} {refused}")
        if sent.max_payload > receiver.max_payload_from(sides.flow.sender):
            return Effect(
                sides.flow, True, f"the {sides.receiving} discards its frames: they are longer than its max_payload"
            )
        if sent.max_payload > read.max_payload or (is_new and sides.flow.from_new):
            if any(field.reaches_end for field in read.fields):
                last = next(field.name for field in read.fields if field.reaches_end)
                return Effect(sides.flow, True, f"the {sides.receiving} takes {name} for a part of {last}")
            if not receiver.deliver_unknown:
                return Effect(sides.flow, True, f"the {sides.receiving} discards its frames: they are too long for it")
            return Effect(sides.flow, False, f"the {sides.receiving} ignores {name}")
        return Effect(sides.flow, False, f"the {sides.receiving} reads it without {name}")


def _payload(protocol: Protocol) -> Part:
    found = protocol.format.part(PartKind.PAYLOAD)
    assert found is not None
    return found
