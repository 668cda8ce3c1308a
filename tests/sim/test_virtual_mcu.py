"""The virtual MCU: its deadlines, which hold messages back as those of a firmware do."""

from __future__ import annotations

import itertools
from dataclasses import replace

from tests.shared import PROTOCOLS, ROOT

import wirebond
from wirebond import Codec
from wirebond.protocol import loads
from wirebond.sim.virtual_mcu import VirtualMcu

CODEC = wirebond.load(PROTOCOLS / "diffdrive.yaml")
VELOCITY = CODEC.encode("velocity", linear=0.5, angular=0.0)


def run(mcu: VirtualMcu, begin: float, end: float) -> list[str]:
    """Return the MCU's reports, polled every 10 ms."""
    for step in range(round((end - begin) * 100)):
        mcu.tick(begin + step / 100)
    told = [event for event in mcu.events if "velocity" in event]
    mcu.events.clear()
    return told


def test_an_explicit_deadline_holds_its_message_back_until_somebody_recovers() -> None:
    mcu = VirtualMcu(CODEC, 0.0)
    assert run(mcu, 0.0, 5.0) == ["no velocity for 1 s: stop", "no velocity for 3 s: safe_mode"]
    mcu.feed(VELOCITY, 5.0)  # it never came before: nothing is held back
    assert mcu.held_back == 0
    assert run(mcu, 5.0, 5.5) == ["velocity is back: stop ends", "velocity is back: safe_mode ends"]
    assert run(mcu, 5.5, 9.0) == ["no velocity for 1 s: stop", "no velocity for 3 s: safe_mode"]
    mcu.feed(VELOCITY, 9.0)
    assert mcu.held_back == 1
    assert run(mcu, 9.0, 9.5) == [
        "velocity is held back by safe_mode until parameter comes with name = clear_safe_mode, value = 0"
    ]
    mcu.feed(VELOCITY, 9.5)  # which is reported once
    assert run(mcu, 9.5, 9.5) == [] and mcu.held_back == 2
    mcu.feed(CODEC.encode("parameter", name="max_linear", value=0), 9.5)
    assert mcu._devices[None].holds_back("velocity")
    mcu.feed(CODEC.encode("parameter", name="clear_safe_mode", value=0), 9.5)
    assert mcu.events.pop() == "parameter ends safe_mode"
    mcu.feed(VELOCITY, 9.6)
    assert mcu.held_back == 2
    assert run(mcu, 9.6, 10.5) == []
    assert run(mcu, 10.5, 13.0) == ["no velocity for 1 s: stop", "no velocity for 3 s: safe_mode"]


HELD = wirebond.load(ROOT / "tests" / "mcu_link" / "held.yaml")


def drive(speed: float, mode: str = "manual") -> bytes:
    return HELD.encode("drive", speed=speed, mode=mode)


def test_messages_held_from_the_start_wait_for_recovery_and_a_stop_does_not() -> None:
    mcu = VirtualMcu(HELD, 0.0)
    mcu.feed(drive(0.5), 0.1)
    assert mcu.held_back == 1
    assert mcu.events == ["drive is held back by safe_mode until clear comes"]
    mcu.feed(drive(0.1, "idle"), 0.2)  # the emergency stop
    assert mcu.held_back == 1
    mcu.feed(drive(0.5), 0.3)
    assert mcu.held_back == 2
    mcu.feed(HELD.encode("clear"), 0.4)
    mcu.feed(drive(0.5), 0.5)
    assert mcu.held_back == 2


