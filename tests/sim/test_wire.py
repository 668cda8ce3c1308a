"""Two ptys joined by a simulated wire: its pace, its faults, its cable, and its account."""

from __future__ import annotations

import json
import os
import random
import select
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import pytest
from tests.link.drivers import no_engine_ports
from tests.shared import codec
from tests.waiting import PATIENCE, Stopwatch, wait_until

import wirebond
from wirebond.analysis.diagnosis.uart import misread
from wirebond.cli.commands.wire import line_shape
from wirebond.cli.main import main
from wirebond.errors import UsageError
from wirebond.protocol import loads
from wirebond.protocol.model import Parity
from wirebond.sim.virtual_mcu import VirtualMcu
from wirebond.sim.wire import LineShape, WireProcess, WireSettings
from wirebond.sim.wire.process import DIRECTIONS
from wirebond.sim.wire.script import read_script

pytestmark = pytest.mark.live

DATA = bytes(i % 251 for i in range(3000))

# A pause of this machine within a frame is no silence.
SHARED_LINE = """
wirebond: 1
protocol: shared_line
link: {baud: 115200, echo: true, adapter_latency: 400 ms}
idle: 5 s
frame: [magic: 0xAA 0x55, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  ask: {id: 1, sender: host, reply: answer, fields: {number: {type: u32}}}
  answer: {id: 2, sender: mcu, fields: {number: {type: u32}}}
  note: {id: 3, sender: both, fields: {number: {type: u32}}}
"""


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def _compiled_once(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    monkeypatch.setenv("CXXFLAGS", "-O0")


@contextmanager
def opened(*paths: str) -> Iterator[list[int]]:
    ends = [os.open(path, os.O_RDWR | os.O_NOCTTY) for path in paths]
    try:
        yield ends
    finally:
        for end in ends:
            os.close(end)


def read(end: int, size: int, patience: float = PATIENCE) -> bytes:
    """So many bytes, or what has come when nothing more comes for so long."""
    data = b""
    while len(data) < size and select.select([end], [], [], patience)[0]:
        data += os.read(end, size - len(data))
    return data


def settled(wire: WireProcess, sizes: tuple[int, int]) -> dict[str, Any]:
    """Wait until the wire has taken this many bytes from each end and nothing travels any more; return its account."""
    account: dict[str, Any] = {}

    def has_settled() -> bool:
        account.update(wire.account())
        found = [account[direction] for direction in DIRECTIONS]
        return all(one["bytes"] == size and one["travelling"] == 0 for one, size in zip(found, sizes, strict=True))

    wait_until(has_settled, "all bytes are accounted for")
    return account


def closes(found: dict[str, Any]) -> bool:
    lost = sum(found[key] for key in ("handed_over", "not_read", "travelling", "unplugged", "dropped_bytes"))
    return bool(found["bytes"] + found["inserted_bytes"] == lost)


def test_bytes_pass_both_ways_and_no_faster_than_the_line() -> None:
    with WireProcess(WireSettings(baud=115200)) as wire, opened(wire.a, wire.b) as (a, b):
        watch = Stopwatch()
        os.write(a, DATA)
        os.write(b, DATA[::-1])
        assert read(b, len(DATA)) == DATA
        assert watch.seconds >= len(DATA) * 10 / 115200
        assert read(a, len(DATA)) == DATA[::-1]
        account = wire.end()
    for direction in DIRECTIONS:
        found = account[direction]
        assert found["bytes"] == found["handed_over"] == len(DATA)
        assert 0 < found["line_use"] <= 1
        assert closes(found)


@pytest.mark.parametrize(
    ("rate", "line"),
    [(57600, "8N1"), (38400, "8N1"), (250_000, "8N1"), (115200, "8E1"), (115200, "8O2"), (9600, "8E1")],
)
def test_an_end_with_other_settings_hears_what_a_uart_hears(rate: int, line: str) -> None:
    """As the model of a UART by which a wrong rate is diagnosed, which is another program."""
    shape = line_shape(line)
    parity = {"N": Parity.NONE, "E": Parity.EVEN, "O": Parity.ODD}[shape.parity]
    data = random.Random(rate).randbytes(500)  # the wire takes it at once
    settings = WireSettings(baud=115200, baud_b=rate, line_b=shape)
    with WireProcess(settings) as wire, opened(wire.a, wire.b) as (a, b):
        os.write(a, data)
        expected = misread(data, (115200, Parity.NONE), (rate, parity))
        got = read(b, len(expected))
        assert got == expected
        read(b, 1, 0.02)  # the rest of the line may end one more
        os.write(b, data)
        back = misread(data, (rate, parity), (115200, Parity.NONE))
        assert read(a, len(back)) == back
        account = wire.end()
    assert account["a_to_b"]["is_misheard"] and account["b_to_a"]["is_misheard"]
    assert account["a_to_b"]["bytes"] == len(data)
    assert account["a_to_b"]["handed_over"] - len(expected) in (0, 1)


def test_a_second_stop_bit_does_not_disturb_a_receiver_of_one() -> None:
    settings = WireSettings(baud=1_000_000, line=LineShape(8, "N", 2), line_b=LineShape(8, "N", 1))
    with WireProcess(settings) as wire, opened(wire.a, wire.b) as (a, b):
        os.write(a, DATA)
        assert read(b, len(DATA)) == DATA
        os.write(b, DATA)
        assert read(a, len(DATA)) == DATA
        assert not wire.end()["a_to_b"]["is_misheard"]


def scripted(folder: Path, text: str) -> WireSettings:
    script = folder / "faults"
    script.write_text(text)
    return WireSettings(baud=1_000_000, script=read_script(script))


def runs_for(wire: WireProcess, seconds: float) -> None:
    """Wait until the wire has run for this long, by its own clock."""
    wait_until(lambda: wire.account()["seconds"] >= seconds, "the wire's time passes")


def test_scripted_faults_come_at_their_times(tmp_path: Path) -> None:
    settings = scripted(
        tmp_path,
        """\ufeff
# as an editor of Windows writes it
0.0 a_to_b flip 0x80
0   a_to_b drop 2      # after the byte that changes nothing: both lie on the first one
0.05 b_to_a insert 0x55
0.1 unplug 0.05
0.2 a_to_b insert 0x66
1e5 a_to_b insert 0x77
""",
    )
    with WireProcess(settings) as wire, opened(wire.a, wire.b) as (a, b):
        os.write(a, b"12345")
        assert read(b, 3) == b"345"
        runs_for(wire, 0.15)  # the cable is in again
        os.write(b, b"abc")
        assert read(a, 4) == b"\x55abc"
        runs_for(wire, 0.2)
        os.write(a, b"6")
        assert read(b, 2) == b"\x666"
        account = settled(wire, (6, 3))
    assert (account["a_to_b"]["dropped_bytes"], account["a_to_b"]["inserted_bytes"]) == (2, 1)
    assert account["b_to_a"]["inserted_bytes"] == 1


def test_a_scripted_cable_is_out_from_its_time_on(tmp_path: Path) -> None:
    with WireProcess(scripted(tmp_path, "0.05 unplug 1e5")) as wire, opened(wire.a, wire.b) as (a, b):
        runs_for(wire, 0.05)
        os.write(a, b"out")
        account = settled(wire, (3, 0))
        assert read(b, 1, 0) == b""
    assert (account["a_to_b"]["unplugged"], account["a_to_b"]["handed_over"]) == (3, 0)


@pytest.mark.parametrize(
    ("line", "wrong"),
    [
        ("x drop", "the time is 'x'"),
        ("1 sideways drop", "there is no fault 'sideways'"),
        ("1 drop 0", "drop takes 1 to 1000000, not '0'"),
        ("1 flip 256", "flip takes 1 to 255"),
        ("1 unplug", "unplug needs a number of seconds"),
        ("1 a_to_b unplug 1", "for both directions"),
        ("1 split 3", "'3' is one word too many"),
        ("1 a_to_b", "there is no fault"),
    ],
)
def test_a_line_of_a_script_that_cannot_be_read_is_named(line: str, wrong: str, tmp_path: Path) -> None:
    script = tmp_path / "faults"
    script.write_text(f"1 drop\n{line}\n")
    with pytest.raises(UsageError, match="line 2: ") as caught:
        read_script(script)
    assert wrong in str(caught.value)


def test_a_writer_waits_for_the_line() -> None:
    """Beside what the wire has taken a pty's buffer holds some KB; behind that a write takes the time of the line. What
    comes for a reader that is held up, and finds no room there, is lost and counted."""
    with WireProcess(WireSettings(baud=1_000_000)) as wire, opened(wire.a, wire.b) as (a, b):
        watch = Stopwatch()
        data = DATA * 20
        sent, got = 0, b""
        while sent < len(data):
            readable, writable, _ = select.select([b], [a], [], PATIENCE)
            assert readable or writable
            if writable:
                sent += os.write(a, data[sent : sent + 500])
            if readable:
                got += os.read(b, 4096)
        found = settled(wire, (len(data), 0))["a_to_b"]
        got += read(b, found["handed_over"] - len(got))
        assert watch.seconds >= len(data) * 10 / 1_000_000
        assert len(got) == found["handed_over"] == len(data) - found["not_read"]
        assert got == data or found["not_read"]


def test_faults_change_bytes_as_the_account_says() -> None:
    settings = WireSettings(baud=4_000_000, drops=0.01, inserts=0.02, ber=1e-3, seed=3)
    with WireProcess(settings) as wire, opened(wire.a, wire.b) as (a, b):
        os.write(a, DATA)
        found = settled(wire, (len(DATA), 0))["a_to_b"]
        got = read(b, found["handed_over"])
        assert read(b, 1, 0) == b""
    assert got != DATA
    assert len(got) == found["handed_over"] == len(DATA) - found["dropped_bytes"] + found["inserted_bytes"]
    assert found["dropped_bytes"] > 5
    assert found["inserted_bytes"] > 10
    assert found["bit_errors"] > 10
    assert closes(found)


def test_a_pulled_cable_loses_bytes_and_the_account_says_how_many() -> None:
    with WireProcess(WireSettings(baud=1_000_000, unplug=(0.0, 1e6))) as wire, opened(wire.a, wire.b) as (a, b):
        os.write(a, DATA)
        found = settled(wire, (len(DATA), 0))["a_to_b"]
        assert read(b, 1, 0) == b""
    assert found["unplugged"] == found["bytes"] == len(DATA)
    assert closes(found)


def test_unread_bytes_are_lost_and_counted() -> None:
    with WireProcess(WireSettings(baud=20_000_000)) as wire, opened(wire.a) as (a,):
        for _ in range(40):
            os.write(a, DATA)
        found = wire.end()["a_to_b"]
    assert found["not_read"] > 0
    assert closes(found)


def test_command_names_both_ends_and_accounts_for_every_byte(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [str(tmp_path / "a"), str(tmp_path / "b")]
    assert main(["wire", *names, "--baud", "2000000", "--line", "8N2", "--seconds", "0.1", "--json"]) == 0
    account = json.loads(capsys.readouterr().out)
    assert all(closes(account[direction]) for direction in DIRECTIONS)
    assert main(["wire", *names, "--seconds", "0"]) == 0
    told = capsys.readouterr()
    assert told.out.split() == names
    assert f"{names[0]} to {names[1]}: 0 bytes, 0 came out, line use 0.0 %" in " ".join(told.err.split())
    assert not any(Path(name).is_symlink() for name in names)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--line", "9N1"], "--line 9N1: expected data bits, parity and stop bits, such as 8N1 or 8N2"),
        (["--unplug", "2"], "--unplug 2: expected AT:FOR in seconds, such as 2:0.5"),
        (["--unplug", "2:x"], "--unplug 2:x: expected AT:FOR"),
        (["--drops", "0.2"], "--drops 0.2: expected a probability from 0 to 0.1"),
        (["--baud", "20"], "--baud 20: expected 300 to 100000000"),
        (["--jitter", "2", "--batch", "1"], "--jitter is the delay that an adapter adds to its --batch"),
    ],
)
def test_options_out_of_range_are_refused(
    options: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["wire", str(tmp_path / "a"), str(tmp_path / "b"), *options]) == 2
    assert sentence in " ".join(capsys.readouterr().err.split())


