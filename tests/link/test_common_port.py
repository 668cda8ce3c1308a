"""Several links on one port, each with a format of its own: what comes reaches each, and what they send stays whole."""

from __future__ import annotations

import contextlib
import errno
import gc
import os
import random
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.link.protocol import manipulator
from tests.shared import PROTOCOLS, account_closes
from tests.waiting import PATIENCE, let_pass, moments, wait_until
from wirebond import CommonPort, PortError, UsageError
from wirebond.cli.main import main
from wirebond.link import python_ports
from wirebond.link.common_port import opener_of
from wirebond.link.python_ports import LineSettings
from wirebond.protocol import loads
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

UBX = wirebond.load(PROTOCOLS / "contrib" / "ubx.yaml")
NMEA = wirebond.load(PROTOCOLS / "contrib" / "nmea.yaml")
COMMAND = [sys.executable, "-m", "wirebond.cli.main"]
POSITION = {
    "time_of_week": 1.0, "longitude": 8.5, "latitude": 47.4, "height": 400.0, "height_above_sea": 352.0,
    "horizontal_accuracy": 0.5, "vertical_accuracy": 0.8,
}  # fmt: skip


@pytest.fixture
def pty() -> Iterator[PtyPort]:
    port = PtyPort()
    yield port
    port.close()


def position(number: int) -> bytes:
    return UBX.encode("nav_posllh", POSITION | {"time_of_week": number / 1000})


def sentence(number: int) -> bytes:
    return NMEA.encode("sentence", {"text": f"GPGGA,{number}"}, sender="mcu")


def take(link: wirebond.Link, count: int) -> list[wirebond.Message]:
    found: list[wirebond.Message] = []
    for _ in moments("all messages"):
        found += link.receive(0.05)
        if len(found) >= count:
            break
    return found


def test_each_link_finds_its_own_messages_and_all_of_them(pty: PtyPort) -> None:
    source = random.Random("two formats")
    port = CommonPort(pty.path)
    with wirebond.open(UBX, port) as ubx, wirebond.open(NMEA, port) as nmea:
        assert (ubx.port, nmea.port, nmea.baud) == (pty.path, pty.path, UBX.model.link.baud)
        numbers: dict[str, list[int]] = {"ubx": [], "nmea": []}

        def say() -> None:
            for number in range(1000):
                name = source.choice(("ubx", "nmea"))
                numbers[name].append(number)
                frame = position(number) if name == "ubx" else sentence(number)
                noise = bytes(source.choices(b"\x01\x02\x03", k=source.randrange(3)))
                for data in (frame + noise)[:7], (frame + noise)[7:]:
                    pty.write(data)
                while pty.unread():  # what a pty has no room for is lost
                    let_pass(0.001)

        teller = threading.Thread(target=say)
        teller.start()
        positions: list[wirebond.Message] = []
        sentences: list[wirebond.Message] = []
        for _ in moments("all messages"):
            positions += ubx.receive(0.01)
            sentences += nmea.receive(0.01)
            if not teller.is_alive() and len(positions) + len(sentences) == 1000:
                break
        assert [round(m["time_of_week"] * 1000) for m in positions] == numbers["ubx"]
        assert [int(m["text"].split(",")[1]) for m in sentences] == numbers["nmea"]
        assert account_closes(ubx.stats.receive) and account_closes(nmea.stats.receive)
        assert ubx.stats.receive.bytes == nmea.stats.receive.bytes


def test_their_frames_leave_whole_and_one_after_the_other(pty: PtyPort) -> None:
    other = wirebond.Codec(loads(manipulator().model.text.replace("0xAA 0x55", "0x55 0xAA")))
    port = CommonPort(pty.path, baud=3_000_000)
    codecs = (manipulator(), other)
    links = [wirebond.open(codec, port, wait_for_port=True) for codec in codecs]
    heard = b""

    def send(link: wirebond.Link) -> None:
        for number in range(300):
            while True:
                try:
                    link.send("note", number=number, text=bytes(number % 90))
                    break
                except wirebond.QueueFullError:
                    let_pass(0.001)

    senders = [threading.Thread(target=send, args=(link,)) for link in links]
    for sender in senders:
        sender.start()
    for _ in moments("all frames"):
        heard += pty.read(0.01)
        if all(link.stats.send.messages.get("note") == 300 and link.stats.send.queued == 0 for link in links):
            break
    while more := pty.read(0.1):
        heard += more
    for sender in senders:
        sender.join()
    for link in links:
        link.close()
    for codec in codecs:
        decoder = codec.decoder("host")
        found = decoder.feed(heard) + decoder.finish()
        assert [m["number"] for m in found if m.name == "note"] == list(range(300))
    sizes = sum(link.stats.send.sent_bytes for link in links)
    assert len(heard) == sizes


