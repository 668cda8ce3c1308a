"""Links through programs of others: Debian's ser2net (RFC 2217 and raw TCP) and socat, on loopback, over ptys."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import termios
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from serial.rfc2217 import PortManager

import wirebond
from tests.link.protocol import manipulator, without_deadlines
from tests.shared import account_closes, lasting_port
from tests.waiting import PATIENCE, moments, wait_until
from wirebond import PortError
from wirebond.sim.pty_port import PtyPort

pytestmark = [pytest.mark.live, pytest.mark.filterwarnings("ignore:set.* is deprecated")]
SER2NET = shutil.which("ser2net") or "/usr/sbin/ser2net"
POSE = manipulator().encode("pose", x=255)  # 255 is a command of Telnet: it has to be escaped
NOTE = {"number": 0xFFFFFFFF, "text": b"\xff\xff\xfa\x00\r\n\r\x11\x13"}


class Program:
    """A program of others, that can be killed and started again."""

    def __init__(self, *command: str) -> None:
        self._command = command
        self._process: subprocess.Popen[bytes] | None = None
        self.start()

    def start(self) -> None:
        self._process = subprocess.Popen(self._command, stderr=subprocess.DEVNULL)

    def kill(self) -> None:
        if self._process is not None:
            self._process.send_signal(signal.SIGKILL)
            self._process.wait()
            self._process = None


@pytest.fixture
def device(tmp_path: Path) -> Iterator[Callable[[], PtyPort]]:
    """Plugs a pty in at the path `tty`."""
    ports: list[PtyPort] = []
    name = tmp_path / "tty"

    def plug_in() -> PtyPort:
        ports.append(PtyPort())
        name.unlink(missing_ok=True)
        name.symlink_to(ports[-1].path)
        return ports[-1]

    yield plug_in
    for port in ports:
        with contextlib.suppress(OSError):
            port.close()


class Served:
    """ser2net at ``tmp_path/tty``, under the link's name for it."""

    def __init__(self, kind: str, folder: Path) -> None:
        number = lasting_port()
        self.name = f"{kind}://127.0.0.1:{number}"
        accepter = "telnet(rfc2217),tcp" if kind == "rfc2217" else "tcp"
        configuration = folder / "ser2net.yaml"
        configuration.write_text(
            "%YAML 1.1\n---\nconnection: &arm\n"
            f"  accepter: {accepter},127.0.0.1,{number}\n  connector: serialdev,{folder / 'tty'},9600n81,local\n"
        )
        self.program = Program(SER2NET, "-n", "-u", "-c", str(configuration))


@pytest.fixture(params=["rfc2217", "tcp"])
def served(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Served]:
    found = Served(request.param, tmp_path)
    yield found
    found.program.kill()


def wait(link: wirebond.Link, holds: Callable[[], object]) -> None:
    wait_until(holds, lambda: f"{link.state}: {link.why}")


def both_ways(link: wirebond.Link, far: PtyPort) -> None:
    """A message each way, unharmed."""
    wait(link, lambda: link.state != "down")
    link.receive()
    heard = manipulator().decoder("host")
    got: list[wirebond.Message] = []
    for _ in moments("a message of the far end"):  # what is sent before the server has the device open is lost
        far.write(POSE)
        if got := link.receive(0.1):
            break
    assert {message["x"] for message in got} == {255}
    link.send("note", NOTE)
    notes: list[wirebond.Message] = []
    wait_until(lambda: notes.extend(heard.feed(far.read(0.05))) or notes, "the note")
    assert [dict(message.fields) for message in notes] == [NOTE]
    assert sum(heard.stats.discarded_bytes.values()) == 0
    assert account_closes(link.stats.receive)


def test_messages_go_both_ways_and_it_comes_back_when_the_server_does(
    served: Served, device: Callable[[], PtyPort]
) -> None:
    far = device()
    with wirebond.open(without_deadlines(), served.name, wait_for_port=True) as link:
        both_ways(link, far)
        served.program.kill()
        wait(link, lambda: link.state == "down")
        wait(link, lambda: "nothing listens at" in link.why)
        served.program.start()
        both_ways(link, far)
        assert link.stats.reconnects == 1


def test_it_comes_back_when_the_servers_device_does(served: Served, device: Callable[[], PtyPort]) -> None:
    far = device()
    with wirebond.open(without_deadlines(), served.name, wait_for_port=True) as link:
        both_ways(link, far)
        far.close()
        wait(link, lambda: link.state == "down")
        assert f"{served.name} closed the connection" in link.why
        both_ways(link, device())


