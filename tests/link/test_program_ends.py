"""The end of a program, and the bytes that its robot gets: real processes, observed from the far end of their pty."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.link.protocol import manipulator
from tests.shared import few_or_many
from tests.waiting import PATIENCE, let_pass, moments, wait_until
from wirebond.server import Server
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

ROOT = Path(__file__).resolve().parents[2]
FAST = {"speed": 1000, "turn": 7}
SAFE = {"speed": 0, "turn": 0}

# The worst moment: full speed under way for a minute to come, the queue full of other frames, the pty slow.
BEGIN = """
import gc, os, signal, sys, threading, time
import wirebond
from tests.link.protocol import manipulator

def drive():
    link = wirebond.open(manipulator(), sys.argv[1])
    link.repeat("drive", hold=60, speed=1000, turn=7)
    while "drive" not in link.stats.send.messages:  # behind a full queue it would get too old to leave
        time.sleep(0.001)
    try:
        while True:
            link.send("note", number=1, text=bytes(100))
    except wirebond.QueueFullError:
        print("ready", flush=True)
    return link

link = drive()
"""

_CTRL_C = "threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
# How it ends, and the exit code.
ENDS = {
    "close": ("link.close()", 0),
    "with": ("with link: pass", 0),
    "exception": ("raise RuntimeError('boom')", 1),
    "exception_in_with": ("with link: raise RuntimeError('boom')", 1),
    "system_exit": ("raise SystemExit(3)", 3),
    "sys_exit_in_a_function": ("def f(): sys.exit(4)\nf()", 4),
    "end_of_the_file": ("", 0),
    "handler_of_sigterm": (
        "signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))\nos.kill(os.getpid(), signal.SIGTERM)\ntime.sleep(60)",
        143,
    ),
    "ctrl_c_in_receive": (_CTRL_C + "link.receive(60)", -signal.SIGINT),
    "ctrl_c_in_an_iteration": (_CTRL_C + "for m in link: pass", -signal.SIGINT),
    "a_thread_takes_messages": (
        "threading.Thread(target=lambda: [m for m in link], daemon=True).start()\ntime.sleep(0.2)",
        0,
    ),
    "handlers": ("link.on()(print)\nlink.on_deadline()(print)\ntime.sleep(0.1)", 0),
    "ctrl_c_in_run": (_CTRL_C + "link.on()(print)\nlink.run()", -signal.SIGINT),
    "ctrl_c_in_a_request": (
        _CTRL_C + "while link.stats.send.queued > 9: time.sleep(0.001)\nlink.request('query', timeout=60)",
        -signal.SIGINT,
    ),
    "an_exception_in_a_thread": ("t = threading.Thread(target=lambda: 1 / 0)\nt.start()\nt.join()", 0),
}

# Each is like one that stays in `make test`.
_SELDOM = {"with", "exception_in_with", "sys_exit_in_a_function", "ctrl_c_in_an_iteration", "ctrl_c_in_run"}

# A link that is driven from Python, as where the engine has no ports.
IN_PYTHON = """
import wirebond.link.settings
wirebond.link.settings.HAS_ENGINE_PORTS = False
"""
ENDS_IN_PYTHON = ("close", "end_of_the_file", "exception", "ctrl_c_in_receive", "a_thread_takes_messages", "handlers")


@pytest.fixture
def port() -> Iterator[PtyPort]:
    pty = PtyPort()
    yield pty
    pty.close()


class Program:
    def __init__(self, port: PtyPort, text: str, *more: str) -> None:
        self._port = port
        self.data = b""
        self._process = subprocess.Popen(
            [sys.executable, "-c", text, port.path, *more],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )

    def wait_for(self, word: str) -> None:
        """The far end does not read meanwhile."""
        assert self._process.stdout is not None
        assert self._process.stdout.readline().strip() == word.encode()

    def read(self, seconds: float = 0.05) -> None:
        self.data += self._port.read(seconds)

    def tell(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(b"\n")
        self._process.stdin.flush()

    def signal(self, number: int) -> None:
        self._process.send_signal(number)

    def end(self) -> tuple[int, str]:
        """Read until it has ended and the pty is empty; its exit code, and what it said."""
        for _ in moments("the end of the program"):
            if self._process.poll() is not None:
                break
            self.read()
        before = -1
        while before != len(self.data):
            before = len(self.data)
            self.read(0.1)
        _, told = self._process.communicate()
        return self._process.returncode, told.decode()

    def drives(self) -> list[dict[str, Any]]:
        decoder = manipulator().decoder("host")
        messages = decoder.feed(self.data) + decoder.finish()
        return [dict(message.fields) for message in messages if message.name == "drive"]


@pytest.mark.parametrize(
    ("way", "ports"),
    [
        *(pytest.param(way, "", id=way, marks=[pytest.mark.long] if way in _SELDOM else []) for way in ENDS),
        *(
            pytest.param(way, IN_PYTHON, id=f"{way}_in_python", marks=[] if number < 2 else [pytest.mark.long])
            for number, way in enumerate(ENDS_IN_PYTHON)
        ),
    ],
)
def test_the_safe_value_leaves_when_a_program_ends(port: PtyPort, way: str, ports: str) -> None:
    text, expected = ENDS[way]
    program = Program(port, f"{ports}{BEGIN}{text}\n")
    program.wait_for("ready")
    code, told = program.end()
    drives = program.drives()
    assert FAST in drives
    assert drives[-1] == SAFE, told
    assert drives.count(SAFE) == 1
    assert code == expected
    if code == 0 and way != "an_exception_in_a_thread":
        assert told == ""


# The same with plain `send`, which has no lease that would end.
_SENDS = """
import os, signal, sys, threading, time
import wirebond
from tests.link.protocol import manipulator