def test_commands_of_a_host_of_another_file_do_not_act_but_for_the_stop() -> None:
    mcu = VirtualMcu(HELD, 0.0)
    mcu.recover("safe_mode", 0.0)

    def hello(number: int) -> None:
        mcu.feed(HELD.encode("hello", protocol_hash=number, version=1, sender="host"), 0.1)

    hello(5)
    mcu.feed(drive(0.5), 0.1)
    mcu.feed(HELD.encode("grip", force=1.0), 0.1)
    assert mcu.held_back == 2
    assert mcu.events[-1] == "grip is held back, because the host has another protocol file"
    mcu.feed(drive(0.1, "idle"), 0.1)
    assert mcu.held_back == 2
    pongs = HELD.decoder("mcu").feed(mcu.feed(HELD.encode("ping", number=7), 0.15))
    assert [pong.fields["number"] for pong in pongs if pong.name == "pong"] == [7]
    mcu.events.clear()
    mcu.tick(0.25)
    assert "no drive for 0.2 s: stop" in mcu.events  # none of them put the deadline off
    hello(HELD.hash)
    mcu.feed(drive(0.5), 0.3)
    assert mcu.held_back == 2

    text = (ROOT / "tests" / "mcu_link" / "held.yaml").read_text()
    trusting = VirtualMcu(Codec(loads(text.replace("baud: 115200", "baud: 115200, on_mismatch: act"))), 0.0)
    trusting.feed(HELD.encode("hello", protocol_hash=5, version=1, sender="host"), 0.1)
    trusting.feed(HELD.encode("grip", force=1.0), 0.1)
    assert trusting.held_back == 0


def test_a_parameter_that_breaks_its_fields_rule_is_refused_as_a_link_refuses_it() -> None:
    tuned, loose = (wirebond.load(ROOT / "tests" / "mcu_link" / f"{name}.yaml") for name in ("tuned", "loose"))
    mcu = VirtualMcu(tuned, 0.0)

    def answers(message: str, to: int = 1, **fields: float) -> list[dict[str, float]]:
        frames = mcu.feed(loose.encode(message, fields, header={"to": to}), 1.0)
        return [dict(answer.fields) for answer in tuned.decoder("mcu").feed(frames)]

    assert answers("set", index=1, value=4) == [{"index": 1, "value": 4, "result": 0}]
    assert answers("set", index=1, value=11) == [{"index": 1, "value": 4, "result": 2}]
    assert answers("set", index=2, value=1) == [{"index": 2, "value": 0, "result": 1}]
    assert answers("read", index=9) == [{"index": 9, "value": 0, "result": 1}]
    assert answers("set", to=0xFF, index=1, value=11) == []
    assert mcu.rejected == 4


BUS = Codec(
    loads(
        "wirebond: 1\nprotocol: bus\nframe: [magic: 0xA5, {field: servo, type: u8, default: 1, address: mcu, "
        "broadcast: 0xFE}, id: u8, payload: by_id, check: crc-16/modbus]\n"
        "messages:\n  move: {id: 1, sender: host, fields: {angle: {type: u8}}}\n"
        "deadlines: [{message: move, at: mcu, after: 1 s, then: stop}, "
        "{message: move, at: mcu, after: 2 s, then: fault, recover: explicit}]\n"
    )
)


def moved(servo: int) -> bytes:
    return BUS.encode("move", angle=1, header={"servo": servo})


def told_at(mcu: VirtualMcu, t: float) -> list[str]:
    mcu.tick(t)
    told, mcu.events[:] = list(mcu.events), []
    return told


