"""The behaviour of a virtual MCU for any protocol: bytes and times in, bytes and events out. Opens nothing.

It sends every MCU message that has ``every``. Its values rest until the host commands motion. It answers requests (a
field of the reply that has the request's name and kind carries its value back, and a list has as many elements as the
request asks for with the field that ``asked_by`` names) from the address that was asked, serves hello, clock and
parameters, says its own counters, stamps messages with a clock of its own, applies the rules of the fields, and keeps
the deadlines at ``mcu``, of each address by itself. One file: each behaviour is a few lines over the same state.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from wirebond.codec import Codec, Message, Stats
from wirebond.errors import MessageError
from wirebond.protocol.counters import COUNTERS
from wirebond.protocol.decimals import decimal_text
from wirebond.protocol.given import is_emergency_stop, is_given
from wirebond.protocol.model import Address, Deadline, End, Mismatch, Recover, Service, Start
from wirebond.protocol.model import Message as MessageModel
from wirebond.protocol.planning import plan_for
from wirebond.protocol.replies import carried_back
from wirebond.protocol.sample_values import sample_values
from wirebond.protocol.spoken import SpokenVersion
from wirebond.protocol.stamps import count_us, stamp_of
from wirebond.sim.field_rules import clamped, refusing
from wirebond.sim.motion import Motion
from wirebond.sim.script import Behaviour

_WAVE_HZ = 0.2  # of the made-up values
_PARAMETERS = 8  # of a table without names


@dataclass
class _Watch:
    rule: Deadline
    since: float
    struck: bool = False
    came: bool = False  # its message, ever

    def __post_init__(self) -> None:
        self.struck = self.came = self.rule.start == Start.HELD

    @property
    def holds_back(self) -> bool:
        """A deadline that strikes before its message ever came holds nothing back."""
        return self.struck and self.came and self.rule.recover == Recover.EXPLICIT


@dataclass
class _Device:
    """The deadlines of one address."""

    address: object  # as the header field gives it; None where frames have no address
    watches: list[_Watch]

    def holds_back(self, message: str) -> bool:
        return any(watch.holds_back for watch in self.watches if watch.rule.message == message)


@dataclass
class VirtualMcu:
    """Call ``feed`` with what the host sent and ``tick`` often; both return bytes for the host.

    Where silence ends a frame they return one frame at most, and the next one after the pause.
    """

    codec: Codec
    start: float
    addresses: tuple[int | str, ...] = ()  # of the devices that it plays; empty: any that is asked
    behaviour: Behaviour | None = None  # added by a user's script
    clock_drift: float = 0.0  # parts per million by which its clock is fast
    events: list[str] = field(default_factory=list)  # sentences for the operator; the caller empties it
    foreign: int = 0  # frames for an address that it does not play
    held_back: int = 0  # that did not act: a deadline with `recover: explicit` had struck, or the host's file differs
    rejected: int = 0  # messages that did not act, because a value breaks its field's rule

    def __post_init__(self) -> None:
        model = self.codec.model
        self._decoder = refusing(self.codec).decoder("host")
        self._addressing = _Addressing(self.codec, self.addresses)
        self._spoken = SpokenVersion(model.format.parts)
        self._motion = Motion(model)
        self._is_at_rest = False  # while values are made up
        self._due = {m.name: self.start for m in model.messages if m.sent_by(End.MCU) and m.every is not None}
        self._devices = {bits: self._device(one, self.start) for bits, one in self._addressing.devices.items()}
        self._parameters: dict[int, float] = {}
        counters = model.service("counters")
        self._counters_message = None if counters is None else counters.message("message")
        self._sent = 0  # frames
        self._hello_due = model.service("hello") is not None
        self._waiting: deque[bytes] = deque()  # frames
        self._silent_until = self.start
        self._told_rejected: set[str] = set()  # messages that were reported, of which none has acted since
        self._told_held_back: set[str] = set()
        self._host_differs = False  # by its hello
        self._numbers: Counter[str] = Counter()  # the next sequence number, by message, or of all

    @property
    def account(self) -> Stats:
        """The account of every byte from the host."""
        return self._decoder.stats

    def feed(self, data: bytes, t: float) -> bytes:
        for message in self._decoder.feed(data, t) if data else self._decoder.idle(t):
            self._spoken.hear(message.header)
            if message.name == "unknown":
                self.events.append(f"frame with unknown id 0x{message.id:02X}")
                continue
            asked = self._addressing.asked(message)
            if asked is None:
                self.foreign += 1
                continue
            heard_by = self._heard_by(message, t)
            is_stop = is_emergency_stop(self.codec.model, message.name, message.fields)
            strange = self._host_differs and not self._acts_for_strangers(message.name)
            acting = [d for d in heard_by if is_stop or not (strange or d.holds_back(message.name))]
            self.held_back += len(heard_by) - len(acting)
            if not acting:
                if not strange:
                    self._tell_held_back(message.name, heard_by[0])
                elif message.name not in self._told_held_back:
                    self._told_held_back.add(message.name)
                    self.events.append(f"{message.name} is held back, because the host has another protocol file")
                continue
            if message.violations:
                self._reject(message, len(acting))
                for header in asked:
                    self._waiting += self._refusal(message, header, t)
                continue
            self._told_rejected.discard(message.name)
            self._told_held_back.discard(message.name)
            for device in acting:
                if not (strange or device.holds_back(message.name)):  # else a stop, which puts off no deadline
                    self._seen(device, message.name, t)
            self._recover_by(message, t)
            self._motion.act(message.name, message.fields)
            said = {} if self.behaviour is None else self.behaviour.heard(message)
            self._is_at_rest = self._motion.is_at_rest
            for header in asked:
                self._waiting += self._answer(message, header, t, said)
        self._do_scripted(t)
        return self._leaving(t)

    def tick(self, t: float) -> bytes:
        if self._hello_due:
            self._hello_due = False
            for header in self._addressing.own:
                self._waiting += self._hello(header)
        for device in self._devices.values():
            for watch in device.watches:
                if not watch.struck and t - watch.since >= watch.rule.after:
                    watch.struck = True
                    self._motion.stop(watch.rule.message)
                    which = f"{watch.rule.message}{self._whose(device)}"
                    self.events.append(f"no {which} for {watch.rule.after:g} s: {watch.rule.then}")
        self._is_at_rest = self._motion.is_at_rest
        for name, due in self._due.items():
            if t < due:
                continue
            message = self.codec.model.message(name)
            assert message.every is not None
            self._due[name] = due + (math.floor((t - due) / message.every) + 1) * message.every
            values = self._made_up(message, t)
            if name == self._counters_message:
                values |= self._counted(message)
            if self.behaviour is not None:
                values |= self.behaviour.filled(name, t - self.start)
            for header in self._addressing.own:
                self._waiting.append(self._encoded(name, values, header))
        if self.behaviour is not None:
            self.behaviour.tick(t - self.start)
            self._do_scripted(t)
        return self._leaving(t)

    def _do_scripted(self, t: float) -> None:
        if self.behaviour is None:
            return
        for action in self.behaviour.take_recovered():
            self.recover(action, t)
        for name, values in self.behaviour.take_messages():
            made_up = self._made_up(self.codec.model.message(name), t)
            for header in self._addressing.own:
                self._waiting.append(self._encoded(name, made_up | dict(values), header))
        self.events += self.behaviour.take_reports()

    def _leaving(self, t: float) -> bytes:
        """Return the bytes that the line may carry now: all waiting ones; if silence ends a frame, one frame after each
        pause."""
        pause = self.codec.model.pause_seconds
        if pause == 0:
            frames, self._waiting = self._waiting, deque()
            self._sent += len(frames)
            return b"".join(frames)
        if not self._waiting or t < self._silent_until:
            return b""
        frame = self._waiting.popleft()
        self._sent += 1
        link = self.codec.model.link
        self._silent_until = t + len(frame) * link.bits_per_byte / link.baud + pause
        return frame

    def recover(self, action: str, t: float) -> None:
        """End what struck with ``recover: explicit``, at each address: its message acts again, and all its deadlines
        begin again."""
        for device in self._devices.values():
            ended = {w.rule.message for w in device.watches if w.struck and w.rule.then == action}
            for watch in device.watches:
                if watch.rule.message in ended and (watch.rule.then == action or not watch.holds_back):
                    watch.since, watch.struck = t, False

    # ---- receiving

    def _recover_by(self, message: Message, t: float) -> None:
        """End a deadline if this is the message that the file names for it."""
        model = self.codec.model
        for rule in model.deadlines:
            if rule.recover_by is not None and is_given(model, rule.recover_by, message.name, message.fields):
                if any(w.holds_back for device in self._devices.values() for w in device.watches if w.rule == rule):
                    self.events.append(f"{message.name} ends {rule.then}")
                self.recover(rule.then, t)

    def _device(self, address: object, t: float) -> _Device:
        return _Device(address, [_Watch(d, t) for d in self.codec.model.deadlines if d.at == End.MCU])

    def _heard_by(self, message: Message, t: float) -> list[_Device]:
        """Return the devices that the message is for: a broadcast is for all. An address that is asked for the first
        time is a device from then on, where it is not said which ones there are."""
        bits = self._addressing.address_bits(message)
        if bits is None:
            return list(self._devices.values())
        if bits not in self._devices:
            self._devices[bits] = self._device(self._addressing.address_of(message), t)
        return [self._devices[bits]]

    def _whose(self, device: _Device) -> str:
        """Name this device if there are several."""
        return f" to {self._addressing.field} {device.address}" if len(self._devices) > 1 else ""

    def _seen(self, device: _Device, message: str, t: float) -> None:
        for watch in device.watches:
            if watch.rule.message != message:
                continue
            watch.since = t
            watch.came = True
            if watch.struck:
                watch.struck = False
                self.events.append(f"{message}{self._whose(device)} is back: {watch.rule.then} ends")

    def _acts_for_strangers(self, message: str) -> bool:
        """Return whether it acts although the host has another protocol file. A message that asks and moves nothing
        does."""
        model = self.codec.model
        if model.link.on_mismatch == Mismatch.ACT:
            return True
        roles = (("hello", "message"), ("ping", "request"), ("clock", "request"), ("parameter", "read"))
        return any((s := model.service(name)) is not None and s.message(role) == message for name, role in roles)

    def _tell_held_back(self, message: str, device: _Device) -> None:
        if message in self._told_held_back:
            return
        self._told_held_back.add(message)
        rule = next(w.rule for w in device.watches if w.rule.message == message and w.holds_back)
        whose, until = f"{message}{self._whose(device)}", f"a script calls mcu.recover({rule.then!r})"
        if (by := rule.recover_by) is not None:
            values = ", ".join(f"{name} = {_short(value)}" for name, value in by.fields.items())
            until = f"{by.message} comes{' with ' + values if values else ''}"
        self.events.append(f"{whose} is held back by {rule.then} until {until}")

    def _reject(self, message: Message, devices: int) -> None:
        """Reject it as an MCU whose handler does not get it: it meets no deadline."""
        self.rejected += devices
        if message.name not in self._told_rejected:
            self._told_rejected.add(message.name)
            self.events.append(f"{message.name} is rejected: {message.violations[0]}")

    def _refusal(self, message: Message, header: dict[str, Any], t: float) -> list[bytes]:
        """Return the reply of a link's parameter service. Nothing else replies to a message that breaks a field's
        rule."""
        service = self.codec.model.service("parameter")
        roles = {} if service is None else dict(service.messages)
        if service is None or message.name not in (roles["read"], roles["set"]):
            return []
        reply = self.codec.model.message(roles["value"])
        values = self._made_up(reply, t) | self._parameter(message.name, message.fields, service, acts=False)
        try:
            return [self._frame(reply.name, values, header)]
        except MessageError:
            return []  # the answer cannot carry this index either

    def _answer(self, message: Message, header: dict[str, Any], t: float, said: dict[str, Any]) -> list[bytes]:
        """Answer a request. ``said``: values of the reply that a script gives."""
        hello = self.codec.model.service("hello")
        if hello is not None and message.name == hello.message("message"):
            theirs = message.fields.get("protocol_hash")
            self._host_differs = theirs != self.codec.hash
            if self._host_differs:
                self.events.append(
                    f"the host has another protocol file: its hash is {theirs:016x}, and the one here "
                    f"{self.codec.hash:016x}. Compare the two files with `wirebond diff`"
                )
            return self._hello(header)
        request = self.codec.model.message(message.name)
        if request.reply is None:
            return []
        reply = self.codec.model.message(request.reply)
        given = clamped(request.fields, message.fields)
        amounts = {f.name: given[f.asked_by] for f in reply.fields if f.asked_by}
        values = self._made_up(reply, t, amounts)
        values |= {name: given[name] for name in carried_back(reply, request)}
        values |= self._service_values(message.name, given, t) | said
        return [self._encoded(reply.name, values, header)]

    def _service_values(self, message: str, given: Mapping[str, Any], t: float) -> dict[str, Any]:
        clock = self.codec.model.service("clock")
        if clock is not None and message == clock.message("request"):
            now = self._clock_us(t)
            return {"received_us": now, "sent_us": now}
        parameter = self.codec.model.service("parameter")
        if parameter is not None and message in (parameter.message("read"), parameter.message("set")):
            return self._parameter(message, given, parameter)
        return {}

    def _parameter(
        self, message: str, values: Mapping[str, Any], service: Service, *, acts: bool = True
    ) -> dict[str, Any]:
        """Return a parameter: one that the file names, or of the first eight, with the range that the file gives.
        ``acts``: the request keeps the rules of its fields."""
        roles = {role: self.codec.model.message(name) for role, name in service.messages}
        value = next(f for f in roles["set"].fields if f.name == "value")
        index_field = next(f for f in self.codec.model.message(message).fields if f.name == "index")
        names, given = dict(index_field.enum), values["index"]
        index = names.get(given, given)
        answered = next(f for f in roles["value"].fields if f.name == "index")
        answer = {"index": given if answered.enum else index}
        nearest = 0.0 if value.minimum is None else max(value.minimum, 0.0)
        initial = nearest if value.maximum is None else min(nearest, value.maximum)
        sets = message == roles["set"].name
        if index not in (names.values() if names else range(_PARAMETERS)) or not (acts or sets):
            return answer | {"value": initial, "result": 1}
        if not acts:
            return answer | {"value": self._parameters.get(index, initial), "result": 2}
        if sets:
            self._parameters[index] = values["value"]
            self.events.append(f"parameter {given} is now {decimal_text(values['value'], 6)}")
        return answer | {"value": self._parameters.get(index, initial), "result": 0}

    def _clock_us(self, t: float) -> int:
        """Return its own clock, which begins at 0 and has 32 bits."""
        return round((t - self.start) * (1e6 + self.clock_drift)) & 0xFFFFFFFF

    @property
    def counters(self) -> dict[str, int]:
        """Return its counters, by the names of the counters service; those that it cannot count are missing."""
        account = self.account
        return {
            **account.discarded_bytes,
            "frames": account.frames,
            "unknown_frames": account.unknown_frames,
            "unlisted": account.unlisted_frames,
            "foreign": self.foreign,
            "held_back": self.held_back,
            "rejected": self.rejected,
            "sent": self._sent,
        }

    def _counted(self, message: MessageModel) -> dict[str, int]:
        """Return the counters in this message, each cut to its field."""
        counted = self.counters
        return {f.name: counted.get(f.name, 0) & ((1 << f.width) - 1) for f in message.fields if f.name in COUNTERS}

    def _hello(self, header: dict[str, Any]) -> list[bytes]:
        service = self.codec.model.service("hello")
        name = service.message("message") if service is not None else None
        if name is None:
            return []
        return [self._encoded(name, {"protocol_hash": self.codec.hash, "version": 1}, header)]

    # ---- sending

    def _encoded(self, name: str, values: dict[str, Any], header: dict[str, Any]) -> bytes:
        try:
            return self._frame(name, values, header)
        except MessageError as error:  # a generated message has no mistakes
            raise error if self.behaviour is None else self.behaviour.mistake(error) from None

    def _frame(self, name: str, values: dict[str, Any], header: dict[str, Any]) -> bytes:
        """Return a frame, which leaves behind all that were encoded before; with the next sequence number, if it has
        one. Each address has numbers of its own."""
        sequence = self.codec.tables.sequence_of(End.MCU)

        def made(whole: Mapping[str, Any] | None) -> bytes:
            return self.codec.encode(name, values, header=whole, sender=End.MCU)

        if sequence is None:
            return self._spoken.make(made, header)
        counter = repr((header, name if sequence.per_message else ""))
        number = self._numbers[counter]
        self._numbers[counter] = (number + 1) % (1 << sequence.value.width)
        return self._spoken.make(made, {**header, sequence.name: number})

    # ---- made-up values

    def _made_up(self, message: MessageModel, t: float, amounts: Mapping[str, int] | None = None) -> dict[str, Any]:
        """Make values. ``amounts``: how many elements a request asked for, of lists that have no more than their
        ``max``."""

        def wave(phase: int) -> float | None:
            return None if self._is_at_rest else math.sin(2 * math.pi * _WAVE_HZ * (t - self.start) + phase)

        values = sample_values(message, wave, amounts)
        if (stamp := stamp_of(message)) is not None:
            count = self._clock_us(t) // count_us(stamp) & ((1 << stamp.width) - 1)
            values[stamp.name] = float(count * stamp.scale) if stamp.is_scaled else count
        return values


class _Addressing:
    """The receiver of a frame of the host, and the header values of an answer."""

    def __init__(self, codec: Codec, played: tuple[int | str, ...]) -> None:
        asks, answers = plan_for(codec.model, End.HOST), plan_for(codec.model, End.MCU)
        held = {entry.place for entry in answers.forms[0].header}
        self._to = None if asks.address is None else asks.header[asks.address]
        self._from = next((f.name for f in asks.header if f.address == Address.SENDER), None)
        own = next((f for f in answers.header if f.address in (Address.MCU, Address.SENDER)), None)
        self._own = own.name if own is not None and answers.header.index(own) in held else None
        to_host = answers.address if answers.address in held else None
        self._to_host = None if to_host is None else answers.header[to_host].name
        self._played = None if self._to is None or not played else {self._to.value.wire_bits(one) for one in played}
        default = None if self._to is None else self._to.default(End.HOST)
        self.own = [self._header(one, None) for one in played or (default,)]
        #: Addresses that are known from the start, by their bits; None: frames have none.
        self.devices: dict[int | None, object] = {self._bits(one): one for one in played or (default,)}

    def _bits(self, address: int | float | str | None) -> int | None:
        if self._to is None:
            return None
        return self._to.default_bits(End.HOST) if address is None else self._to.value.wire_bits(address)

    @property
    def field(self) -> str:
        return "" if self._to is None else self._to.name

    def address_of(self, message: Message) -> object:
        return None if self._to is None else message.header.get(self._to.name)

    def address_bits(self, message: Message) -> int | None:
        """Return the one address that the message is for; None: for all that there are."""
        if self._to is None or self._to.name not in message.header:
            return None
        bits = self._to.value.wire_bits(message.header[self._to.name])
        return None if bits in self._to.broadcast_bits else bits

    def asked(self, message: Message) -> list[dict[str, Any]] | None:
        """Return the header of each answer: one, or none to a broadcast; None where the frame is for others."""
        if self._to is None or self._to.name not in message.header:
            return [self._header(None, message)]
        address = message.header[self._to.name]
        bits = self._to.value.wire_bits(address)
        if bits in self._to.broadcast_bits:
            return []
        if self._played is not None and bits not in self._played:
            return None
        return [self._header(address, message)]

    def _header(self, own: int | float | str | None, request: Message | None) -> dict[str, Any]:
        header: dict[str, Any] = {}
        if own is not None and self._own is not None:
            header[self._own] = own
        if request is not None and self._to_host is not None and self._from in request.header:
            header[self._to_host] = request.header[self._from]
        return header


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name} = {_short(one)}" for name, one in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(_short, value))}]"
    if isinstance(value, bytes):
        return value.hex(" ").upper()
    return f"{value:g}" if isinstance(value, float) else str(value)