link = wirebond.open(manipulator(), sys.argv[2])
link.send("drive", speed=1000, turn=7)
while link.stats.send.queued:  # what waits at the end is dropped
    time.sleep(0.001)
"""
_SENDING_ENDS = ("close", "with", "exception", "exception_in_with", "system_exit", "end_of_the_file")


@pytest.mark.parametrize(
    ("way", "over"),
    [
        *((way, "own") for way in _SENDING_ENDS),
        *((way, over) for over in ("python", "unix", "tcp") for way in ("exception", "end_of_the_file")),
    ],
)
def test_the_safe_value_leaves_when_a_program_ends_that_only_sent(
    port: PtyPort, tmp_path: Path, way: str, over: str
) -> None:
    text, expected = ENDS[way]
    with ExitStack() as stack:
        place = port.path
        if over in ("unix", "tcp"):
            own = stack.enter_context(wirebond.open(manipulator(), port.path))
            server = stack.enter_context(Server(own, tmp_path / "server.sock", tcp=("127.0.0.1", 0)))
            unix, tcp = f"wirebond://{server.path}", f"wirebond://127.0.0.1:{server.port}?token={server.token}"
            place = unix if over == "unix" else tcp
        program = Program(port, f"{IN_PYTHON if over == 'python' else ''}{_SENDS}{text}\n", place)
        code, told = program.end()
        assert program.drives() == [FAST, SAFE], told
        assert code == expected


@pytest.mark.parametrize(
    "way",
    [
        "del link",
        "link.me = link\ndel link\ngc.collect()",
        "link.on()(print)\ndel link",
        "link.run(0.1)\nlink.me = link\ndel link\ngc.collect()",
    ],
)
def test_the_safe_value_leaves_when_a_link_is_collected(port: PtyPort, way: str) -> None:
    program = Program(port, f"{BEGIN}{way}\nprint('collected', flush=True)\nsys.stdin.readline()\n")
    program.wait_for("ready")
    program.wait_for("collected")
    wait_until(lambda: program.read() or SAFE in program.drives(), "the safe value")
    assert program.drives()[-1] == SAFE  # while the program goes on
    program.tell()
    assert program.end() == (0, "")


def test_a_kill_sends_nothing_more(port: PtyPort) -> None:
    """As the guide says: from then on the MCU's deadline protects."""
    program = Program(port, BEGIN + "time.sleep(60)\n")
    program.wait_for("ready")
    program.signal(signal.SIGKILL)
    assert program.end()[0] == -signal.SIGKILL
    assert set(map(str, program.drives())) == {str(FAST)}


