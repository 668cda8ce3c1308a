"""Whom frames are for and what their numbers count, where both ends find the frames: what a change does to that."""

from __future__ import annotations

from wirebond.analysis.diff.change import Sides, end_name
from wirebond.protocol.model import Address, End, Protocol
from wirebond.protocol.plan import Form, HeaderNumber, Number, Plan
from wirebond.protocol.planning import plan_for


def misses(sent: Protocol, read: Protocol, sender: End) -> str:
    """Return why a receiver does not act on a sender's frames with its file's values, or acts on more; empty if it acts
    as intended. Addresses that a program sets at run time are not known here."""
    sending, reading = plan_for(sent, sender), plan_for(read, sender)
    receiver = end_name(End.MCU if sender == End.HOST else End.HOST)
    if reading.address is None:
        return f"the {receiver} acts on frames for every address" if sending.address is not None else ""
    own = reading.header[reading.address].default_bits(sender)
    heard = {own, *reading.broadcast}
    entry = same_number(sending, reading, reading.address)
    if entry is not None and entry.default not in heard:
        return f"its frames are for address {entry.default}, and the {receiver} listens to {own}"
    if sending.address is None or entry is None or entry.place != sending.address:
        return ""
    unheard = sorted(set(sending.broadcast) - heard)
    if unheard:
        return f"the {receiver} takes a broadcast to {unheard[0]} for a frame for another"
    if entry.default in set(reading.broadcast) - set(sending.broadcast) and _has_replies(sent):
        return f"the {receiver} takes {entry.default} for a broadcast, and does not answer"
    return ""


def strangers(sent: Protocol, read: Protocol, sender: End) -> str:
    """Return why a host ignores an MCU's replies: they come from another address than it asks."""
    if sender != End.MCU or not _has_replies(read):
        return ""
    sending, reading = plan_for(sent, sender), plan_for(read, sender)
    if reading.peer is None or reading.header[reading.peer].address != Address.MCU:
        return ""
    field = reading.header[reading.peer]
    asked = field.default_bits(End.HOST)
    entry = same_number(sending, reading, reading.peer)
    if entry is None or entry.default == asked or asked in field.broadcast_bits:
        return ""
    return f"its replies come from address {entry.default}, and the host asks {asked}"


def miscounts(sides: Sides) -> str:
    """Return what a receiver counts incorrectly by the sender's sequence numbers; every frame still arrives."""
    sending, reading = (plan_for(side, sides.flow.sender) for side in (sides.sender, sides.receiver))
    if reading.sequence is None:
        return ""
    if sending.sequence is None:
        return f"the {sides.receiving} counts repeats and gaps in numbers that are not raised there"
    if sending.sequence_per_message == reading.sequence_per_message:
        return ""
    whose = "each message" if sending.sequence_per_message else "all messages together"
    return f"the numbers count {whose}, so the {sides.receiving} counts gaps, repeats and restarts that are none"


def _has_replies(protocol: Protocol) -> bool:
    return any(message.reply for message in protocol.messages)


def same_number(sending: Plan, reading: Plan, place: int) -> HeaderNumber | None:
    """Return the sender's field where the receiver reads its field at ``place``, in the first form of each."""
    wanted = _entry(reading.forms[0], place)
    if wanted is None:
        return None
    return next((e for e in sending.forms[0].header if _where(e.number) == _where(wanted.number)), None)


def _where(number: Number) -> tuple[object, ...]:
    return number.at, number.bytes, number.shift


def _entry(form: Form, place: int) -> HeaderNumber | None:
    return next((entry for entry in form.header if entry.place == place), None)