@pytest.mark.parametrize("served", ["rfc2217"], indirect=True)
def test_the_servers_line_gets_the_settings_of_the_protocol(served: Served, device: Callable[[], PtyPort]) -> None:
    far = device()
    codec = manipulator(", parity: even, stop_bits: 2")
    with wirebond.open(codec, served.name, 57600, wait_for_port=True) as link:
        wait(link, lambda: link.state != "down")
        line = os.open(far.path, os.O_RDWR | os.O_NOCTTY)
        _, _, flags, _, _, speed, _ = termios.tcgetattr(line)
        os.close(line)
    assert speed == termios.B57600
    assert flags & termios.CSTOPB  # the kernel's ptys have no parity


# ---- what goes wrong with a server


def test_a_server_without_rfc_2217_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wirebond.link.python_ports._RFC2217_OPTIONS", "ign_set_control&timeout=0.2")
    with socket.create_server(("127.0.0.1", 0)) as server:
        number = server.getsockname()[1]
        with pytest.raises(PortError, match=f"is not an RFC 2217 server.* name it tcp://127.0.0.1:{number}"):
            wirebond.open(without_deadlines(), f"rfc2217://127.0.0.1:{number}")


def test_a_server_that_is_missing_or_in_use_is_reported() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        name = f"rfc2217://127.0.0.1:{server.getsockname()[1]}"

        def hang_up() -> None:
            server.accept()[0].close()

        thread = threading.Thread(target=hang_up)
        thread.start()
        with pytest.raises(PortError, match="closed the connection at once; its serial port may be missing, or in use"):
            wirebond.open(without_deadlines(), name)
        thread.join()
    with pytest.raises(PortError, match=f"nothing listens at {name}; start the server there"):
        wirebond.open(without_deadlines(), name)
    with pytest.raises(PortError, match=r"the name of rfc2217://robot\.invalid:5000 cannot be found"):
        wirebond.open(without_deadlines(), "rfc2217://robot.invalid:5000")


class Uart:
    """A serial port for pyserial's own server; this one runs at 9600 baud and no other rate."""

    bytesize, parity, stopbits = 8, "N", 1
    cts = dsr = ri = cd = dtr = rts = False

    @property
    def baudrate(self) -> int:
        return 9600

    @baudrate.setter
    def baudrate(self, value: int) -> None:
        if value != 9600:
            raise ValueError("this UART runs at 9600 baud")


def test_refused_settings_are_reported() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        class Connection:
            """As PortManager writes to it."""

            def __init__(self, accepted: socket.socket) -> None:
                self.write = accepted.sendall

        uart = Uart()

        def serve() -> None:
            accepted, _ = server.accept()
            manager = PortManager(uart, Connection(accepted))
            while data := accepted.recv(1024):
                b"".join(manager.filter(data))
            accepted.close()

        thread = threading.Thread(target=serve)
        thread.start()
        name = f"rfc2217://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(PortError, match=f"{name} refused baud rate of the link .115200 baud, 8 data bits"):
            wirebond.open(manipulator(", parity: even, stop_bits: 2"), name)
        thread.join()
        assert (uart.parity, uart.stopbits) == ("E", 2)  # what it could do


# ---- socat


def test_a_pty_pair_of_socat_carries_a_link_and_may_be_made_again(tmp_path: Path) -> None:
    host, mcu = tmp_path / "host", tmp_path / "mcu"
    socat = Program("socat", f"pty,raw,echo=0,link={host}", f"pty,raw,echo=0,link={mcu}")
    try:
        with wirebond.open(without_deadlines(), host, wait_for_port=True) as link:
            for number in range(2):
                wait(link, lambda: link.state != "down" and mcu.exists())
                far = os.open(mcu, os.O_RDWR | os.O_NOCTTY)
                os.write(far, POSE)
                assert link.receive(PATIENCE)[0]["x"] == 255
                link.send("note", NOTE)
                assert os.read(far, 4096) == manipulator().encode("note", NOTE)
                os.close(far)
                if number == 0:
                    socat.kill()
                    wait(link, lambda: link.state == "down")
                    host.unlink(missing_ok=True)  # a killed socat leaves its names behind
                    mcu.unlink(missing_ok=True)
                    socat.start()
            assert link.stats.reconnects == 1
    finally:
        socat.kill()


def test_socat_gives_a_tty_to_the_network(device: Callable[[], PtyPort], tmp_path: Path) -> None:
    far = device()
    number = lasting_port()
    socat = Program("socat", f"tcp-listen:{number},bind=127.0.0.1,reuseaddr", f"{tmp_path / 'tty'},raw,echo=0")
    try:
        with wirebond.open(without_deadlines(), f"tcp://127.0.0.1:{number}", wait_for_port=True) as link:
            both_ways(link, far)
    finally:
        socat.kill()