DAEMON = """
link = wirebond.open(manipulator(), sys.argv[1])
def take():
    while True:
        {call}
for _ in range(8):
    threading.Thread(target=take, daemon=True).start()
time.sleep(0.1)
"""


@few_or_many(1, 10)
@pytest.mark.parametrize(
    "call",
    [
        "link.receive(60)",
        pytest.param("link.receive(0.001)", marks=pytest.mark.long),
        pytest.param("link.receive()", marks=pytest.mark.long),
        "list(link)",
        pytest.param("link.stats", marks=pytest.mark.long),
        "link.latest('pose')",
        "link.run(0.1); link.receive(60)",
        "link.request('query', timeout=60)",
        "link.on()(lambda m: link.receive(60)); time.sleep(60)",
    ],
)
def test_daemon_threads_in_a_link_do_not_abort_the_interpreter(port: PtyPort, call: str, number: int) -> None:
    for _ in range(number):
        imports = BEGIN[: BEGIN.index("def drive")]
        program = Program(port, imports + DAEMON.format(call=call))
        code, told = program.end()
        assert code == 0, told
        assert "Fatal" not in told and "terminate" not in told


GARBAGE = """
link = wirebond.open(manipulator(), sys.argv[1])
class Sends:
    def __init__(self):
        self.me = self
    def __del__(self):
        link.stop_repeating("drive")
        link.stats
gc.set_threshold(1)
for _ in range(300):
    Sends()
    link.stats, link.deadlines, link.state, link.receive()
"""


@pytest.mark.parametrize("more", ["", "link.on()(print)\n"])
def test_a_garbage_collection_within_a_call_may_call_the_link(port: PtyPort, more: str) -> None:
    """A call that made objects under the link's lock would wait for itself."""
    calls = GARBAGE.replace("gc.set_threshold(1)", more + "gc.set_threshold(1)").replace(
        'link.stop_repeating("drive")', 'link.stop_repeating("drive"); link.receive(); link.latest("pose")'
    )
    calls = calls.replace(
        "Sends()\n", "Sends()\n    link.send('query'), link.latest('pose'), link.off(link.on()(repr))\n"
    )
    program = Program(port, BEGIN[: BEGIN.index("def drive")] + calls)
    assert program.end() == (0, "")


HANDLERS = """
from tests.link.protocol import without_deadlines
link = wirebond.open(without_deadlines(), sys.argv[1])
@link.on()
def show(message):
    print(message["x"], flush=True)
    if message["x"] == 3:
        {act}
print("open", flush=True)
link.run()
print("over", flush=True)
"""


@pytest.mark.parametrize(("act", "expected"), [("link.close()", 0), ("os.kill(os.getpid(), signal.SIGINT)", -2)])
def test_a_program_of_handlers_needs_no_loop(port: PtyPort, act: str, expected: int) -> None:
    program = Program(port, BEGIN[: BEGIN.index("def drive")] + HANDLERS.format(act=act) + "print('end', flush=True)\n")
    program.wait_for("open")
    for number in range(4):
        port.write(manipulator().encode("pose", x=number))
        program.wait_for(str(number))
    if expected == 0:
        program.wait_for("over")
    assert program.end()[0] == expected


