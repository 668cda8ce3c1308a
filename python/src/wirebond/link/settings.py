"""Makes the engine's settings for a protocol and a port: line, periods, safe values, addresses, deadlines."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from wirebond import _engine
from wirebond.arguments import real
from wirebond.codec import Codec
from wirebond.errors import UsageError
from wirebond.link.common_port import CommonPort, opener_of
from wirebond.link.devices.port_name import ADAPTER_LATENCY, PortName
from wirebond.link.ends import actions_at, other, own_address_field
from wirebond.link.engine_settings import (
    EngineAddressing,
    EngineDeadline,
    EnginePeerStop,
    EngineSettings,
    SafeValue,
)
from wirebond.link.plugins import plugin
from wirebond.link.python_link import PythonLink
from wirebond.link.python_ports import LineSettings, PythonOpener
from wirebond.protocol.model import MAX_LATENCY, Address, End, GivenMessage, Queue, Recover, Start
from wirebond.protocol.model.forms import header_fields
from wirebond.protocol.planning import plan_for, told_by_request

STOP_EVERY = 0.05  # seconds between two sends of a stop whose message has no `every`
_SHORTEST_READ, _LONGEST_READ = 0.001, 0.01  # seconds that a link in Python waits for bytes before it does other work
RECENT_SECONDS = 10.0  # of both directions at full line that a link keeps
LEAST_RECENT, MOST_RECENT = 1 << 16, 1 << 21  # bytes
MORE_ADDRESSES = 255  # that a link has leases and safe values for, beside the first of each message


ROOT = Path("/")  #: where the system's `sys` is; tests have one of their own
HAS_ENGINE_PORTS = hasattr(_engine, "Link")  #: the engine opens ttys and TCP connections itself, as on Linux


def open_engine(
    codec: Codec, end: End, port: PortName, settings: EngineSettings, waits: bool, common: CommonPort | None = None
) -> _engine.Link | PythonLink:
    """Return the link below a `Link`, with its port open.

    :param common: of ``port``, which other links open as well.
    :raises PortError: it cannot be opened; with ``waits`` that is not an error.
    :raises UsageError: silence ends the frames, and the port is common to several links.
    """
    protocol, receive = codec.tables.protocol, codec.tables.format_for(other(end))
    if port.recording:
        opener = plugin("replay")(port, end, codec)
        link = PythonLink(protocol, receive, opener, settings, waits, opener.clock.now_us, opener.waits_for_reader)
        if (stamper := opener.stamper(codec)) is not None:
            link.set_stamper(stamper)
        return link
    line = LineSettings(settings.baud, settings.data_bits, settings.parity, settings.stop_bits)
    if common is not None:
        if settings.pause_seconds:
            raise UsageError(
                f"silence ends the frames of {codec.name}, and another link's frames on {port.text} would fill it; "
                "open the port for this protocol alone"
            )
        return PythonLink(protocol, receive, opener_of(common, codec, line, ROOT), settings, waits)
    if HAS_ENGINE_PORTS and not port.is_rfc2217:
        return _engine.Link(protocol, receive, engine_port(port, waits), settings)
    silence = settings.pause_seconds or _LONGEST_READ  # that ends a frame
    wait = min(max(silence / 2, _SHORTEST_READ), _LONGEST_READ)
    return PythonLink(protocol, receive, PythonOpener(port, line, wait, ROOT), settings, waits)


def engine_port(port: PortName, waits: bool) -> dict[str, Any]:
    found: dict[str, Any] = {"name": port.text, "waits": waits}
    if port.is_tcp:
        return found | {"host": port.host, "service": port.service}
    return found | {"root": str(ROOT)} | ({"resolve": port.path} if port.moves else {})


def latency_of(codec: Codec, port: PortName, baud: int, given: float | None) -> float:
    """Return how many seconds this port may hold bytes back."""
    if given is not None:
        expected = f"0 to {MAX_LATENCY:g} s, such as 0.016"
        given = real("adapter_latency", given, expected)
        if not 0 <= given <= MAX_LATENCY:
            raise UsageError(f"adapter_latency is {given:g} s; expected {expected}")
        return given
    settings = codec.model.link
    if settings.adapter_latency is not None:
        return settings.adapter_latency
    if port.recording:
        return 0.0
    if port.is_tcp or port.moves or not hasattr(_engine, "port_latency_us"):
        return ADAPTER_LATENCY
    return _engine.port_latency_us(port.text, baud / settings.bits_per_byte) / 1e6


def engine_settings(
    codec: Codec,
    baud: int,
    paced: bool = True,
    hold_back: bool = True,
    adapter_latency: float = 0.0,
    end: End = End.HOST,
) -> EngineSettings:
    """Return the engine's settings for the protocol. ``end``: the one that the link plays."""
    model = codec.model
    actions = actions_at(codec, end)
    return EngineSettings(
        baud=baud,
        data_bits=model.link.data_bits,
        parity=model.link.parity,
        stop_bits=round(model.link.stop_bits),
        paced=paced,
        bits_per_byte=math.ceil(model.link.bits_per_byte),
        send=codec.tables.format_for(end),
        send_pause_seconds=model.pause_seconds,
        max_age_seconds=model.link.max_age or 0.0,
        echo=model.link.echo,
        largest_frame=model.max_wire_bytes(sender=end),
        every=tuple(m.every if m.sent_by(end) and m.every is not None else 0.0 for m in model.messages),
        latest=tuple(m.queue == Queue.LATEST and m.reply is None and m.sent_by(end) for m in model.messages),
        stop=tuple(safe_value(codec, stop, None) for stop in model.emergency_stop if end == End.HOST),
        idle_seconds=model.idle_seconds + adapter_latency,
        pause_seconds=model.idle_seconds if model.format.ends_by_silence else 0.0,
        addressing=_addressing(codec, end),
        deadlines=tuple(
            EngineDeadline(
                codec.tables.indices[d.message],
                round(d.after * 1e6),
                actions.index(d.then),
                d.recover == Recover.EXPLICIT,
                d.start == Start.HELD,
            )
            for d in model.deadlines
            if d.at == end
        ),
        peer_stops=tuple(_peer_stops(codec)) if end == End.MCU else (),
        hold_back=hold_back,
        recent_bytes=recent_bytes(baud, model.link.bits_per_byte),
    )


