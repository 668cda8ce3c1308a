"""If silence ends a frame, the host keeps the pause between its frames. It accepts frames that arrive close together,
also from a port that may hold back bytes. Under virtual time, and over a pty."""

from __future__ import annotations

from pathlib import Path

import pytest

import wirebond
from tests.link.drivers import VirtualDriver
from tests.waiting import Stopwatch, let_pass, moments, wait_until
from wirebond import _engine
from wirebond.errors import ProtocolFileError, UsageError
from wirebond.link.settings import engine_settings
from wirebond.protocol import loads
from wirebond.protocol.model import End
from wirebond.sim.pty_port import PtyPort

FILE = """
wirebond: 1
protocol: quiet
link: {baud: 115200%s}
frame:
  - {field: address, type: u8, default: 1}
  - id: u8
  - payload: rest
  - check: crc-16/modbus
  - silence: 2 ms
messages:
  set: {id: 6, sender: host, every: 5 ms, fields: {place: {type: u16}}}
  state: {id: 4, sender: mcu, fields: {number: {type: u16}}}
emergency_stop: {message: set, place: 0}
"""


def quiet(more: str = "") -> wirebond.Codec:
    return wirebond.Codec(loads(FILE % more))


def decoded(codec: wirebond.Codec, arrivals: list[tuple[float, bytes]]) -> list[int]:
    """Return the messages that the other end decodes from bytes and their times; none may be discarded."""
    decoder = codec.decoder("host")
    found = []
    for t, data in arrivals:
        found += decoder.idle(t)
        found += decoder.feed(data, t)
    found += decoder.finish()
    assert sum(decoder.stats.discarded_bytes.values()) == 0
    return [message["place"] for message in found]


@pytest.mark.parametrize("paced", [True, False])
def test_frames_that_are_sent_at_once_leave_with_the_pause_between_them(paced: bool) -> None:
    codec = quiet()
    driver = VirtualDriver(codec, paced=paced)
    for place in range(1, 21):
        driver.send("set", place=place)
    arrivals: list[tuple[float, bytes]] = []
    seen = 0
    while driver.stats()["send"]["queued"] or driver.buffered:
        driver.run(0.0001)
        data = driver.arrived()
        if len(data) > seen:
            arrivals.append((driver.now / 1e6, data[seen:]))
            seen = len(data)
        assert driver.now < 3_000_000
    assert decoded(codec, arrivals) == list(range(1, 21))
    assert driver.now / 1e6 - 1 < 20 * (6 * 10 / 115200 + 0.0042)  # and no longer than that


def test_a_stop_and_repeated_values_keep_the_pause() -> None:
    codec = quiet()
    driver = VirtualDriver(codec)
    driver.repeat("set", hold=0.03, place=7)
    for place in range(1, 6):
        driver.send("set", place=place)
    arrivals: list[tuple[float, bytes]] = []
    seen = 0
    for step in range(1500):
        if step == 200:
            driver.emergency_stop()
        driver.run(0.0001)
        data = driver.arrived()
        if len(data) > seen:
            arrivals.append((driver.now / 1e6, data[seen:]))
            seen = len(data)
    places = decoded(codec, arrivals)
    assert 7 in places
    assert places[-1] == 0
    assert len(places) > 20


def state(codec: wirebond.Codec, number: int) -> bytes:
    return codec.encode("state", {"number": number})


@pytest.mark.parametrize("latency", [0.0, 0.016])
def test_frames_a_pause_apart_arrive_also_from_a_port_that_may_hold_bytes_back(latency: float) -> None:
    codec = quiet()
    driver = VirtualDriver(codec, adapter_latency=latency)
    for number in range(40):
        driver.answer(state(codec, number))
        driver.run(0.008)
    driver.run(0.05)
    assert [m["number"] for m in driver.receive()] == list(range(40))


@pytest.mark.parametrize("latency", [0.0, 0.016])
def test_a_damaged_frame_takes_no_other_with_it(latency: float) -> None:
    codec = quiet()
    driver = VirtualDriver(codec, adapter_latency=latency)
    for number in range(40):
        frame = state(codec, number)
        driver.answer(frame[:-1] if number % 3 == 1 else frame)
        driver.run(0.008)
    driver.run(0.05)
    assert [m["number"] for m in driver.receive()] == [n for n in range(40) if n % 3 != 1]
    stats = driver.core.stats()
    assert stats["discarded_bytes"]["length_out_of_range"] + stats["discarded_bytes"]["check_mismatch"] == 13 * 5


