"""Two frame formats: everything around the parts, and the parts one by one, judged by the forms that they make."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from difflib import SequenceMatcher
from typing import Any

from wirebond.analysis.diff.addresses import miscounts, misses, strangers
from wirebond.analysis.diff.change import Change, Effect, Sides, changed, harmless
from wirebond.protocol.model import End, FrameFormat, MatchOf, Part, PartKind, PayloadRule, Protocol
from wirebond.protocol.model.forms import header_fields
from wirebond.protocol.plan import Form, Plan
from wirebond.protocol.planning import plan_for
from wirebond.protocol.spelling import bytes_text, part_text

_FRAME: tuple[str | int, ...] = ("frame",)


def frame_changes(old: Protocol, new: Protocol, routes: list[Sides]) -> Iterator[Change]:
    yield from _around(old.format, new.format, routes)
    yield from _parts(old, new, routes)


# ---- around the parts


def _around(old: FrameFormat, new: FrameFormat, routes: list[Sides]) -> Iterator[Change]:
    """Compare delimiters, stuffing and silence, then how a receiver finds frames."""
    envelopes = [(f.delimiter, f.opening, f.stuffing, f.escapes, f.insertion, f.ends_by_silence) for f in (old, new)]
    if envelopes[0] != envelopes[1]:
        effects = []
        for sides in routes:
            sent, read = (plan_for(side, sides.flow.sender) for side in (sides.sender, sides.receiver))
            if _envelope(sent) != _envelope(read):
                effects.append(Effect(sides.flow, True, f"the {sides.receiving} finds no frame"))
        yield changed("frame", f"{_envelope_text(old)} became {_envelope_text(new)}", effects, place=_FRAME)
    if old.deliver_unknown != new.deliver_unknown:
        words = ["deliver" if f.deliver_unknown else "reject" for f in (old, new)]
        yield harmless("unknown", f"{words[0]} became {words[1]}", place=("unknown",))
    if old.max_payload != new.max_payload:
        yield harmless("max_payload", f"{old.max_payload} became {new.max_payload}", place=("max_payload",))
    if old.is_strict != new.is_strict:
        words = ["strict" if f.is_strict else "rescan" for f in (old, new)]
        yield harmless("resync", f"{words[0]} became {words[1]}", place=("resync",))


def _envelope(plan: Plan) -> tuple[object, ...]:
    """Return the parts that must be equal. A receiver does not need the delimiter before a frame if it is equal to the
    one after it."""
    stuffing = plan.stuffing, plan.escapes, plan.insertion, plan.length_on_wire
    return plan.framing, plan.opening, plan.closing, *stuffing, plan.plain_front, plan.plain_back


def _envelope_text(frame_format: FrameFormat) -> str:
    if frame_format.ends_by_silence:
        return "frames that end by silence"
    stuffing = "" if frame_format.stuffing == "none" else f", stuffed by {frame_format.stuffing}"
    if frame_format.escapes is not None:
        stuffing += f" {frame_format.escapes.escape:#04x}"
    if frame_format.insertion is not None:
        rule = frame_format.insertion
        stuffing += f" of {rule.byte:#04x} behind {bytes_text(rule.after)}"
    if frame_format.delimiter is None:
        return f"frames without delimiters{stuffing}"
    opening = "" if frame_format.opening is None else f"{bytes_text(frame_format.opening)} … "
    return f"frames in {opening}{bytes_text(frame_format.delimiter)}{stuffing}"


# ---- the parts


@dataclass(frozen=True)
class _Step:
    """A difference between the lists of parts: ``old[a:b]`` became ``new[c:d]``."""

    a: int
    b: int
    c: int
    d: int


def _parts(old: Protocol, new: Protocol, routes: list[Sides]) -> Iterator[Change]:
    before, after = old.format.parts, new.format.parts
    if before == after:
        return
    texts = [[_identity(parts, i) for i in range(len(parts))] for parts in (before, after)]
    matcher = SequenceMatcher(None, texts[0], texts[1], autojunk=False)
    changed_parts = [_Step(*bounds) for tag, *bounds in matcher.get_opcodes() if tag != "equal"]
    steps = [step for whole_step in changed_parts for step in _single(before, after, whole_step)]
    whole = {sides.flow: _breaks(sides.sender, sides.receiver, sides.flow.sender) for sides in routes}
    others = {s.flow: "" if whole[s.flow] else _loses_others(s.sender, s.receiver, s.flow.sender) for s in routes}
    told: set[object] = set()
    for step in steps:
        only = _with_step(old, new, step)
        effects = []
        for sides in routes:
            sent, read = (only, old) if sides.flow.from_new else (old, only)
            fault = "its frames differ" if only is None else _breaks(sent or old, read or old, sides.flow.sender)
            if fault and whole[sides.flow]:
                told.add(sides.flow)
                effects.append(Effect(sides.flow, True, whole[sides.flow]))
                continue
            if others[sides.flow] and (only is None or _loses_others(sent or old, read or old, sides.flow.sender)):
                told.add(sides.flow)
                effects.append(Effect(sides.flow, not sides.flow.from_new, others[sides.flow]))  # additions can wait
            if miscounts(sides) and (only is None or miscounts(_with(sides, only))):
                effects.append(Effect(sides.flow, False, miscounts(sides)))
        place = ("frame", step.c if step.d > step.c else step.a)
        sentence = _step_text(before, after, step)
        yield changed("frame", sentence, effects, place=place, gone=step.c == step.d)
    left = [Effect(flow, True, fault) for flow, fault in whole.items() if fault and flow not in told]
    left += [Effect(flow, not flow.from_new, fault) for flow, fault in others.items() if fault and flow not in told]
    if left:  # each part by itself does no harm
        yield changed("frame", "its parts together make other frames", left, place=_FRAME)


def _with(sides: Sides, only: Protocol) -> Sides:
    """Return the same direction with a new file that has only this one difference."""
    return replace(sides, new=only)


def _identity(parts: tuple[Part, ...], index: int) -> str:
    part = parts[index]
    return f"{part.name}: {part_text(parts, index)} {part.is_plain} {part.order if part.size > 1 else ''}"


def _single(before: tuple[Part, ...], after: tuple[Part, ...], step: _Step) -> list[_Step]:
    """Compare part by part if their number is the same. A check among shared bits stays with their part."""
    count = step.b - step.a
    has_runs = any(part.in_bits is not None for part in (*before[step.a : step.b], *after[step.c : step.d]))
    if count != step.d - step.c or has_runs:
        return [step]
    return [_Step(step.a + i, step.a + i + 1, step.c + i, step.c + i + 1) for i in range(count)]


def _step_text(before: tuple[Part, ...], after: tuple[Part, ...], step: _Step) -> str:
    gone = ", ".join(f"`{part_text(before, i)}`" for i in range(step.a, step.b) if before[i].in_bits is None)
    came = ", ".join(f"`{part_text(after, i)}`" for i in range(step.c, step.d) if after[i].in_bits is None)
    if gone == came:
        names = [parts[i].name for parts, i in ((before, step.a), (after, step.c))]
        return (
            f"{came}: name {names[0]} became {names[1]}" if names[0] != names[1] else f"{came} has another byte order"
        )
    if not gone:
        return f"{came} is new"
    return f"{gone} became {came}" if came else f"{gone} is gone"


def _with_step(old: Protocol, new: Protocol, step: _Step) -> Protocol | None:
    """Return the old protocol with this one difference; None if that is not a frame: the bytes that a check covers, the
    start of a frame, or the part that identifies a message would be missing."""
    before, after = old.format.parts, new.format.parts
    named = [
        *((part, before) for part in before[: step.a]),
        *((part, after) for part in after[step.c : step.d]),
        *((part, before) for part in before[step.b :]),
    ]
    places: dict[str, int] = {part.name: index for index, (part, _) in enumerate(named)}
    renamed = {before[step.a].name: after[step.c].name} if step.b - step.a == step.d - step.c == 1 else {}
    parts = []
    for part, owner in named:
        if part.kind != PartKind.CHECK:
            parts.append(part)
            continue
        names = [owner[index].name for ends in part.ranges for index in ends]
        ends = [places.get(renamed.get(name, name) if owner is before else name, -1) for name in names]
        if min(ends) < 0:
            return None
        parts.append(replace(part, ranges=tuple(zip(ends[::2], ends[1::2], strict=True))))
    if sum(part.kind == PartKind.PAYLOAD for part in parts) != 1:
        return None
    made = replace(old.format, parts=tuple(parts))
    if made.is_sized and made.parts[0].kind != PartKind.MAGIC:  # otherwise nothing marks where a stuffed frame begins
        return None
    fields = {field.name for field in header_fields(made.parts)}
    if any(m.of == MatchOf.HEADER and m.name not in fields for message in old.messages for m in message.match):
        return None
    return replace(old, format=made)


def _breaks(sent: Protocol, read: Protocol, sender: End) -> str:
    """Return why a receiver refuses or ignores a sender's default frames; empty if it accepts them."""
    sending, reading = plan_for(sent, sender), plan_for(read, sender)
    taken = [_shape(form, reading) for form in reading.forms]
    own = [_shape(form, sending) for form in _sent_forms(sending)]
    missing = [shape for shape in own if shape not in taken]
    if not missing:
        return misses(sent, read, sender) or strangers(sent, read, sender)
    if len(missing) < len(own):
        return "some of its frames are not found, or their parts are read at other places"
    return "its frames are not found, or their parts are read at other places"