def is_down(link: wirebond.Link) -> bool:
    return link.state == "down"


def test_all_come_back_when_the_port_does(tmp_path: Path) -> None:
    name = tmp_path / "tty"
    first = PtyPort()
    name.symlink_to(first.path)
    port = CommonPort(name)
    with wirebond.open(UBX, port) as ubx, wirebond.open(NMEA, port) as nmea:
        name.unlink()
        first.close()
        for link in (ubx, nmea):
            wait_until(partial(is_down, link), "the port is missed")
            assert "went away" in link.why or "there is no port" in link.why
        second = PtyPort()
        name.symlink_to(second.path)
        wait_until(lambda: "down" not in (ubx.state, nmea.state), "both are back")
        second.write(position(1) + sentence(2))
        assert [m.name for m in take(ubx, 1) + take(nmea, 1)] == ["nav_posllh", "sentence"]
    wirebond.open(UBX, name).close()  # the port is free again
    second.close()


def test_a_port_that_is_missing_at_first_comes_to_all(tmp_path: Path) -> None:
    name = tmp_path / "tty"
    port = CommonPort(name)
    with pytest.raises(PortError, match="there is no port"):
        wirebond.open(UBX, port)
    with wirebond.open(UBX, port, wait_for_port=True) as ubx, wirebond.open(NMEA, port, wait_for_port=True) as nmea:
        assert (ubx.state, nmea.state) == ("down", "down")
        pty = PtyPort()
        name.symlink_to(pty.path)
        wait_until(lambda: "down" not in (ubx.state, nmea.state), "both have it")
        assert nmea.baud == UBX.model.link.baud  # of the first one
    pty.close()


def test_one_that_ends_leaves_the_port_to_the_others_and_the_last_one_frees_it(pty: PtyPort) -> None:
    port = CommonPort(pty.path)
    with wirebond.open(UBX, port) as ubx:
        with wirebond.open(NMEA, port) as nmea:
            pty.write(sentence(1))
            assert len(take(nmea, 1)) == 1
        pty.write(position(2))
        assert len(take(ubx, 1)) == 1
        with pytest.raises(PortError, match="is in use by another program"):
            wirebond.open(UBX, pty.path)
    for _ in range(3):  # again by the same object, and by its name
        wirebond.open(NMEA, port).close()
        wirebond.open(UBX, pty.path).close()


def fill(link: wirebond.Link) -> None:
    with contextlib.suppress(wirebond.QueueFullError):
        while True:
            link.send("note", number=1, text=bytes(100))


def test_the_end_of_one_is_not_held_up_by_a_line_that_takes_nothing(pty: PtyPort) -> None:
    port = CommonPort(pty.path)
    flood, quiet = wirebond.open(manipulator(), port, paced=False), wirebond.open(NMEA, port)
    fill(flood)
    quiet.send("sentence", text="GPQ,1")
    quiet.close()
    pty.write(manipulator().encode("pose", x=5))
    assert take(flood, 1)[0]["x"] == 5
    flood.close()


def test_frames_of_the_other_format_are_nothing_wrong_and_noise_is(pty: PtyPort) -> None:
    port = CommonPort(pty.path)
    with wirebond.open(UBX, port) as ubx, wirebond.open(NMEA, port) as nmea:
        healthy = b"".join(position(number) + sentence(number) for number in range(100))
        pty.write(healthy)
        wait_until(lambda: ubx.stats.receive.bytes == nmea.stats.receive.bytes == len(healthy), "all bytes")
        assert [codec.name for codec in ubx.other_protocols] == ["nmea"]
        assert sum(ubx.stats.receive.discarded_bytes.values()) > len(healthy) / 4
        assert wirebond.diagnose(ubx) == wirebond.diagnose(nmea) == []
        pty.write(random.Random("noise").randbytes(2000))
        wait_until(lambda: ubx.stats.receive.bytes == nmea.stats.receive.bytes > len(healthy) + 1900, "all bytes")
        assert wirebond.diagnose(ubx) and wirebond.diagnose(nmea)