BUSY = """
link = wirebond.open(manipulator(), sys.argv[1])
print("open", flush=True)
sys.stdout = open(os.devnull, "w")
@link.on()
def show(message):
    for _ in range(100):
        print("x" * 2000, flush=True)
sys.stdin.readline()
time.sleep(0.02)
"""


@few_or_many(3, 20)
def test_handlers_that_are_busy_at_the_end_do_not_abort_the_interpreter(port: PtyPort, number: int) -> None:
    """They print while the interpreter ends; a thread that dies with the lock of stdout would abort it."""
    poses = b"".join(manipulator().encode("pose", x=n) for n in range(5)) * 40
    for _ in range(number):
        program = Program(port, BEGIN[: BEGIN.index("def drive")] + BUSY)
        program.wait_for("open")
        port.write(poses)
        program.tell()
        code, told = program.end()
        assert (code, told) == (0, "")


FORK = """
child = os.fork()
if child == 0:
    try:
        link.send("drive", speed=9, turn=9)
        os._exit(1)
    except wirebond.LinkDownError as error:
        assert "its fork" in str(error), error
    for call in (
        lambda: link.request("query"), lambda: link.receive(60), lambda: list(link), lambda: link.latest("pose"),
        lambda: link.on()(print), lambda: link.run(), lambda: link.send("query"),
    ):
        try:
            call()
            os._exit(2)
        except wirebond.LinkDownError as error:
            assert "its fork" in str(error), error
    link.close()
    {end}
status = os.waitpid(child, 0)[1]
print("waited" if os.waitstatus_to_exitcode(status) in (0, {code}) else status, flush=True)
link.stop_repeating("drive")
link.send("lamp", level=1)
sys.stdin.readline()
os._exit(0)
"""


@pytest.mark.parametrize("ports", ["", pytest.param(IN_PYTHON, marks=pytest.mark.long)], ids=["engine", "python"])
@pytest.mark.parametrize("more", ["", "link.on()(print)\n"])
@pytest.mark.parametrize("end", ["sys.exit(0)", "del link; gc.collect(); os._exit(0)", "raise RuntimeError('boom')"])
def test_a_forked_child_sends_nothing(port: PtyPort, end: str, more: str, ports: str) -> None:
    begin = BEGIN.replace("while True:", "for _ in range(5):").replace(
        "    except wirebond.QueueFullError:\n        print", "    finally:\n        print"
    )
    program = Program(port, ports + begin + more + FORK.format(end=end, code=1 if "raise" in end else 0))
    program.wait_for("ready")
    program.wait_for("waited")
    lamp = manipulator().encode("lamp", level=1)
    wait_until(lambda: program.read() or lamp in program.data, "the lamp: the parent's link lives")
    assert set(map(str, program.drives())) == {str(FAST)}  # nobody stopped it
    program.tell()
    assert program.end()[0] == 0


@pytest.mark.usefixtures("ports")
def test_a_forked_child_does_not_keep_the_port(port: PtyPort) -> None:
    link = wirebond.open(manipulator(), port.path)
    child = os.fork()
    if child == 0:
        let_pass(PATIENCE)
        os._exit(0)
    try:
        link.close()
        wirebond.open(manipulator(), port.path).close()
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def descriptors_of(path: str) -> set[int]:
    return {int(one.name) for one in Path("/proc/self/fd").iterdir() if os.path.realpath(one) == path}


@pytest.mark.usefixtures("ports")
def test_a_child_that_has_not_begun_yet_does_not_keep_the_port_either(port: PtyPort) -> None:
    """Such a child has only a copy of each descriptor."""
    before = descriptors_of(port.path)
    link = wirebond.open(manipulator(), port.path)
    (descriptor,) = descriptors_of(port.path) - before
    copy = os.dup(descriptor)
    try:
        with pytest.raises(wirebond.PortError, match="is in use by another program"):
            wirebond.open(manipulator(), port.path)
        link.close()
        wirebond.open(manipulator(), port.path).close()
    finally:
        os.close(copy)
