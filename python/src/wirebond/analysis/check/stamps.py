"""Time stamps of the MCU that the host cannot read: without the clock service it does not know the MCU's clock."""

from __future__ import annotations

from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.fixed_end import is_fixed
from wirebond.analysis.check.places import Places
from wirebond.protocol.model import End, Protocol
from wirebond.protocol.stamps import stamp_of


def assess(protocol: Protocol, places: Places) -> list[Finding]:
    stamped = [(message, stamp) for message in protocol.messages if (stamp := stamp_of(message)) is not None]
    if not stamped or protocol.service("clock") is not None:
        return []
    names = ", ".join(f"`{message.name}.{stamp.name}`" for message, stamp in stamped[:4])
    place = places.at("messages", stamped[0][0].name, "fields", stamped[0][1].name)
    return [
        Finding(
            "stamp-without-clock",
            Severity.NOTE if is_fixed(protocol, End.MCU) else Severity.WARNING,
            f"the file has times of the MCU's clock ({names}) and maps no `clock` service",
            "the host cannot know the MCU's clock, so `message.stamp` is always None",
            "remove `clock` there, and compare the device's times with each other only"
            if is_fixed(protocol, End.MCU)
            else "map `clock` under `services`, as protocols/linear_axis.yaml does",
            place.line,
            place.column,
        )
    ]