def _peer_stops(codec: Codec) -> Iterator[EnginePeerStop]:
    """Yield the messages of the stop. The fields that the file gives count; all do where it gives none, or where they
    have no places of their own."""
    for stop in codec.model.emergency_stop:
        frame = codec.encode(stop.message, stop.fields, header=dict(stop.header), sender=End.HOST)
        decoder = codec.decoder("host")
        for sent in (*decoder.feed(frame, 0.0), *decoder.finish()):
            if sent.name != stop.message:  # its own bytes cut its frame: the lint says so
                continue
            fields = codec.model.message(stop.message).fields
            given = dict(stop.values) or {field.name for field in fields if field.has_value}
            mask = b"".join((b"\xff" if field.name in given else b"\0") * field.min_wire_bytes for field in fields)
            is_whole = any(field.is_variable for field in fields)
            payload = sent.payload if is_whole else sent.payload.ljust(len(mask), b"\0")
            mask = b"\xff" * len(payload) if is_whole else mask
            yield EnginePeerStop(codec.tables.indices[sent.name], payload, mask, is_whole)


def recent_bytes(baud: int, bits_per_byte: float) -> int:
    """Return how many bytes of both directions a link keeps for a dump: some seconds of a full line."""
    full_line = 2 * RECENT_SECONDS * baud / bits_per_byte
    return round(min(max(full_line, LEAST_RECENT), MOST_RECENT))


def safe_value(codec: Codec, stop: GivenMessage, header: Mapping[str, Any] | None) -> SafeValue:
    """Return the engine's form of one message of the stop. ``header``: a frame whose addresses it must use; None: the
    file's. Only the addresses are used, because with a flag such as "wait for the trigger" it would be no stop."""
    addresses = {f.name for f in header_fields(codec.model.format.parts) if f.address is not None}
    given = {**dict(stop.header), **{n: v for n, v in (header or {}).items() if n in addresses}}
    if header is not None and codec.tables.address is not None:
        receiver = plan_for(codec.model, End.HOST).header[codec.tables.address]
        given[receiver.name] = header.get(receiver.name, receiver.default(End.HOST))
    covered = codec.tables.address_of(dict(stop.header)) in codec.tables.broadcasts
    return SafeValue(
        codec.tables.indices[stop.message],
        codec.encode(stop.message, stop.fields, header=given),
        reply_index(codec, stop.message),
        codec.model.message(stop.message).every or STOP_EVERY,
        codec.tables.address_of(given) or 0,
        header is None or not covered,
    )


def _addressing(codec: Codec, end: End) -> EngineAddressing:
    asks, answers = plan_for(codec.model, end), plan_for(codec.model, other(end))
    own = own_address_field(codec, end)
    by_mcu = end == End.HOST and asks.address is not None and asks.header[asks.address].address == Address.MCU
    return EngineAddressing(
        receiver_place=-1 if answers.address is None else answers.address,
        sender_place=answers.peer if by_mcu and answers.peer is not None else -1,
        own=0 if own is None else own[0].value.wire_bits(own[1]),
        only_last_asked=bool(told_by_request(codec.model.messages, other(end))),
        broadcast=tuple(asks.broadcast or answers.broadcast),
        more_addresses=0 if asks.address is None else MORE_ADDRESSES,
    )


def reply_index(codec: Codec, message: str) -> int:
    reply = codec.model.messages[codec.tables.indices[message]].reply
    return -1 if reply is None else codec.tables.indices[reply]
