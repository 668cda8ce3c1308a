"""Threads that are in the engine while the program ends: it ends without an abort and without a traceback."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import PATIENCE

pytestmark = pytest.mark.live

ROOT = Path(__file__).resolve().parents[2]
OPENING = """
import threading, time
import wirebond
from wirebond.sim.pty_port import PtyPort

codec = wirebond.load("protocols/diffdrive.yaml")
began = threading.Barrier(4)


def open_and_close():
    port = PtyPort()
    wirebond.open(codec, port.path).close()
    began.wait()
    while True:
        try:
            wirebond.open(codec, port.path).close()
        except wirebond.LinkDownError:  # the program ends
            return


for _ in range(3):
    threading.Thread(target=open_and_close, daemon=True).start()
began.wait()
time.sleep({pause})
"""


ENCODING = """
import sys, threading
import wirebond

codec = wirebond.load("protocols/diffdrive.yaml")
began = threading.Barrier(4)
sys.setswitchinterval(1e-5)


class Slow:
    def __float__(self):
        return sum([0.001] * 50)  # other threads run meanwhile: the end finds this one within the engine


class Dying(Slow):
    def __del__(self):
        sum(i for i in range(50))


def encode(kind):
    began.wait()
    while True:
        codec.encode("velocity", linear=kind(), angular=kind())


for kind in (Slow, Slow, Dying):
    threading.Thread(target=encode, args=(kind,), daemon=True).start()
began.wait()
"""


def ends_well(program: str) -> None:
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("pause", [0.0, 0.01, 0.03])
def test_daemon_threads_that_open_links_do_not_abort_the_end(pause: float) -> None:
    ends_well(OPENING.replace("{pause}", str(pause)))


def test_daemon_threads_whose_values_run_python_code_do_not_abort_the_end() -> None:
    ends_well(ENCODING)
