"""Measures the cost of sharing a link, and how soon a robot stops after its driver has gone.

The server's processor time with five clients, and what attaching adds to latency.

A process writes 8 000 frames a second to a pty, eight each millisecond. `wirebond serve` owns the other side; each
client is a process. The latency of a message is the time from the read that completed it (``Message.t``) to the
program that takes it; both are on the system's monotonic clock.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import wirebond
from bench.figures import Figure
from wirebond.sim.pty_port import PtyPort

PROTOCOL = Path(__file__).resolve().parents[1] / "protocols" / "diffdrive.yaml"
SECONDS = 8.0
PER_SECOND = 8000
CLIENTS = 5
ROUNDS = 3
STOPS = 10  # of each kind
COMMAND = "make bench ONLY=serve"

FEEDER = """
import sys, time, wirebond
from wirebond.sim.pty_port import PtyPort
path, seconds, per_ms = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
port = PtyPort()
proto = wirebond.load(path)
print(port.path, flush=True)
sys.stdin.readline()
number, began = 0, time.monotonic()
while (now := time.monotonic()) - began < seconds:
    due = int((now - began) * 1000) * per_ms
    if number < due:
        port.write(b"".join(proto.encode("odometry", left_ticks=n % 30000, right_ticks=0) for n in range(number, due)))
        number = due
    port.read(0.0005)
print(number, port.lost_bytes, flush=True)
sys.stdin.readline()
"""

TAKER = """
import sys, time, wirebond
path, port = sys.argv[1:]
late = []
with wirebond.open(path, port) as link:
    print("ready", flush=True)
    quiet = time.monotonic() + 5
    while time.monotonic() < quiet:
        for message in link.receive(0.2):
            now = time.monotonic()
            late.append(now - message.t)
            quiet = now + 1
    late.sort()
    print(len(late), late[len(late) // 2], late[len(late) * 99 // 100], link.stats.dropped_messages, flush=True)
"""


DRIVER = """
import sys, time, wirebond
with wirebond.open(sys.argv[1], sys.argv[2]) as link:
    while True:
        link.repeat("velocity", linear=1.0, angular=0.0, hold=60)
        time.sleep(0.02)
"""


def measure() -> list[Figure]:
    costs = sorted(cost() for _ in range(ROUNDS))
    spent = costs[len(costs) // 2][0]
    pairs = [(latency(attached=False), latency(attached=True)) for _ in range(ROUNDS)]
    added = sorted(attached - owned for owned, attached in pairs)
    return [
        Figure("serve_cpu", 100 * spent, "% of a core", 50, COMMAND),
        Figure("serve_lost", max(row[1] for row in costs), "messages", 0, COMMAND),
        Figure("killed_driver_ms_max", 1e3 * longest_until_safe(signal.SIGKILL), "ms", 350, COMMAND),
        Figure("stopped_driver_ms_max", 1e3 * longest_until_safe(signal.SIGSTOP), "ms", 350, COMMAND),
        Figure("attach_added_p99_ms", 1e3 * added[len(added) // 2], "ms", 5, COMMAND),
    ]


def cost() -> tuple[float, int]:
    """The share of a core that the server spent, and how many messages the clients lost together."""
    with feeder(SECONDS, PER_SECOND // 1000) as (feed, port), serving(port) as (server, address), ExitStack() as stack:
        takers = [stack.enter_context(taker(address)) for _ in range(CLIENTS)]
        before = processor_time(server.pid)
        say(feed)
        number, lost_bytes = map(int, line(feed).split())
        spent = processor_time(server.pid) - before
        if lost_bytes:
            raise RuntimeError("the server did not read the pty in time")
        counts = [int(line(each).split()[0]) for each in takers]
        say(feed)
        return spent / SECONDS, sum(number - count for count in counts)


def latency(*, attached: bool) -> float:
    """The 99th percentile in seconds, at 1 000 messages a second."""
    with feeder(SECONDS, 1) as (feed, port), ExitStack() as stack:
        address = stack.enter_context(serving(port))[1] if attached else port
        each = stack.enter_context(taker(address))
        say(feed)
        line(feed)
        found = float(line(each).split()[2])
        say(feed)
        return found


def longest_until_safe(end: signal.Signals) -> float:
    return max(until_safe(end) for _ in range(STOPS))


def until_safe(end: signal.Signals) -> float:
    """Seconds from the end of a program that drives to the safe value on the wire."""
    pty, codec = PtyPort(), wirebond.load(PROTOCOL)
    decoder = codec.decoder("host")
    try:
        with (
            serving(pty.path) as (_, address),
            process([sys.executable, "-c", DRIVER, str(PROTOCOL), address], quiet=True) as driver,
        ):
            wait_for_speed(pty, decoder, 1.0)
            began = time.monotonic()
            driver.send_signal(end)
            wait_for_speed(pty, decoder, 0.0)
            found = time.monotonic() - began
            driver.kill()
            return found
    finally:
        pty.close()


def wait_for_speed(pty: PtyPort, decoder: wirebond.Decoder, wanted: float) -> None:
    end = time.monotonic() + 10
    while time.monotonic() < end:
        if any(m.name == "velocity" and m["linear"] == wanted for m in decoder.feed(pty.read(0.002))):
            return
    raise RuntimeError(f"no velocity of {wanted} m/s left within 10 s")


@contextmanager
def feeder(seconds: float, per_ms: int) -> Iterator[tuple[subprocess.Popen[str], str]]:
    with process([sys.executable, "-c", FEEDER, str(PROTOCOL), str(seconds), str(per_ms)]) as feed:
        yield feed, line(feed)


@contextmanager
def taker(address: str) -> Iterator[subprocess.Popen[str]]:
    with process([sys.executable, "-c", TAKER, str(PROTOCOL), address]) as found:
        line(found)
        yield found


@contextmanager
def serving(port: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    with tempfile.TemporaryDirectory() as folder:
        command = [str(Path(sys.executable).with_name("wirebond")), "serve", str(PROTOCOL), port]
        with process(command, {"XDG_RUNTIME_DIR": folder}, quiet=True) as server:
            path = Path(folder) / "wirebond" / "diffdrive.sock"
            end = time.monotonic() + 10
            while not path.exists():
                if time.monotonic() > end or server.poll() is not None:
                    raise RuntimeError("the server did not start")
                time.sleep(0.01)
            yield server, f"wirebond://{path}"


@contextmanager
def process(
    command: list[str], more: dict[str, str] | None = None, quiet: bool = False
) -> Iterator[subprocess.Popen[str]]:
    found = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL if quiet else None,
        text=True,
        env=os.environ | (more or {}),
    )
    try:
        yield found
    finally:
        found.terminate()
        found.wait()


def say(to: subprocess.Popen[str]) -> None:
    assert to.stdin is not None
    to.stdin.write("\n")
    to.stdin.flush()


def line(of: subprocess.Popen[str]) -> str:
    assert of.stdout is not None
    return of.stdout.readline().strip()


def processor_time(pid: int) -> float:
    """Seconds of all its threads: proc(5), /proc/PID/stat."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