def test_each_address_keeps_its_own_deadlines() -> None:
    mcu = VirtualMcu(BUS, 0.0, (3, 4))
    mcu.feed(moved(3), 0.5)
    assert told_at(mcu, 1.2) == ["no move to servo 4 for 1 s: stop"]
    mcu.feed(moved(4), 1.3)
    assert told_at(mcu, 1.3) == ["move to servo 4 is back: stop ends"]
    mcu.feed(moved(5), 1.4)  # of an address that is not played
    assert mcu.foreign == 1
    assert told_at(mcu, 1.6) == ["no move to servo 3 for 1 s: stop"]
    mcu.feed(moved(0xFE), 1.7)
    assert told_at(mcu, 1.7) == ["move to servo 3 is back: stop ends"]
    mcu.feed(moved(4), 2.5)
    assert told_at(mcu, 3.8) == [
        "no move to servo 3 for 1 s: stop",
        "no move to servo 3 for 2 s: fault",
        "no move to servo 4 for 1 s: stop",
    ]
    mcu.feed(moved(3), 3.9)
    assert mcu.held_back == 1
    assert told_at(mcu, 3.9) == ["move to servo 3 is held back by fault until a script calls mcu.recover('fault')"]
    mcu.feed(moved(0xFE), 4.0)  # the one acts, the other does not
    assert mcu.held_back == 2
    assert told_at(mcu, 4.0) == ["move to servo 4 is back: stop ends"]
    mcu.recover("fault", 4.1)
    mcu.feed(moved(3), 4.2)
    assert mcu.held_back == 2


def test_any_address_that_is_asked_has_deadlines_where_none_is_named() -> None:
    mcu = VirtualMcu(BUS, 0.0)
    mcu.feed(moved(1), 0.5)
    assert told_at(mcu, 1.6) == ["no move for 1 s: stop"]
    mcu.feed(moved(7), 1.7)
    assert told_at(mcu, 1.8) == []
    mcu.feed(moved(1), 2.0)
    assert told_at(mcu, 2.8) == ["move to servo 1 is back: stop ends", "no move to servo 7 for 1 s: stop"]


def test_where_silence_ends_a_frame_the_virtual_mcu_pauses_between_its_frames() -> None:
    codec = Codec(
        loads(
            "wirebond: 1\nprotocol: quiet\nframe: [id: u8, payload: rest, check: crc-16/modbus, silence: 2 ms]\n"
            "messages:\n  a: {id: 1, sender: mcu, every: 20 ms}\n  b: {id: 2, sender: mcu, every: 20 ms}\n"
        )
    )
    mcu = VirtualMcu(codec, 0.0)
    left = [(t / 1000, data) for t in range(100) if (data := mcu.tick(t / 1000))]
    assert {len(data) for _, data in left} == {3}
    assert len(left) == 10
    assert min(b - a for (a, _), (b, _) in itertools.pairwise(left)) >= 0.004


def test_a_reply_has_as_many_elements_as_its_request_asks_for() -> None:
    codec = Codec(
        loads(
            "wirebond: 1\nprotocol: asked\n"
            "frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-8/smbus]\n"
            "messages:\n"
            "  read: {id: 1, sender: host, reply: values, fields: {number: {type: u8}}}\n"
            "  values:\n    id: 2\n    sender: mcu\n    fields:\n"
            "      size: {type: u8}\n"
            "      values: {type: i16, count: {bytes: size, asked_by: number}, max: 9}\n"
            "      state: {bits: {type: u8, fields: {busy: {type: bool}, number: {type: u4}}}}\n"
            "      others: {type: u8, count: state.number, max: 9}\n"
        )
    )
    mcu = VirtualMcu(codec, 0.0)
    for asked, there in ((0, 0), (1, 1), (8, 8), (200, 9)):
        (reply,) = codec.decoder("mcu").feed(mcu.feed(codec.encode("read", number=asked), 0.0))
        assert (reply.fields["size"], len(reply.fields["values"])) == (2 * there, there)
        assert reply.fields["state"]["number"] == len(reply.fields["others"]) == 3


RULES = Codec(
    loads(
        "wirebond: 1\nprotocol: rules\nframe: [magic: 0xA5, id: u8, payload: by_id, check: crc-16/modbus]\n"
        "messages:\n"
        "  move: {id: 1, sender: host, reply: moved, fields: {\n"
        "    speed: {type: i16, range: [-100, 100]}, limit: {type: i16, range: [0, 7.5], on_range: clamp}}}\n"
        "  moved: {id: 2, sender: mcu, fields: {limit: {type: i16, range: [0, 7.5], on_range: clamp}}}\n"
        "  counted: {id: 3, sender: mcu, every: 1 s, fields: {rejected: {type: u8}, frames: {type: u8}}}\n"
        "services: {counters: {message: counted}}\n"
        "deadlines: [{message: move, at: mcu, after: 1 s, then: stop}]\n"
    )
)


