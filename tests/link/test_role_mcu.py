"""Python plays the MCU (`role="mcu"`), against Wirebond's own host and against one that is only bytes."""

from __future__ import annotations

import os
import select
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest

import wirebond
from tests.shared import ROOT, codec
from tests.waiting import PATIENCE, moments, wait_until
from wirebond import DeadlineEvent, Message, MessageError, UsageError
from wirebond.protocol import loads
from wirebond.sim.pty_port import PtyPort

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("links")]

ROVER = codec("diffdrive")
SERVOS = codec("servo_bus")
NATIVE = codec("native")


@contextmanager
def line() -> Iterator[tuple[PtyPort, PtyPort]]:
    """Two ptys whose far ends are joined."""
    ends = PtyPort(), PtyPort()
    is_over = threading.Event()

    def carry() -> None:
        while not is_over.is_set():
            for end in select.select(ends, [], [], 0.01)[0]:
                across = ends[1] if end is ends[0] else ends[0]
                across.write(os.read(end.fileno(), 4096))

    thread = threading.Thread(target=carry)
    thread.start()
    yield ends
    is_over.set()
    thread.join()
    for end in ends:
        end.close()


@contextmanager
def both(protocol: wirebond.Codec) -> Iterator[tuple[wirebond.Link, wirebond.Link]]:
    """The two ends, each in Python."""
    with ExitStack() as stack:
        a, b = stack.enter_context(line())
        mcu = stack.enter_context(wirebond.open(protocol, b.path, role="mcu"))
        yield stack.enter_context(wirebond.open(protocol, a.path)), mcu


def test_requests_are_answered_and_messages_go_both_ways() -> None:
    with both(ROVER) as (host, mcu):
        assert (host.role, mcu.role) == ("host", "mcu")
        speeds: list[float] = []

        @mcu.on("status_query")
        def answer(_: Message) -> None:
            mcu.send("status", battery=12.5, errors=["encoder"], state=[])

        @mcu.on("velocity")
        def drive(message: Message) -> None:
            speeds.append(message["linear"])

        reply = host.request("status_query", timeout=PATIENCE)
        assert (reply["battery"], reply["errors"]) == (12.5, ["encoder"])
        host.repeat("velocity", linear=0.5, angular=0)
        wait_until(lambda: 0.0 in speeds, "the lease ends with the safe value")
        assert speeds[0] == 0.5
        mcu.repeat("odometry", hold=5, left_ticks=3, right_ticks=-3)  # its schedule, as a host's
        wait_until(lambda: host.stats.receive.messages.get("odometry", 0) >= 3, "odometry at its rhythm")
        wait_until(lambda: host.latest("odometry") is not None, "it is not only at the server")
        newest = host.latest("odometry")
        assert newest is not None
        assert newest.message.fields == {"left_ticks": 3, "right_ticks": -3}
        wait_until(lambda: mcu.latest("velocity") is not None, "the newest")
        assert {"velocity", "status_query"} <= set(mcu.rates().messages)


def test_it_sends_what_the_mcu_sends_and_hears_what_the_host_sends() -> None:
    with both(ROVER) as (_, mcu):
        with pytest.raises(MessageError, match="velocity is sent by the host, not by the mcu"):
            mcu.send("velocity")
        with pytest.raises(UsageError, match="odometry is sent by the mcu; it is never received here"):
            mcu.on("odometry")
        with pytest.raises(UsageError, match="no emergency stop was sent: the host sends it"):
            mcu.emergency_stop()
        with pytest.raises(UsageError, match="diffdrive has no deadline 'warn' at the mcu; it has stop, safe_mode"):
            mcu.on_deadline("warn")
        with pytest.raises(UsageError, match="role is 'robot'; expected 'host' or 'mcu'"):
            wirebond.open(ROVER, "/dev/null", role="robot")


def test_the_deadlines_are_those_of_the_mcu() -> None:
    text = """
wirebond: 1
protocol: mower
frame: [magic: 0xAA 0x55, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  drive: {id: 1, sender: host, fields: {speed: {type: i16}}}
  pose:  {id: 2, sender: mcu, fields: {x: {type: i16}}}
deadlines:
  - {message: drive, at: mcu, after: 100 ms, then: halt, recover: explicit}
  - {message: pose, at: host, after: 100 ms, then: warn}
"""
    with both(wirebond.Codec(loads(text))) as (host, mcu):
        assert (list(host.deadlines), list(mcu.deadlines)) == (["warn"], ["halt"])
        events: list[DeadlineEvent] = []
        got: list[Message] = []
        while not got:  # one that is 100 ms old, because this process was held up, is late
            host.send("drive", speed=1)
            got = mcu.receive(1)
        assert got[0]["speed"] == 1
        mcu.on_deadline("halt")(events.append)
        wait_until(lambda: events, "silence strikes")
        for _ in moments("the drive is held back"):
            host.send("drive", speed=2)  # one that is late is not counted there
            assert mcu.receive(0.1) == []
            if mcu.stats.held_back:
                break
        got = []
        while not got:  # where this process is held up for 100 ms, silence strikes again in between
            mcu.recover("halt")
            host.send("drive", speed=3)
            got = mcu.receive(1)
        assert {m["speed"] for m in got} == {3}


