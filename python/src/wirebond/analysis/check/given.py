"""Messages that the file gives with their values: a host can send them, and an MCU finds their frames."""

from __future__ import annotations

from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.places import Places
from wirebond.codec import Codec
from wirebond.errors import MessageError
from wirebond.protocol.model import End, GivenMessage

RULE = "given-values"


def assess(codec: Codec, places: Places) -> list[Finding]:
    model = codec.model
    given: list[tuple[GivenMessage, str, tuple[str | int, ...]]] = [
        (stop, "the emergency stop", ("emergency_stop", index)) for index, stop in enumerate(model.emergency_stop)
    ]
    given += [
        (rule.recover_by, "`recover_by`", ("deadlines", index, "recover_by"))
        for index, rule in enumerate(model.deadlines)
        if rule.recover_by is not None
    ]
    found = []
    for message, what, steps in given:
        why = _refused(codec, message)
        if why:
            place = places.at(*steps)
            found.append(
                Finding(
                    RULE,
                    Severity.ERROR,
                    f"{what} cannot be sent: {why}",
                    "the stop would never reach the MCU"
                    if what == "the emergency stop"
                    else "nothing would end that deadline",
                    f"correct the values of `{message.message}` there",
                    place.line,
                    place.column,
                )
            )
    return found


def _refused(codec: Codec, given: GivenMessage) -> str:
    """Return why no receiver gets this message; empty if one does."""
    try:
        frame = codec.encode(given.message, given.fields, header=dict(given.header), sender=End.HOST)
    except MessageError as error:
        return str(error)
    decoder = codec.decoder(End.HOST)
    decoder.expect(codec.tables.request_for(given.message))
    names = [message.name for message in (*decoder.feed(frame), *decoder.finish())]
    return "" if names == [given.message] else f"a receiver finds {', '.join(names) or 'no message'} in its frame"