def test_a_frame_that_a_usb_adapter_delivers_in_pieces_is_one() -> None:
    codec = quiet(", adapter_latency: 16 ms")
    driver = VirtualDriver(codec, adapter_latency=codec.model.link.adapter_latency)
    frame = state(codec, 5)
    for at in range(len(frame)):
        driver.answer(frame[at : at + 1])
        driver.run(0.010)
    driver.run(0.05)
    assert [m["number"] for m in driver.receive()] == [5]


def test_a_frame_is_not_cut_where_nobody_looked_in_time() -> None:
    """Guarantee 2: only a read that began after the silence, and found nothing, gives a frame up."""
    codec = quiet()
    core = _engine.LinkCore(
        codec.tables.protocol, codec.tables.format_for(End.MCU), engine_settings(codec, 115200), 1_000_000
    )
    core.port_up(1_000_000)
    frame = state(codec, 9)
    core.received(frame[:3], 1_000_000, 1_000_010)
    core.received(frame[3:], 1_030_000, 1_030_010)  # the thread slept for 30 ms; the bytes may have lain there
    core.idle(1_033_000)
    assert [m["number"] for m in core.receive()] == [9]


@pytest.mark.live
def test_forty_frames_eight_milliseconds_apart_arrive_over_a_pty() -> None:
    """And further apart where the thread reads late: no receiver could tell two frames apart that come in one read."""
    codec = quiet()
    pty = PtyPort()
    try:
        with wirebond.open(codec, pty.path) as link:
            for number in range(40):
                pty.write(state(codec, number))
                let_pass(0.008)
                wait_until(lambda number=number: link.stats.receive.frames == number + 1, "silence ends the frame")
            assert [m["number"] for m in link.receive()] == list(range(40))
    finally:
        pty.close()


@pytest.mark.live
def test_a_burst_leaves_a_pty_no_faster_than_its_pauses_allow() -> None:
    codec = quiet()
    pty = PtyPort()
    try:
        with wirebond.open(codec, pty.path) as link:
            watch = Stopwatch()
            for place in range(1, 31):
                link.send("set", place=place)
            arrived = b""
            for _ in moments("all bytes"):
                arrived += pty.read(0.05)
                if len(arrived) >= 30 * 6:
                    break
            took = watch.seconds
    finally:
        pty.close()
    assert arrived == b"".join(codec.encode("set", {"place": place}) for place in range(1, 31))
    assert took > 29 * (0.004 + 6 * 10 / 115200)


# ---- what the port may hold back


@pytest.mark.parametrize(
    ("device", "expected"),
    [
        ("devices/pci0000:00/usb1/1-1/1-1:1.0/ttyX0", 16_000),
        ("devices/platform/serial8250/ttyX0", 1388),
        (None, 0),
    ],
)
def test_the_device_says_how_long_a_port_holds_bytes_back(tmp_path: Path, device: str | None, expected: int) -> None:
    (tmp_path / "class" / "ttyX0").mkdir(parents=True)
    if device is not None:
        (tmp_path / device).mkdir(parents=True)
        (tmp_path / "class" / "ttyX0" / "device").symlink_to(tmp_path / device)
    by_id = tmp_path / "usb-adapter"
    (tmp_path / "ttyX0").touch()
    by_id.symlink_to(tmp_path / "ttyX0")
    assert _engine.port_latency_us(str(by_id), 11520, str(tmp_path / "class")) == expected


@pytest.mark.live
def test_the_file_and_the_program_say_what_a_port_holds_back() -> None:
    pty = PtyPort()
    try:
        for codec, given, expected in (
            (quiet(), None, 0.0),
            (quiet(", adapter_latency: 4 ms"), None, 0.004),
            (quiet(", adapter_latency: 4 ms"), 0.002, 0.002),
        ):
            with wirebond.open(codec, pty.path, adapter_latency=given) as link:
                assert link.adapter_latency == expected
        with pytest.raises(UsageError, match="adapter_latency is 2 s; expected 0 to 1 s"):
            wirebond.open(quiet(), pty.path, adapter_latency=2)
    finally:
        pty.close()
    with pytest.raises(ProtocolFileError, match="a port holds bytes back for 1 s at most"):
        quiet(", adapter_latency: 2 s")