def test_messages_held_from_the_start_wait_for_recover_and_the_stop_acts_at_once() -> None:
    held = wirebond.load(ROOT / "tests" / "mcu_link" / "held.yaml")
    pty = PtyPort()
    with wirebond.open(held, pty.path, role="mcu") as mcu:
        heard: list[tuple[str, object]] = []
        mcu.on()(lambda message: heard.append((message.name, message.fields.get("speed"))))
        wait_until(lambda: mcu.deadlines["safe_mode"], "the deadline that has struck from the start")
        pty.write(held.encode("drive", speed=0.5, mode="manual") + held.encode("grip", force=1.0))
        wait_until(lambda: ("grip", None) in heard, "a message without a deadline")
        pty.write(held.encode("drive", speed=0.1, mode="idle") + held.encode("drive", speed=0.1, mode="manual"))
        wait_until(lambda: heard[-1] == ("drive", pytest.approx(0.1)), "the stop")
        # A command may also be late: as old as its deadline when it was read, because the machine is slow.
        wait_until(lambda: mcu.stats.held_back + mcu.stats.late == 2, "the two that are none")
        assert len(heard) == 2
        mcu.recover("safe_mode")
        pty.write(held.encode("drive", speed=0.25, mode="manual"))
        wait_until(lambda: heard[-1] == ("drive", pytest.approx(0.25)), "what acts again")
    pty.close()


def test_it_has_the_address_of_one_device() -> None:
    with both(SERVOS) as (host, mcu):
        assert mcu.address == 1  # the file's default
        mcu.address = 3

        @mcu.on("read")
        def answer(_: Message) -> None:
            mcu.send("pose", angle=0.25)

        assert host.request("read", timeout=PATIENCE, header={"servo": 3}).header["servo"] == 3
        host.send("move", angle=1, time=1, header={"servo": 4})
        host.send("move", angle=2, time=1, header={"servo": 3})
        host.send("move", angle=-1, time=1, header={"servo": 0xFE})  # a broadcast
        got: list[Message] = []
        while len(got) < 2:
            got += mcu.receive(PATIENCE)
        assert [m["angle"] for m in got] == [2, -1]
        assert mcu.stats.receive.foreign_frames == 1
        with pytest.raises(UsageError, match="the broadcast of servo"):
            mcu.address = 0xFE


def test_a_viewer_of_the_mcus_side_hears_every_address_and_answers_for_any() -> None:
    with line() as (a, b), wirebond.open(SERVOS, b.path, role="mcu", listen="all") as mcu:

        @mcu.on("read")
        def answer(message: Message) -> None:
            mcu.send("pose", angle=0.5, header={"servo": message.header["servo"]})

        with wirebond.open(SERVOS, a.path) as host:
            for servo in (2, 9):
                assert host.request("read", timeout=PATIENCE, header={"servo": servo})["angle"] == 0.5


def test_hello_is_answered_and_another_file_of_the_host_is_reported() -> None:
    with both(NATIVE) as (host, mcu):
        wait_until(lambda: host.peer.state == mcu.peer.state == "same", "hello, both ways")
    pty = PtyPort()
    with wirebond.open(NATIVE, pty.path, role="mcu") as mcu:
        assert mcu.peer.why == "the host has not said hello yet; check that its program runs"
        pty.write(NATIVE.encode("hello", protocol_hash=5, version=1, sender="host"))
        wait_until(lambda: mcu.peer.state == "different", "the hello of another file")
        assert mcu.peer.why.startswith("the host was built from another protocol file: its hash is 0000000000000005")
        heard: list[Message] = []
        decoder = NATIVE.decoder("mcu")
        wait_until(lambda: heard.extend(decoder.feed(pty.read(0.01))) or heard, "the answer")
        assert heard[0].fields == {"protocol_hash": NATIVE.hash, "version": 1}
    pty.close()


def test_a_dump_names_the_frames_of_both_directions() -> None:
    with both(ROVER) as (host, mcu):
        host.send("status_query")
        assert mcu.receive(PATIENCE)[0].name == "status_query"
        mcu.send("odometry", left_ticks=1, right_ticks=2)
        wait_until(lambda: mcu.stats.send.sent == 1, "the odometry leaves")
        frames = [(e.direction, e.message and e.message.name) for e in mcu.dump().entries if e.kind == "frame"]
        assert frames == [("received", "status_query"), ("sent", "odometry")]


def test_messages_of_both_ends_are_framed_as_the_mcus() -> None:
    text = """
wirebond: 1
protocol: chatter
frame: [magic: {host: 0xAA 0x55, mcu: 0x55 0xAA}, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  say: {id: 1, sender: both, fields: {word: {type: u8}}}
"""
    with both(wirebond.Codec(loads(text))) as (host, mcu):
        mcu.send("say", word=7)
        assert host.receive(PATIENCE)[0].raw[:2] == b"\x55\xaa"
        host.send("say", word=8)
        assert mcu.receive(PATIENCE)[0].raw[:2] == b"\xaa\x55"
