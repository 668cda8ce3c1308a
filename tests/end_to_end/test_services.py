"""Services with real peers: the simulation, and the firmware that has all of them, as a process."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

import wirebond
from tests.compilers import CXX
from tests.link.mcu import Mcu
from tests.shared import PROTOCOLS, ROOT, codec
from tests.waiting import PATIENCE, moments, wait_until
from wirebond.cli.main import main
from wirebond.generate.code import generate_cpp
from wirebond.sim.process import FirmwareProcess
from wirebond.sim.pty_port import PtyPort
from wirebond.sim.pty_port import run as serve
from wirebond.sim.virtual_mcu import VirtualMcu

pytestmark = pytest.mark.live

COMMAND = [str(Path(sys.executable).with_name("wirebond"))]
NATIVE = str(PROTOCOLS / "native.yaml")
AXIS = str(PROTOCOLS / "linear_axis.yaml")
FLAGS = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-Wshadow", "-Wconversion", "-O0", "-pthread"]


@dataclass
class Done:
    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., Done]:
    """A command in this process, which spares its start."""

    def call(*arguments: str) -> Done:
        patience = ["--timeout", f"{PATIENCE:g}"] if arguments[0] in ("param", "latency") else []
        code = main([*arguments, *([] if "--timeout" in arguments else patience)])
        told = capsys.readouterr()
        return Done(code, told.out, told.err)

    return call


def built(protocol: Path | str, folder: Path) -> Path:
    """The axis' firmware of a protocol file."""
    generate_cpp(wirebond.load(protocol).model, folder)
    axis = ROOT / "firmware" / "axis"
    folders = [folder, ROOT / "firmware", axis, ROOT / "ports" / "posix" / "include"]
    command = [CXX, *FLAGS, *(f"-I{one}" for one in folders), str(axis / "host" / "main.cpp"), "-o"]
    done = subprocess.run([*command, str(folder / "axis")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "axis"


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(AXIS, tmp_path_factory.mktemp("services"))


@pytest.fixture
def firmware(program: Path) -> Iterator[FirmwareProcess]:
    with FirmwareProcess(program, "the axis") as process:
        yield process


@contextmanager
def simulated(protocol: wirebond.Codec) -> Iterator[str]:
    """A virtual MCU on a pty; its path."""
    pty, over = PtyPort(), threading.Event()

    def turn() -> None:
        mcu = VirtualMcu(protocol, time.monotonic())
        while not over.is_set():
            serve(mcu, pty, time.monotonic() + 0.05, lambda _: None)

    thread = threading.Thread(target=turn)
    thread.start()
    try:
        yield pty.path
    finally:
        over.set()
        thread.join(PATIENCE)
        pty.close()


@pytest.fixture
def other_file(tmp_path: Path) -> Path:
    """The axis with one field of another scale: another hash."""
    path = tmp_path / "changed.yaml"
    path.write_text(Path(AXIS).read_text().replace("scale: 0.00001", "scale: 0.0001"))
    assert wirebond.load(path).hash != codec("linear_axis").hash
    return path


# ---- hello


def test_a_firmware_of_the_same_file_is_known_as_such(firmware: FirmwareProcess) -> None:
    with wirebond.open(AXIS, firmware.port) as link:
        wait_until(lambda: link.peer.state == "same", "the peer says hello")
        assert link.peer.hash == link.codec.hash


def test_a_firmware_of_another_file_is_reported_by_every_command(
    firmware: FirmwareProcess, other_file: Path, run: Callable[..., Done]
) -> None:
    other = str(other_file)
    for options in ([], ["--rate", "50", "--seconds", "0.3"]):
        for _ in moments("a firmware that says hello before the command ends"):
            sent = run("send", other, firmware.port, "move", "speed=0", *options)
            assert sent.returncode == 0
            if sent.stderr:
                break
        assert sent.stderr.count("the MCU was built from another protocol file") == 1
        assert "`wirebond diff`" in sent.stderr
    for _ in moments("a hello"):
        watched = run("monitor", other, firmware.port, "--json", "--seconds", "0.3")
        if hellos := [m for m in map(json.loads, watched.stdout.splitlines()) if m.get("message") == "hello"]:
            break
    assert watched.stderr.count("the MCU was built from another protocol file") == 1
    assert hellos[0]["peer"] == {"state": "different", "hash": f"{codec('linear_axis').hash:016x}"}


def test_a_simulation_says_hello_as_well() -> None:
    with simulated(codec("native")) as port, wirebond.open(NATIVE, port) as link:
        wait_until(lambda: link.peer.state == "same", "the peer says hello")


# ---- clock


def test_the_clock_of_a_firmware_is_followed_within_its_bound(firmware: FirmwareProcess) -> None:
    with wirebond.open(AXIS, firmware.port) as link:
        wait_until(lambda: link.clock is not None and link.clock.exchanges >= 6, "six exchanges")
        for _ in range(20):
            (*_, newest) = link.receive(PATIENCE)
            answer = link.host_time(
                int(newest.t * 1e6) & 0xFFFFFFFF, near=newest.t
            )  # its clock is that of this machine
            assert abs(answer.t - newest.t) <= answer.error < PATIENCE
        assert link.clock is not None
        assert link.clock.restarts == 0
        states: list[wirebond.Message] = []  # the first ones came before the clock was known

        def any_with_stamp() -> bool:
            states.extend(m for m in link.receive(0.05) if m.name == "state" and m.stamp is not None)
            return bool(states)

        wait_until(any_with_stamp, "a state with a stamp")
        for state in states:
            assert state.stamp is not None and state.stamp_error is not None
            apart = (round(state.stamp * 1e6) - state["measured"] + 2**31) % 2**32 - 2**31
            assert abs(apart) <= state.stamp_error * 1e6 + 1
        assert "clock_reply" not in {m.name for m in link.receive(0.1)}  # the exchanges are the link's own


def test_the_clock_begins_again_with_a_firmware_that_restarts(program: Path, tmp_path: Path) -> None:
    name = tmp_path / "mcu"
    with FirmwareProcess(program, "the axis") as first:
        name.symlink_to(first.port)
        with wirebond.open(AXIS, name) as link:
            wait_until(lambda: link.clock is not None, "the first clock")
            name.unlink()
            first.close()
            wait_until(lambda: link.state == "down", "the end of the port")
            with simulated(codec("linear_axis")) as port:  # its clock begins at zero
                name.symlink_to(port)
                wait_until(lambda: link.clock is not None and link.clock.restarts == 1, "the restart")
                assert link.clock is not None
                stamp = link.request("clock_request", host_us=1, timeout=PATIENCE)
                answer = link.host_time(stamp["sent_us"], near=stamp.t)
                assert -answer.error <= stamp.t - answer.t <= answer.error + PATIENCE


# ---- latency


def test_latency_of_a_firmware_in_a_table_and_as_json(firmware: FirmwareProcess, run: Callable[..., Done]) -> None:
    shown = run("latency", AXIS, firmware.port, "--count", "30", "--rate", "500")
    assert (shown.returncode, shown.stderr) == (0, "")
    assert "by ping: 30 asked in" in shown.stdout
    assert "0 lost (0.00%)" in shown.stdout
    for word in ("p50", "p99.9", "round trip", "to the MCU ±", "to the host ±", "####"):
        assert word in shown.stdout
    found = json.loads(run("latency", AXIS, firmware.port, "--count", "30", "--rate", "500", "--json").stdout)
    assert (found["asked"], found["answered"], found["lost"]) == (30, 30, 0)
    trip = found["round_trip"]
    assert 0 < trip["min_us"] <= trip["p50_us"] <= trip["p99_9_us"] == trip["max_us"]
    assert sum(one["count"] for one in found["histogram"]) == 30
    assert found["to_mcu"]["count"] > 0
    assert found["one_way_error_us"] > 0


def test_latency_by_a_request_of_a_simulation_without_ping(run: Callable[..., Done]) -> None:
    diffdrive = str(PROTOCOLS / "diffdrive.yaml")
    with simulated(codec("diffdrive")) as port:
        shown = run("latency", diffdrive, port, "--message", "status_query", "--count", "5")
        assert shown.returncode == 0
        assert "by status_query: 5 asked" in shown.stdout
        assert "to the MCU" not in shown.stdout
        nothing = run("latency", diffdrive, port)
        assert nothing.returncode == 2


def test_latency_without_an_answer_says_what_to_look_at_and_exits_with_1(run: Callable[..., Done]) -> None:
    pty = PtyPort()
    silent = run("latency", NATIVE, pty.path, "--count", "2", "--timeout", "0.1")
    pty.close()
    assert silent.returncode == 1
    assert "2 asked" in silent.stdout and "2 lost (100.00%)" in silent.stdout
    assert "no pong within 0.1 s of ping. Nothing at all comes; check the cable" in silent.stderr
    assert run("latency", NATIVE, "/dev/nowhere").returncode == 3
    assert run("latency", NATIVE, "/dev/nowhere", "--count", "0").returncode == 2


def test_ctrl_c_shows_what_was_measured() -> None:
    native = codec("native")
    mcu = Mcu(native, lambda m: native.encode("pong", number=m["number"]) if m.name == "ping" else b"")
    command = [*COMMAND, "latency", NATIVE, mcu.path, "--count", "1000000", "--rate", "1000", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        wait_until(lambda: len(mcu.heard) > 20, "the first pings")
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE)
    mcu.close()
    assert (process.returncode, err) == (0, "")
    assert json.loads(out)["answered"] > 0


# ---- parameters


def test_parameters_of_a_firmware_from_the_command_line(
    firmware: FirmwareProcess, tmp_path: Path, run: Callable[..., Done]
) -> None:
    port = firmware.port
    names = ["max_speed", "0.5", "acceleration", "5", "travel", "1"]
    assert run("param", "list", AXIS, port).stdout.split() == names
    done = run("param", "set", AXIS, port, "max_speed=0.25", "travel=0.75", "--json")
    assert (done.returncode, json.loads(done.stdout)) == (0, {"max_speed": 0.25, "travel": 0.75})
    refused = run("param", "set", AXIS, port, "acceleration=2.5", "travel=7")
    assert (refused.returncode, refused.stdout) == (1, "")
    assert "nothing was set; 1 refused" in refused.stderr
    assert "the MCU refused 7 for parameter travel: it is out of range; 0.75 stays in force" in refused.stderr
    assert run("param", "get", AXIS, port, "acceleration").stdout.split() == ["acceleration", "5"]
    missing = run("param", "get", AXIS, port, "kp")
    assert missing.returncode == 1
    assert "linear_axis has no parameter 'kp'" in missing.stderr
    stored = [line.partition(" ")[2] for line in firmware.events()]
    assert stored == ["parameter 0 is 0.250", "parameter 2 is 0.750", "parameter 1 is 2.500", "parameter 1 is 5.000"]

    file = tmp_path / "gains.yaml"
    saved = run("param", "save", AXIS, port, str(file))
    assert (saved.returncode, saved.stdout) == (0, "")
    assert file.read_text() == (
        "# Parameters of linear_axis, as its MCU had them.\nmax_speed: 0.25\nacceleration: 5.0\ntravel: 0.75\n"
    )
    file.write_text("max_speed: 1\ntravel: 0.5\n")
    assert run("param", "load", AXIS, port, str(file)).returncode == 0
    assert json.loads(run("param", "list", AXIS, port, "--json").stdout) == {
        "max_speed": 1.0,
        "acceleration": 5.0,
        "travel": 0.5,
    }
    file.write_text("max_speed: 1\n7: 0.5\n")
    assert run("param", "load", AXIS, port, str(file)).returncode == 1


def test_unreachable_parameters_are_reported_with_their_exit_code(run: Callable[..., Done]) -> None:
    assert run("param", "list", NATIVE, "/dev/nowhere").returncode == 3
    none = run("param", "list", str(PROTOCOLS / "diffdrive.yaml"), "/dev/nowhere")
    assert (none.returncode, "maps no `parameter` service" in none.stderr) == (2, True)
    assert run("param", "set", NATIVE, "/dev/nowhere", "0").returncode == 2
    assert run("param", "set", NATIVE, "/dev/nowhere", "0=x").returncode == 2
    pty = PtyPort()
    silent = run("param", "get", NATIVE, pty.path, "0", "--timeout", "0.05")
    pty.close()
    assert silent.returncode == 1
    assert "no parameter_value within 0.05 s of parameter_read. Nothing at all comes" in silent.stderr


def test_a_simulation_has_parameters() -> None:
    with simulated(codec("native")) as port, wirebond.open(NATIVE, port) as link:
        assert link.parameters.list() == {str(i): 0.0 for i in range(8)}
        assert link.parameters.set(3, 1.5, timeout=PATIENCE) == 1.5
        with pytest.raises(wirebond.ParameterError, match="the MCU has no parameter 8"):
            link.parameters.set(8, 1.5, timeout=PATIENCE)


# ---- log lines


def test_log_lines_of_a_firmware(firmware: FirmwareProcess, run: Callable[..., Done]) -> None:
    events: list[wirebond.LogEvent] = []
    with wirebond.open(AXIS, firmware.port) as link:
        link.on_log("warning")(events.append)
        firmware.tell("info all is well")
        firmware.tell("error motor 2 is hot")
        wait_until(lambda: "error: motor 2 is hot" in map(str, events), "the line")
    over = threading.Event()

    def say() -> None:
        while not over.wait(0.02):
            firmware.tell("warning again")

    saying = threading.Thread(target=say)
    saying.start()
    wait_until(
        lambda: "warning: again\n" in run("monitor", AXIS, firmware.port, "--seconds", "0.5").stdout,
        "the line is shown",
    )
    over.set()
    saying.join(PATIENCE)


# ---- counters


@pytest.fixture
def unhurried(tmp_path: Path) -> Path:
    """The axis, but a command is too old only after 100 s: same hash."""
    path = tmp_path / "unhurried.yaml"
    path.write_text(Path(AXIS).read_text().replace("after: 200 ms", "after: 100 s"))
    assert wirebond.load(path).hash == codec("linear_axis").hash
    return path


@pytest.fixture
def unhurried_firmware(unhurried: Path, tmp_path: Path) -> Iterator[FirmwareProcess]:
    """The axis' firmware, which rejects messages for what they say, and none because the machine was slow."""
    with FirmwareProcess(built(unhurried, tmp_path), "the axis") as process:
        yield process


def test_refusals_of_a_firmware_are_counted_alike_at_both_ends(
    unhurried: Path, unhurried_firmware: FirmwareProcess, tmp_path: Path, run: Callable[..., Done]
) -> None:
    firmware = unhurried_firmware
    axis = codec("linear_axis")
    frame = axis.encode("move", speed=0.5)
    damaged = frame[:3] + bytes([frame[3] ^ 4]) + frame[4:]
    noise = bytes([0, *range(1, 200), 0])
    port = os.open(firmware.port, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(port)
    sent = frame + 3 * damaged + noise + frame + frame[:-1] + b"\x00"
    os.write(port, sent)
    os.close(port)
    host = axis.decoder("host")  # the same bytes, judged at this end
    host.feed(sent)
    wider = tmp_path / "wider.yaml"
    wider.write_text(unhurried.read_text().replace("range: [-1.0, 1.0]", "range: [-3.0, 3.0]"))  # the same hash
    with wirebond.open(wider, firmware.port) as link:
        wait_until(lambda: link.peer.state == "same", "hello")
        for _ in range(7):
            link.send("move", speed=2.5)

        def told() -> wirebond.McuCounters | None:
            newest = link.latest("link_counters")
            return None if newest is None else link.codec.counters(newest.message)

        expected = host.stats.frames + link.stats.send.sent
        wait_until(lambda: (it := told()) is not None and it.values["frames"] >= expected, "a message of all")
        found = told()
    assert found is not None
    refused = {cause: n for cause, n in host.stats.discarded_bytes.items() if n}
    assert {"check_mismatch", "length_out_of_range"} <= refused.keys()
    assert found.refused_bytes == refused
    assert found.refused_messages == {"rejected": 7}
    sentence = (
        f"MCU refused {', '.join(f'{n} bytes as {cause}' for cause, n in refused.items())}, 7 messages as rejected"
    )
    # While nothing reads the port, the firmware finds the line full; it counts the frames that it could not send.
    full = r"(; of its own frames \d+ refused)?"
    assert re.fullmatch(re.escape(sentence) + full, str(found))
    shown_line = re.compile(rf"^[\d.]+ link_counters  {re.escape(sentence)}{full}$", re.MULTILINE)
    wait_until(
        lambda: shown_line.search(run("monitor", AXIS, firmware.port, "--seconds", "0.7").stdout),
        "the counters are shown",
    )
    for _ in moments("counters as JSON"):
        lines = run("monitor", AXIS, firmware.port, "--seconds", "0.7", "--json").stdout.splitlines()
        if shown := [m["counters"] for m in map(json.loads, lines) if m.get("message") == "link_counters"]:
            break
    counters = shown[0]
    assert re.fullmatch(re.escape(sentence) + full, counters["text"])
    unsent = {"unsent": counters["unsent"], "text": counters["text"]}
    assert counters == {**found.as_dict(), **unsent}
    assert counters["refused_bytes"] == refused


def test_a_simulation_says_what_it_refused() -> None:
    axis = codec("linear_axis")
    mcu = VirtualMcu(axis, 0.0)
    decoder = axis.decoder("mcu")
    frame = axis.encode("move", speed=0.5)
    mcu.feed(frame + frame[:3] + bytes([frame[3] ^ 4]) + frame[4:], 0.1)
    counters = [axis.counters(m) for m in decoder.feed(mcu.tick(0.6)) if m.name == "link_counters"]
    assert counters[-1] is not None
    assert (counters[-1].values["frames"], counters[-1].refused_bytes) == (1, {"check_mismatch": 7})
    assert str(counters[-1]) == "MCU refused 7 bytes as check_mismatch"
    assert axis.counters(axis.decoder("host").feed(frame)[0]) is None
