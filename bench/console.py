"""Measures the cost of the console's server while a page is open, the age of its data, and the time that an hour of
history takes to show.

A process writes 8 000 frames a second to a pty, eight each millisecond, of two messages with eight fields each.
`wirebond serve --web` owns the other side. A process in the page's place wants the table of messages and two plots of
eight fields and ten seconds at 800 pixels, and says what it has drawn, as the page does.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

import wirebond
from bench.figures import Figure
from bench.serve import line, process, processor_time, say
from wirebond.protocol.model import End
from wirebond.recording.history.source import Source

PROTOCOL = Path(__file__).with_name("console.yaml")
SECONDS = 12.0
PER_MS = 8
ROUNDS = 3
HOUR = 3600
COMMAND = "make bench ONLY=console"

FEEDER = """
import sys, time, wirebond
from wirebond.sim.pty_port import PtyPort
path, seconds, per_ms = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
port = PtyPort()
proto = wirebond.load(path)
made = [proto.encode(name, {f: (n + k) % 30 for k, f in enumerate("abcdefgh")}) for n in range(500)
        for name in ("wheels", "joints")]
print(port.path, flush=True)
sys.stdin.readline()
number, began = 0, time.monotonic()
while (now := time.monotonic()) - began < seconds:
    due = int((now - began) * 1000) * per_ms
    if number < due:
        port.write(b"".join(made[n % 1000] for n in range(number, due)))
        number = due
    port.read(0.0005)
print(number, port.lost_bytes, flush=True)
sys.stdin.readline()
"""

PAGE = """
import json, struct, sys, time
import numpy as np
from websockets.sync.client import connect
(address, _, token), seconds = sys.argv[1].partition("#"), float(sys.argv[2])
plots = [{"id": name, "fields": [f"{name}.{f}" for f in "abcdefgh"], "seconds": 10, "pixels": 800}
         for name in ("wheels", "joints")]
ages, rounds, rate = [], 0, 0
with connect(address, compression=None, max_size=None) as socket:
    views = {"link": True, "messages": {"every": 0.1}, "plots": plots}
    socket.send(json.dumps({"token": token, "acks": True, "views": views}))
    print("ready", flush=True)
    end = time.monotonic() + seconds
    while (now := time.monotonic()) < end:
        said = socket.recv(timeout=5)
        if isinstance(said, bytes):
            (size,) = struct.unpack_from("<I", said)
            columns = json.loads(said[4:4 + size])["columns"]
            if columns and now > end - seconds / 2:
                newest = np.frombuffer(said, "<f8", columns[0]["n"], 4 + size)[-1]
                ages.append(time.monotonic() - newest)
        elif '"view":"end"' in said[:20]:
            rounds += 1
            socket.send(json.dumps({"seen": json.loads(said)["round"]}))
        elif '"view":"messages"' in said[:30]:
            rate = sum(row["rate"] for row in json.loads(said)["rows"])
ages.sort()
print(rounds, ages[len(ages) * 99 // 100], rate, flush=True)
"""


def measure() -> list[Figure]:
    runs = sorted(run() for _ in range(ROUNDS))
    spent, rounds, age = runs[len(runs) // 2]
    return [
        Figure("console_server_cpu", 100 * spent, "% of a core", 50, COMMAND),
        Figure("console_rounds_per_s", rounds, "1/s", 25, COMMAND, at_most=False),
        Figure("console_sent_age_ms_p99", 1e3 * age, "ms", 100, COMMAND),
        Figure("console_hour_ms_max", 1e3 * longest_look_at_an_hour(), "ms", 100, COMMAND),
    ]


def run() -> tuple[float, float, float]:
    """The share of a core that the server spent, rounds a second, and the age of the newest sample in a batch."""
    feeding = process([sys.executable, "-c", FEEDER, str(PROTOCOL), str(SECONDS), str(PER_MS)])
    with feeding as feed, serving(line(feed)) as (server, address):
        looking = process([sys.executable, "-c", PAGE, address, str(SECONDS - 1)])
        with looking as page:
            line(page)
            before = processor_time(server.pid)
            say(feed)
            line(feed)
            spent = processor_time(server.pid) - before
            rounds, age, rate = map(float, line(page).split())
            if rate < 0.98 * 1000 * PER_MS:  # on a busy machine a pty overflows
                raise RuntimeError(f"the page saw {rate:.0f} messages a second")
        say(feed)
        return spent / SECONDS, rounds / (SECONDS - 1), age


@contextmanager
def serving(port: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The server, and the address of its views with the token behind `#`."""
    with tempfile.TemporaryDirectory() as folder:
        command = [str(Path(sys.executable).with_name("wirebond")), "serve", str(PROTOCOL), port]
        told = Path(folder) / "told"
        with told.open("w") as file:
            server = subprocess.Popen(
                [*command, "--web", "0", "--no-browser"],
                stderr=file,
                env={"XDG_RUNTIME_DIR": folder, "PATH": "/usr/bin:/bin"},
            )
        try:
            end = time.monotonic() + 20
            while (found := re.search(r"http://([\d.:]+)/#token=(\S+)", told.read_text())) is None:
                if time.monotonic() > end or server.poll() is not None:
                    raise RuntimeError(f"the server did not start: {told.read_text()}")
                time.sleep(0.02)
            yield server, f"ws://{found[1]}/views#{found[2]}"  # type: ignore[misc]
        finally:
            server.terminate()
            server.wait()


def longest_look_at_an_hour() -> float:
    """The slowest of many looks at eight fields at 1 kHz for an hour: seconds of this thread."""
    codec = wirebond.load(PROTOCOL)
    source = Source(codec, End.HOST, codec.model.idle_seconds)
    random = np.random.default_rng(1)
    fields = "abcdefgh"
    for minute in range(HOUR // 60):
        t = 60.0 * minute + np.arange(60_000) / 1000
        columns = {name: random.normal(size=len(t)) for name in fields}
        source.history.add(End.MCU, {"wheels": {"t": t, "fields": columns}})
    longest = 0.0
    for seconds in (0.05, 1, 10, 100, 600, 1800, HOUR):
        for begin in np.linspace(0, HOUR - seconds, 7).tolist():
            before = time.thread_time()
            source.history.pixels([f"wheels.{name}" for name in fields], begin, begin + seconds, seconds / 800)
            longest = max(longest, time.thread_time() - before)
    return longest