def move(speed: int, limit: int) -> bytes:
    """A frame of a host that has no ranges in its file."""
    fields = (replace(f, minimum=None, maximum=None) for f in RULES.model.message("move").fields)
    messages = tuple(replace(m, fields=tuple(fields)) if m.name == "move" else m for m in RULES.model.messages)
    return Codec(replace(RULES.model, messages=messages)).encode("move", speed=speed, limit=limit)


def test_a_message_that_breaks_a_field_rule_does_not_act_and_is_counted() -> None:
    mcu = VirtualMcu(RULES, 0.0)
    replies = RULES.decoder("mcu")
    (reply,) = replies.feed(mcu.feed(move(100, 5), 0.0))
    assert (reply["limit"], mcu.rejected) == (5, 0)
    assert mcu.feed(move(101, 5), 0.5) + mcu.feed(move(-101, 5), 0.6) == b""
    assert mcu.events == ["move is rejected: move.speed = 101 is outside -100 ... 100"]  # of both, once
    assert mcu.rejected == 2
    (counted,) = (m for m in replies.feed(mcu.tick(1.0)) if m.name == "counted")
    assert (counted["rejected"], counted["frames"]) == (2, 3)
    assert mcu.events[1:] == ["no move for 1 s: stop"]  # since 0.0


def test_a_value_outside_a_range_that_clamps_is_brought_to_its_bound() -> None:
    mcu = VirtualMcu(RULES, 0.0)
    replies = RULES.decoder("mcu")
    told = [replies.feed(mcu.feed(move(1, limit), 0.1))[0]["limit"] for limit in (-30000, 7, 8, 30000)]
    assert told == [0, 7, 7, 7]
    assert (mcu.rejected, mcu.events) == (0, [])


def ticks(mcu: VirtualMcu, begin: float, end: float) -> set[tuple[int, int]]:
    """The odometry that it sends in this time."""
    decoder = CODEC.decoder("mcu")
    heard = [
        message for step in range(round((end - begin) * 100)) for message in decoder.feed(mcu.tick(begin + step / 100))
    ]
    return {(message["left_ticks"], message["right_ticks"]) for message in heard}


def test_it_does_not_move_until_it_is_commanded() -> None:
    mcu = VirtualMcu(CODEC, 0.0)
    assert ticks(mcu, 0.0, 2.0) == {(0, 0)}
    mcu.feed(VELOCITY, 2.0)
    assert len(ticks(mcu, 2.0, 2.9)) > 10
    mcu.feed(CODEC.encode("velocity", linear=0, angular=0), 2.9)  # a stop
    assert ticks(mcu, 2.9, 3.5) == {(0, 0)}
    mcu.feed(VELOCITY, 3.5)
    assert len(ticks(mcu, 3.5, 4.4)) > 10
    assert ticks(mcu, 4.6, 6.0) == {(0, 0)}  # its deadline has struck
    mcu.feed(CODEC.encode("status_query"), 6.0)  # which commands no motion
    assert ticks(mcu, 6.0, 8.0) == {(0, 0)}
    mcu.feed(VELOCITY, 8.0)  # it is held back
    assert ticks(mcu, 8.0, 8.5) == {(0, 0)}


def test_it_moves_where_nothing_commands_motion() -> None:
    codec = wirebond.load(PROTOCOLS / "enterprize.yaml")
    assert not codec.model.emergency_stop and not codec.model.deadlines
    mcu, decoder = VirtualMcu(codec, 0.0), codec.decoder("mcu")
    heard = [message for step in range(100) for message in decoder.feed(mcu.tick(step / 100))]
    assert len({repr(message.fields) for message in heard}) > 20