def _loses_others(sent: Protocol, read: Protocol, sender: End) -> str:
    """Return why a receiver refuses a sender's frames with other header values than the defaults."""
    sending, reading = plan_for(sent, sender), plan_for(read, sender)
    taken = [_shape(form, reading) for form in reading.forms]
    lost = any(_shape(form, sending) not in taken for form in sending.forms)
    return "its frames with other header values than the defaults are not found, or are read at other places" * lost


def _sent_forms(plan: Plan) -> list[Form]:
    """Return the forms of sent frames, unless header values ask for another: for each message the first that carries
    it."""
    own = plan.forms[: plan.own_forms]
    sizes = {size for row in plan.messages for size in (row.min_payload, row.max_payload)}
    chosen = [
        next((form for form in own if form.trims_zeros or form.carries(_padded(form, size))), None) for size in sizes
    ]
    return [form for form in own if form in chosen]


def _padded(form: Form, size: int) -> int:
    return form.fixed_payload if form.payload == PayloadRule.FIXED else size


def _shape(form: Form, plan: Plan) -> dict[str, Any]:
    """Return the facts on which both ends must agree: not the names and values of header fields."""
    shape: dict[str, Any] = asdict(form)
    del shape["header"]
    for rule in shape["checks"]:
        rule["algorithm"] = replace(plan.algorithms[rule["algorithm"]], name="")
        del rule["continues"]
    return shape
