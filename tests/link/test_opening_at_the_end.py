"""Threads that open and close links while the program ends: it ends without an abort and without a traceback."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import PATIENCE

pytestmark = pytest.mark.live

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """
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


@pytest.mark.parametrize("pause", [0.0, 0.01, 0.03])
def test_daemon_threads_that_open_links_do_not_abort_the_end(pause: float) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.replace("{pause}", str(pause))],
        cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