def test_a_server_for_each_file(pty: PtyPort, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    files = [str(PROTOCOLS / "contrib" / f"{name}.yaml") for name in ("ubx", "nmea")]
    command = [*COMMAND, "serve", *files, pty.path, "--recordings", str(tmp_path / "runs")]
    with ExitStack() as stack:
        server = stack.enter_context(subprocess.Popen(command, stderr=subprocess.PIPE, text=True))
        stack.callback(server.kill)
        assert server.stderr is not None
        told = [server.stderr.readline() for _ in range(2)]
        assert [line.split()[0] for line in told] == ["ubx", "nmea"]
        with wirebond.open("wirebond://ubx") as ubx, wirebond.open("wirebond://nmea") as nmea:
            for _ in moments("what only one of them finds"):
                pty.write(position(1) + sentence(2))
                found = {m.name for m in ubx.receive(0.1)}, {m.name for m in nmea.receive(0.1)}
                if all(found):
                    break
            assert found == ({"nav_posllh"}, {"sentence"})
            assert (ubx.baud, nmea.baud) == (UBX.model.link.baud, UBX.model.link.baud)
            assert [codec.name for codec in nmea.other_protocols] == ["ubx"]
            nmea.take_control()
            nmea.send("sentence", text="GPQ,GGA")
            wait_until(lambda: b"GPQ,GGA" in pty.read(0.05), "the sentence")
            told = list(iter(server.stderr.readline, "nmea: 1 client\n"))
            assert all(line.startswith(("ubx: ", "nmea: ")) for line in told)
        server.send_signal(signal.SIGINT)
        rest = server.stderr.read().splitlines()
        assert server.wait(PATIENCE) == 0
    assert [line.partition(":")[0] for line in rest[-2:]] == ["ubx", "nmea"]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--name", "gps"], "--name is for one protocol file, and there are 2"),
        (["--record", "run.mcap"], r"--record is for one .* run `wirebond record"),
        (["--tcp", "127.0.0.1:65535", "--seconds", "1"], "each file takes a port of its own"),
        (["--ros2"], "--ros2 is for one"),
        (["--mapping", "topics.yaml"], "--mapping is for one"),
    ],
)
def test_options_of_one_server(options: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    files = [str(PROTOCOLS / "contrib" / f"{name}.yaml") for name in ("ubx", "nmea")]
    assert main(["serve", *files, "/dev/none", *options]) == 2
    assert re.search(sentence, " ".join(capsys.readouterr().err.split()))
    assert main(["serve", files[0], files[0], "/dev/none"]) == 2
    assert "two of the files have the protocol ubx" in " ".join(capsys.readouterr().err.split())


def test_the_line_has_one_baud_rate(pty: PtyPort) -> None:
    port = CommonPort(pty.path)
    with wirebond.open(UBX, port), pytest.raises(PortError, match=r"at 38400 baud.*asks for 4800 baud"):
        wirebond.open(NMEA, port, 4800)
    with wirebond.open(NMEA, CommonPort(pty.path, 9600)) as link:
        assert link.baud == 9600
    with pytest.raises(UsageError, match="bits per second"):
        CommonPort(pty.path, 0)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("wirebond://rover", "several files to `wirebond serve`"),
        ("sim:", "carries one protocol"),
        ("replay:run.mcap", "carries one protocol"),
        ("", "the port's name is empty"),
    ],
)
def test_links_that_cannot_share_a_port(name: str, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        CommonPort(name)


def test_silence_that_ends_frames_needs_a_port_of_its_own(pty: PtyPort) -> None:
    with pytest.raises(UsageError, match="silence ends the frames of modbus_rtu"):
        wirebond.open(PROTOCOLS / "contrib" / "modbus_rtu.yaml", CommonPort(pty.path))


def test_a_forked_child_makes_one_of_its_own(pty: PtyPort) -> None:
    port = CommonPort(pty.path)
    with wirebond.open(UBX, port) as ubx, wirebond.open(NMEA, port):
        child = os.fork()
        if child == 0:
            try:
                wirebond.open(UBX, port)
            except PortError as error:
                os._exit(7 if "is its fork" in str(error) else 8)
            os._exit(9)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
        pty.write(position(3))
        assert len(take(ubx, 1)) == 1


# ---- with a scripted port


class ScriptedPort:
    """A `PythonPort` whose write waits until it is let go, or fails."""

    def __init__(self) -> None:
        self.comes: list[bytes] = []
        self.writes = 0
        self.failure: OSError | None = None
        self.gone = threading.Event()  # reads fail
        self.may_write = threading.Event()
        self.may_cancel = threading.Event()  # the first cancel comes to its end
        self.may_cancel.set()
        self.is_closed = False

    def read(self) -> tuple[bytes, float]:
        assert not self.is_closed
        let_pass(0.001)
        if self.gone.is_set():
            raise OSError(errno.EIO, "Input/output error")
        return (self.comes.pop(0) if self.comes else b""), time.monotonic()

    def write(self, data: bytes) -> int:
        assert not self.is_closed
        self.writes += 1
        self.may_write.wait(PATIENCE)
        if self.failure is not None:
            raise self.failure
        return len(data)

    def held(self) -> int:
        return 0

    def cancel(self) -> None:
        assert not self.is_closed
        if not self.may_write.is_set():
            self.may_write.set()
            assert self.may_cancel.wait(PATIENCE)
        assert not self.is_closed

    def close(self) -> None:
        self.is_closed = True

    def leave_to_parent(self) -> None:
        pass


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch) -> Callable[[], Any]:
    """Makes a branch of the port, as a link does; all ports that were opened are in ``opened``."""
    opened: list[ScriptedPort] = []

    def open_one(_: Any) -> ScriptedPort:
        opened.append(ScriptedPort())
        return opened[-1]

    monkeypatch.setattr(python_ports.PythonOpener, "open", open_one)
    port, settings = CommonPort("/dev/none"), LineSettings(9600, 8, "none", 1)
    make = opener_of(port, UBX, settings, Path("/")).open
    return lambda: (make(), opened)


