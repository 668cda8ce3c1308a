"""Asking a peer again and again, one question at a time, and noting how long each answer took."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import Any

from wirebond.codec import Codec, Message
from wirebond.errors import LinkDownError, QueueFullError, UsageError
from wirebond.link import Link
from wirebond.link.receiving import Asked
from wirebond.link.requests import Outcome
from wirebond.link.service_values import filled

_AWAY = 0.05  # seconds between two tries while the port is away


@dataclass(frozen=True)
class Probe:
    """The request to measure.

    :ivar message: a message of the host that has a reply.
    :ivar values: its fields.
    :ivar number: the field that numbers the questions and comes back with the answer; empty: there is none.
    """

    message: str
    values: Mapping[str, Any]
    number: str = ""
    bits: int = 0  # of that field


def probe_for(codec: Codec, message: str | None, values: Mapping[str, Any]) -> Probe:
    """Return the ping service's request, or the message that is named.

    :raises UsageError: there is no ping service and no name, or the message has no reply.
    :raises MessageError: a value is wrong or missing.
    """
    ping = codec.model.service("ping")
    if message is None:
        request = None if ping is None else ping.message("request")
        if request is None:
            asking = ", ".join(m.name for m in codec.model.messages if m.reply is not None) or "none has one"
            raise UsageError(
                f"{codec.name} maps no ping service; name a request that has a reply with --message: {asking}"
            )
        described = codec.model.message(request)
        width = next(f.width for f in described.fields if f.name == "number")
        return Probe(request, filled(described, {"number": 0}), "number", width)
    codec.tables.reply_to(message)
    codec.encode(message, values)
    return Probe(message, values)


@dataclass
class Measurement:
    """The measurements so far; times in seconds.

    :ivar round_trips: from the moment in which the request was handed to the port to that in which the reply was read.
    :ivar to_mcu: one way, if the MCU's clock is known from the exchanges of the clock service.
    :ivar to_host: the other way.
    :ivar one_way_error: by how much a time of one way is wrong at most.
    :ivar asked: requests.
    :ivar lost: requests without an answer in time, or refused because the port was away.
    :ivar wrong: answers to another number than was asked. Their requests are lost.
    """

    round_trips: list[float] = field(default_factory=list)
    to_mcu: list[float] = field(default_factory=list)
    to_host: list[float] = field(default_factory=list)
    one_way_error: float = 0.0
    asked: int = 0
    lost: int = 0
    wrong: int = 0
    seconds: float = 0.0
    advice: str = ""  #: of the last request that was lost


def measure(
    link: Link,
    probe: Probe,
    into: Measurement,
    *,
    count: int | None,
    rate: float,
    end: float,
    timeout: float,
    header: Mapping[str, Any],
) -> None:
    """Ask until ``count`` questions were asked or ``end`` has come. KeyboardInterrupt leaves ``into`` as it is then.

    :param rate: questions a second, if the answers come in time; the next one waits for the answer before it.
    :param end: on ``time.monotonic()``.
    :param timeout: seconds for each answer.
    """
    began = due = time.monotonic()
    try:
        while (count is None or into.asked < count) and time.monotonic() < end:
            if (wait := min(due, end) - time.monotonic()) > 0:
                time.sleep(wait)
                if due >= end:
                    return
            _ask_once(link, probe, into, timeout, header)
            if link.internals.services.clock is not None:
                _time_one_way(link, into, timeout, header)
            due = max(due + 1 / rate, time.monotonic())
            into.seconds = time.monotonic() - began
    finally:
        into.seconds = time.monotonic() - began


def _ask_once(link: Link, probe: Probe, into: Measurement, timeout: float, header: Mapping[str, Any]) -> None:
    values = dict(probe.values)
    if probe.number:
        values[probe.number] = into.asked & ((1 << probe.bits) - 1)
    into.asked += 1
    try:
        asked, reply = _exchange(link, probe.message, values, timeout, header)
    except (LinkDownError, QueueFullError) as error:
        into.lost += 1
        into.advice = str(error)
        time.sleep(min(_AWAY, timeout))
        return
    other = (asked.question.others if reply is None else reply.fields) or {}
    if probe.number and other.get(probe.number, values[probe.number]) != values[probe.number]:
        into.lost += 1
        into.wrong += 1
        into.advice = (
            f"{asked.question.reply} came back with number {other[probe.number]}, and {values[probe.number]} was asked;"
            f" the MCU must give back the number of {probe.message}"
        )
        return
    if reply is None:
        into.lost += 1
        into.advice = str(asked.timeout_error())
        if not probe.number:  # its late reply must not answer the next one
            time.sleep(timeout)
        return
    into.round_trips.append(reply.t - asked.question.since)


def _time_one_way(link: Link, into: Measurement, timeout: float, header: Mapping[str, Any]) -> None:
    service = link.codec.model.service("clock")
    assert service is not None
    request = service.message("request")
    assert request is not None
    described = link.codec.model.message(request)
    width = next(f.width for f in described.fields if f.name == "host_us")
    host_us = time.monotonic_ns() // 1000 & ((1 << width) - 1)
    try:
        asked, reply = _exchange(link, request, filled(described, {"host_us": host_us}), timeout, header)
        if reply is None or reply.fields["host_us"] != host_us:
            return
        link.internals.services.note_exchange(asked.question.since, reply)
        received = link.host_time(reply.fields["received_us"], near=reply.t)
        sent = link.host_time(reply.fields["sent_us"], near=reply.t)
    except (LinkDownError, QueueFullError, UsageError):  # the port is away, or the MCU's clock began again
        return
    into.to_mcu.append(received.t - asked.question.since)
    into.to_host.append(reply.t - sent.t)
    into.one_way_error = max(into.one_way_error, received.error, sent.error)


def _exchange(
    link: Link, message: str, values: Mapping[str, Any], timeout: float, header: Mapping[str, Any]
) -> tuple[Asked, Message | None]:
    """Exchange one question and its answer; None: no answer came in time.

    :raises LinkDownError: the port is away.
    """
    answer: SimpleQueue[Outcome] = SimpleQueue()
    asked = link.ask(message, values, timeout, answer.put, header or None)
    try:
        outcome: Outcome | None = answer.get(timeout=timeout)
    except Empty:
        outcome = None
    finally:
        link.internals.inbox.requests.withdraw(asked.question)
    if isinstance(outcome, Exception):
        raise outcome
    return asked, outcome