class _FarEnd:
    """A virtual MCU's port at one end of a wire."""

    def __init__(self, end: int) -> None:
        self._end = end

    def read(self, timeout: float) -> bytes:
        return os.read(self._end, 4096) if select.select([self._end], [], [], timeout)[0] else b""

    def write(self, data: bytes) -> None:
        os.write(self._end, data)


def test_a_clock_is_not_moved_by_a_reply_that_is_longer_than_its_request(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 9600 baud the bytes of request and reply take 17 and 26 ms: half of the difference would be 4 ms."""
    axis = codec("linear_axis")
    monkeypatch.setattr("wirebond.link.services.byte_seconds", lambda _: 10 / 9600)  # a pty does not tell
    with WireProcess(WireSettings(baud=9600)) as wire, opened(wire.b) as (end,):
        over, mcu = threading.Event(), VirtualMcu(axis, time.monotonic())
        mcu._due.clear()  # it only answers
        far = _FarEnd(end)

        def answer() -> None:
            while not over.is_set():
                data = far.read(0.0005)
                far.write(mcu.feed(data, time.monotonic()))  # after the read: with an earlier time its stamps would lie

        thread = threading.Thread(target=answer)
        thread.start()
        try:
            with wirebond.open(axis, wire.a, 9600) as link:
                # With the bytes in it the error would be more than 21 ms. A busy computer adds its own delays.
                wait_until(lambda: link.clock is not None and link.clock.error < 0.015, "a small error")
                assert (found := link.clock) is not None
        finally:
            over.set()
            thread.join()
    assert abs(found.offset - mcu.start) <= found.error


def test_on_a_line_that_echoes_both_ends_hear_both_and_what_is_sent_at_once_collides() -> None:
    with WireProcess(WireSettings(baud=115200, echo=True)) as wire, opened(wire.a, wire.b) as (a, b):
        os.write(a, DATA[:200])
        assert read(a, 200) == read(b, 200) == DATA[:200]
        os.write(b, DATA[:100])
        assert read(a, 100) == read(b, 100) == DATA[:100]
        os.kill(wire.pid, signal.SIGSTOP)  # so that both are there when it looks next
        os.write(a, DATA)
        os.write(b, DATA[::-1])
        os.kill(wire.pid, signal.SIGCONT)
        heard = [read(end, 2 * len(DATA)) for end in (a, b)]
        assert [len(one) for one in heard] == [2 * len(DATA)] * 2
        assert DATA not in heard[0]
        account = wire.end()
    for direction in DIRECTIONS:
        assert 0.5 * len(DATA) < account[direction]["collided_bytes"] <= len(DATA)
        assert closes(account[direction])


@pytest.mark.parametrize("is_engine", [True, False])
def test_two_links_speak_over_a_line_that_echoes_and_a_collision_loses_only_its_own_frames(is_engine: bool) -> None:
    spoken = wirebond.Codec(loads(SHARED_LINE))
    ports = nullcontext() if is_engine else no_engine_ports()
    with (
        ports,
        WireProcess(WireSettings(baud=115200, echo=True)) as wire,
        wirebond.open(spoken, wire.b, role="mcu") as mcu,
        wirebond.open(spoken, wire.a) as host,
    ):
        mcu.on("ask")(lambda ask: mcu.send("answer", number=ask["number"]))
        for number in range(20):
            assert host.request("ask", number=number, timeout=PATIENCE)["number"] == number
        wait_until(lambda: mcu.stats.echoed_bytes == mcu.stats.send.sent_bytes, "the MCU hears itself")
        for end in (host, mcu):
            stats = end.stats
            assert stats.echoed_bytes == stats.send.sent_bytes > 0
            assert stats.collisions == sum(stats.receive.discarded_bytes.values()) == 0

        def collide() -> bool:
            for _ in range(40):  # both begin
                host.send("note", number=1)
                mcu.send("note", number=2)
            wait_until(lambda: host.stats.send.queued == mcu.stats.send.queued == 0, "all has left")
            settled(wire, (host.stats.send.sent_bytes, mcu.stats.send.sent_bytes))
            return host.stats.collisions > 0 and mcu.stats.collisions > 0

        wait_until(collide, "collisions are counted")
        assert host.request("ask", number=99, timeout=PATIENCE)["number"] == 99
