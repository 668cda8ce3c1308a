"""A link reports the settings of its line: those that its driver has set."""

from __future__ import annotations

import json
import resource
import socket
import subprocess
import sys
from pathlib import Path

import pytest

import wirebond
from tests.link.protocol import manipulator
from wirebond.sim.pty_port import PtyPort

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("ports")]

ARM = manipulator()

# A driver that knows the low-latency flag: `SHIM` says what it does with it.
_SHIM = """
#include <dlfcn.h>
#include <linux/serial.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>

static int flags;

int ioctl(int fd, unsigned long request, ...) {
  va_list list;
  va_start(list, request);
  void* argument = va_arg(list, void*);
  va_end(list);
  const char* shim = getenv("SHIM");
  if (request == TIOCGSERIAL && shim) {
    memset(argument, 0, sizeof(struct serial_struct));
    ((struct serial_struct*)argument)->flags = flags;
    return 0;
  }
  if (request == TIOCSSERIAL && shim) {
    if (!strcmp(shim, "accepted")) flags = ((struct serial_struct*)argument)->flags;
    return 0;
  }
  int (*next)(int, unsigned long, void*) = (int (*)(int, unsigned long, void*))dlsym((void*)-1l, "ioctl");
  return next(fd, request, argument);
}
"""

_ASK = """
import json, os, sys
import wirebond, wirebond.link.settings
from wirebond.sim.pty_port import PtyPort
wirebond.link.settings.HAS_ENGINE_PORTS = sys.argv[2] == "engine"
port = PtyPort()
said = []
for shim in (None, "refused", "accepted"):
    if shim:
        os.environ["SHIM"] = shim
    with wirebond.open(sys.argv[1], port.path) as link:
        said.append(link.line.low_latency)
print(json.dumps(said))
"""


@pytest.fixture
def pty() -> PtyPort:
    return PtyPort()


@pytest.fixture
def timer(pty: PtyPort, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The pty is an FTDI adapter, by what sysfs says of it."""
    file = tmp_path / "sys/bus/usb-serial/devices" / Path(pty.path).name / "latency_timer"
    file.parent.mkdir(parents=True)
    file.write_text("16\n")
    monkeypatch.setattr("wirebond.link.settings.ROOT", tmp_path)
    return file


def test_a_link_says_what_the_driver_made_of_its_settings(pty: PtyPort) -> None:
    with wirebond.open(ARM, pty.path, baud=1_234_567) as link:
        line = link.line
        assert line is not None
        assert (line.baud, line.asked_baud, line.data_bits, line.parity, line.stop_bits) == (
            *(1_234_567, 1_234_567),
            *(8, "none", 1),
        )
        assert (line.is_exclusive, line.low_latency, line.latency_timer) == (True, "not_offered", None)
        assert str(line) == (
            "1234567 baud, 8 data bits, parity none, 1 stop bit, exclusive, low latency not offered by the driver"
        )
        assert json.loads(json.dumps(line.as_dict()))["low_latency"] == "not_offered"


def test_a_driver_that_changes_them_is_reported(pty: PtyPort) -> None:
    codec = manipulator(", parity: even")  # a pty has no parity
    with wirebond.open(codec, pty.path) as link:
        assert link.line is not None
        assert link.line.parity == "none"


def test_the_latency_timer_of_an_adapter_is_set(pty: PtyPort, timer: Path) -> None:
    with wirebond.open(ARM, pty.path) as link:
        assert link.line is not None
        assert link.line.latency_timer == wirebond.LatencyTimer(16, 1)
        assert str(link.line).endswith("; latency timer 16 ms before, 1 ms now")
    assert timer.read_text().split() == ["1"]
    with wirebond.open(ARM, pty.path) as link:
        assert link.line is not None
        assert str(link.line).endswith("; latency timer 1 ms")


def test_a_latency_timer_that_cannot_be_set_has_its_sentence(pty: PtyPort, timer: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))  # for root, too, no file can be written
    try:
        link = wirebond.open(ARM, pty.path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    with link:
        assert link.line is not None
        found = link.line.latency_timer
    assert found is not None
    assert (found.before_ms, found.now_ms) == (16, 16)
    assert "it cannot be set to 1 ms (File too large)" in found.why
    assert f"`echo 1 | sudo tee {timer}`" in found.why


def test_a_driver_is_believed_of_low_latency_when_it_keeps_the_flag(ports: str, tmp_path: Path) -> None:
    (tmp_path / "shim.c").write_text(_SHIM)
    library = tmp_path / "shim.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, tmp_path / "shim.c", "-ldl"], check=True)
    command = [sys.executable, "-c", _ASK, "protocols/diffdrive.yaml", ports]
    done = subprocess.run(command, env={"LD_PRELOAD": str(library)}, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == ["not_offered", "refused", "accepted"]


def test_a_port_without_such_settings_has_no_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        name = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with wirebond.open(ARM, name) as link:
            assert link.line is None
    with wirebond.open(ARM, "/dev/ttyUSB77", wait_for_port=True) as link:
        assert link.line is None
