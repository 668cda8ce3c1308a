"""A link finds its port: at the start, after the port went away; and its reports until then."""

from __future__ import annotations

import errno
import os
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import wirebond
from tests.link.protocol import manipulator, without_deadlines
from tests.shared import account_closes, lasting_port
from tests.waiting import PATIENCE, wait_until
from wirebond import LinkDownError, PortError, UsageError
from wirebond.sim.pty_port import PtyPort

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("ports")]
POSE = manipulator().encode("pose", x=7)
ARM = manipulator().encode("arm", torque=5)


@pytest.fixture
def pty() -> Iterator[PtyPort]:
    port = PtyPort()
    yield port
    port.close()


class Server:
    """A serial server: one connection at a time, on a port of loopback that stays the same."""

    def __init__(self) -> None:
        self._number = lasting_port()
        self.name = f"tcp://127.0.0.1:{self._number}"
        self.listen()

    def accept(self) -> socket.socket:
        self._listener.settimeout(PATIENCE)
        connection, _ = self._listener.accept()
        connection.settimeout(PATIENCE)
        return connection

    def close(self) -> None:
        self._listener.close()

    def listen(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", self._number), backlog=1)


@pytest.fixture
def server() -> Iterator[Server]:
    found = Server()
    yield found
    found.close()


def wait(link: wirebond.Link, holds: Callable[[], bool]) -> None:
    wait_until(holds, lambda: f"{link.state}: {link.why}")


def first(link: wirebond.Link) -> wirebond.Message:
    (message,) = link.receive(PATIENCE)
    return message


def read(connection: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        data += connection.recv(size - len(data))
    return data


# ---- TCP


def test_frames_go_both_ways_over_tcp_and_the_link_comes_back(server: Server) -> None:
    # A pause of the machine is silence, too, and would hold the next pose back.
    with wirebond.open(without_deadlines(), server.name) as link:
        connection = server.accept()
        connection.sendall(POSE)
        assert first(link).fields == {"x": 7}
        link.send("arm", torque=5)
        assert read(connection, len(ARM)) == ARM
        server.close()
        connection.close()
        wait(link, lambda: link.state == "down")
        wait(link, lambda: "nothing listens at" in link.why)  # what the newest try found
        with pytest.raises(LinkDownError, match="arm was not sent: nothing listens at tcp://"):
            link.send("arm", torque=5)
        server.listen()
        connection = server.accept()
        wait(link, lambda: link.state != "down")
        connection.sendall(POSE)
        assert first(link).fields == {"x": 7}
        assert link.why == ""
        link.send("arm", torque=5)
        assert read(connection, len(ARM)) == ARM
        stats = link.stats
        assert (stats.reconnects, stats.send.refused_down) == (1, 1)
        assert account_closes(stats.receive)
        connection.close()


def test_a_missing_server_is_reported_and_awaited(server: Server) -> None:
    server.close()
    with pytest.raises(PortError, match="; start the server there, or check"):
        wirebond.open(without_deadlines(), server.name)
    with wirebond.open(without_deadlines(), server.name, wait_for_port=True) as link:
        assert link.state == "down"
        server.listen()
        server.accept().sendall(POSE)
        assert first(link).name == "pose"
        assert link.stats.reconnects == 0  # it had never been there


def test_close_does_not_wait_for_a_server_that_does_not_answer(server: Server) -> None:
    """The listener's backlog is full, so that nothing answers the link's next try."""
    link = wirebond.open(without_deadlines(), server.name, wait_for_port=True)
    held = server.accept()
    others = []
    for _ in range(3):
        other = socket.socket()
        other.setblocking(False)
        other.connect_ex(held.getsockname())
        others.append(other)
    held.close()
    wait(link, lambda: link.state == "down")
    closing = threading.Thread(target=link.close)
    closing.start()
    closing.join(PATIENCE)
    assert not closing.is_alive()
    for other in others:
        other.close()


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("tcp://", "has no host; give tcp://host:port"),
        ("tcp://robot", "has no TCP port number; give"),
        ("tcp://robot:0", "has no TCP port number; give"),
        ("tcp://robot:serial", "has no valid host and number; give"),
        ("tcp://robot:70000", "has no valid host and number; give"),
        ("tcp://robot:5000/dev/ttyS0", "has more than a host and a number; give"),
        ("tcp://me@robot:5000", "has more than a host and a number; give"),
        ("rfc2217://robot", "has no TCP port number; give rfc2217://host:port"),
        ("rfc2217://robot:5000?logging=debug", "has more than a host and a number; give"),
        ("http://robot:5000", "is not a port that can be opened; give a tty"),
        ("udp://robot:5000", "UDP loses packets and changes their order; give tcp://robot:5000 if"),
        ("sim", "sim is not a port; `sim:`, with a colon, is a simulated device"),
        ("COM3", "COM3 is a port of Windows, and this is another system; on Linux a USB adapter is /dev/ttyUSB0 or"),
        ("com12:", "is a port of Windows"),
        ("can0", "can0 is an interface of CAN, and Wirebond needs a serial port, such as /dev/ttyUSB0"),
        ("vcan1", "is an interface of CAN"),
        ("replay:", "replay: names no recording; give replay:run.mcap"),
    ],
)
def test_a_name_that_is_no_port_is_reported(name: str, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        wirebond.open(without_deadlines(), name)


# ---- ttys


def test_a_tty_that_is_not_there_yet_is_found_when_it_appears(tmp_path: Path, pty: PtyPort) -> None:
    """Also where not even its folder is there, as /dev/serial/by-id before the first device."""
    name = tmp_path / "serial" / "by-id" / "arm"
    with pytest.raises(PortError, match="there is no port"):
        wirebond.open(without_deadlines(), name)
    with wirebond.open(without_deadlines(), name, wait_for_port=True) as link:
        assert link.state == "down"
        assert link.why.startswith(f"there is no port {name}; plug it in")
        with pytest.raises(LinkDownError, match="arm was not sent: there is no port"):
            link.send("arm", torque=1)
        name.parent.mkdir(parents=True)
        name.symlink_to(pty.path)
        wait(link, lambda: link.state != "down")
        assert link.why == ""
        pty.write(POSE)
        assert first(link).name == "pose"


def test_a_usb_device_is_found_again_under_another_name(monkeypatch: pytest.MonkeyPatch, pty: PtyPort) -> None:
    where = [pty.path]

    def find(name: str) -> str:
        if not where:
            raise PortError(f"no USB serial port is {name} at the moment; plug it in", errno.ENOENT, name)
        return where[0]

    monkeypatch.setattr("wirebond.link.devices.port_name.resolve", find)
    with wirebond.open(without_deadlines(), "usb:1a86:55d3") as link:
        pty.write(POSE)
        assert first(link).name == "pose"
        where.clear()
        gone, second = PtyPort(), PtyPort()
        os.dup2(gone.fileno(), pty.fileno())  # the first one hangs up
        gone.close()
        wait(link, lambda: link.state == "down" and "no USB serial port is usb:1a86:55d3" in link.why)
        where.append(second.path)
        wait(link, lambda: link.state != "down")
        second.write(POSE)
        assert first(link).name == "pose"
    where.clear()
    with pytest.raises(PortError, match="no USB serial port is usb:1a86:55d3 at the moment; plug it in") as error:
        wirebond.open(without_deadlines(), "usb:1a86:55d3")
    assert error.value.errno == errno.ENOENT


def test_a_usb_name_that_is_misspelt_is_reported() -> None:
    with pytest.raises(UsageError, match="the vendor '0x1a8' is not four hex digits"):
        wirebond.open(without_deadlines(), "usb:0x1a8:55d3", wait_for_port=True)


def test_a_busy_tty_is_waited_for(pty: PtyPort) -> None:
    owner = wirebond.open(without_deadlines(), pty.path)
    with wirebond.open(without_deadlines(), pty.path, wait_for_port=True) as link:
        assert "in use by another program" in link.why
        owner.close()
        wait(link, lambda: link.state != "down")


def test_a_port_that_goes_away_says_why(tmp_path: Path) -> None:
    pty, name = PtyPort(), tmp_path / "tty"
    name.symlink_to(pty.path)
    with wirebond.open(without_deadlines(), name) as link:
        name.unlink()
        pty.close()
        wait(link, lambda: link.state == "down")
        assert "went away" in link.why or "there is no port" in link.why