def test_a_write_that_fails_ends_the_port_for_all_and_the_next_opening_is_another(scripted: Callable[[], Any]) -> None:
    (first, opened), (second, _) = scripted(), scripted()
    assert len(opened) == 1
    opened[0].failure = OSError(errno.EIO, "Input/output error")
    opened[0].may_write.set()
    with pytest.raises(OSError, match="Input/output error"):
        first.write(b"a")
    with pytest.raises(OSError, match="Input/output error") as caught:
        wait_until(lambda: second.read()[0], "the end of the port")
    assert caught.value.errno == errno.EIO
    assert opened[0].is_closed  # before any link can open it again
    third, _ = scripted()
    assert len(opened) == 2 and not opened[1].is_closed
    for branch in (first, second, third):
        branch.close()
    assert opened[1].is_closed


def test_a_link_that_reads_nothing_leaves_the_rest_with_the_system(scripted: Callable[[], Any]) -> None:
    (slow, opened), (quick, _) = scripted(), scripted()
    opened[0].comes = [bytes(1 << 14)] * 100
    got = 0
    for _ in moments("what fits"):
        got += len(quick.read()[0])
        if slow.pending > 1 << 16:
            break
    let_pass(0.05)
    while data := quick.read()[0]:
        got += len(data)
    assert got == slow.pending <= (1 << 16) + (1 << 14)
    for _ in moments("all"):
        got += len(quick.read()[0])
        slow.read()
        if got == 100 << 14:
            break
    slow.close()
    quick.close()


def test_a_cancelled_write_ends_while_another_links_is_under_way(scripted: Callable[[], Any]) -> None:
    (first, opened), (second, _) = scripted(), scripted()
    results: list[int] = []
    writers = [threading.Thread(target=lambda b=b: results.append(b.write(b"abc"))) for b in (first, second)]
    writers[0].start()
    wait_until(lambda: opened[0].writes == 1, "the first writes")
    writers[1].start()
    second.cancel()
    writers[1].join(PATIENCE)
    assert results == [0] and opened[0].writes == 1
    opened[0].may_write.set()
    writers[0].join(PATIENCE)
    assert results == [0, 3]
    second.close()
    first.close()


def test_it_is_not_closed_while_a_thread_cancels_it(scripted: Callable[[], Any]) -> None:
    branch, opened = scripted()
    port = opened[0]
    port.may_cancel.clear()
    results: list[int] = []
    writer = threading.Thread(target=lambda: results.append(branch.write(b"abc")))
    writer.start()
    wait_until(lambda: port.writes == 1, "it writes")
    canceller = threading.Thread(target=branch.cancel)
    canceller.start()
    writer.join(PATIENCE)
    assert results == [3]
    port.gone.set()
    let_pass(0.05)
    assert not port.is_closed
    port.may_cancel.set()
    canceller.join(PATIENCE)
    wait_until(lambda: port.is_closed, "the end of the port")
    branch.close()


def test_a_link_that_the_reader_of_the_port_collects_as_garbage_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    collects = threading.Event()

    class Collecting(ScriptedPort):
        def read(self) -> tuple[bytes, float]:
            if collects.is_set():
                gc.collect()
            return super().read()

    scripted = Collecting()
    monkeypatch.setattr(python_ports.PythonOpener, "open", lambda _: scripted)
    link = wirebond.open(UBX, CommonPort("/dev/none"))
    link.me = link  # type: ignore[attr-defined]
    gc.disable()
    try:
        del link
        collects.set()
        wait_until(lambda: scripted.is_closed, "the end of the port")
    finally:
        gc.enable()
