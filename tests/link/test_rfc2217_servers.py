"""RFC 2217 servers that break the rules: what they say of options ends no thread, fills no memory and loses no data."""

from __future__ import annotations

import random
import resource
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

import wirebond
from tests.link.protocol import manipulator
from tests.waiting import wait_until
from wirebond.link.rfc2217 import Telnet

pytestmark = [
    pytest.mark.live,
    pytest.mark.filterwarnings("ignore:set.* is deprecated"),  # of pyserial's RFC 2217
    pytest.mark.filterwarnings("error::pytest.PytestUnhandledThreadExceptionWarning"),
]
ARM = manipulator()
POSE = ARM.encode("pose", x=255)  # 255 is a command of Telnet: it has to be escaped
IAC, SB, SE = b"\xff", b"\xfa", b"\xf0"
AGREES = {b"\xfb": b"\xfd", b"\xfd": b"\xfb"}  # WILL: DO, DO: WILL
COM_PORT = b"\x2c"


def agree(connection: socket.socket) -> Telnet:
    """A server that agrees to all that a client says."""

    def negotiate(command: bytes, option: bytes) -> None:
        if command in AGREES:
            connection.sendall(IAC + AGREES[command] + option)

    def settle(option: bytes) -> None:
        if option[:1] == COM_PORT:
            answer = bytes((option[1] + 100,)) + option[2:]
            connection.sendall(IAC + SB + COM_PORT + answer + IAC + SE)

    return Telnet(negotiate, settle)


@contextmanager
def server(begin: bytes, then: Callable[[socket.socket], None]) -> Iterator[str]:
    """It sends `begin` at once, agrees until it has heard a frame, and does `then`."""

    def serve(connection: socket.socket) -> None:
        telnet = agree(connection)
        with connection:
            try:
                connection.sendall(begin)
                while chunk := connection.recv(4096):
                    if telnet.feed(chunk):
                        then(connection)
            except OSError:
                pass

    def accept() -> None:
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            threading.Thread(target=serve, args=(connection,), daemon=True).start()

    listener = socket.create_server(("127.0.0.1", 0))
    threading.Thread(target=accept, daemon=True).start()
    try:
        yield f"rfc2217://127.0.0.1:{listener.getsockname()[1]}"
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()


def opened(name: str) -> wirebond.Link:
    link = wirebond.open(ARM, name)
    link.send("query")
    return link


@pytest.mark.parametrize(
    "begin",
    [
        IAC + SE,  # the end of nothing
        IAC + SB + COM_PORT + b"\x65" + IAC + SE,  # the answer to a question that was not asked
        IAC + SB + IAC + SE,
        IAC + b"\x01" + IAC + b"\xf1",  # commands that nobody knows
    ],
)  # fmt: skip
def test_a_server_that_sends_unrequested_options_goes_on(begin: bytes) -> None:
    frame = POSE.replace(IAC, IAC + IAC)
    with (
        server(begin, lambda connection: connection.sendall(begin + frame + begin + frame)) as name,
        opened(name) as link,
    ):
        wait_until(lambda: link.stats.receive.frames == 2, "both come")
        assert link.stats.receive.bytes == 2 * len(POSE)


def test_all_that_came_before_the_end_is_read() -> None:
    number = 20_000
    frames = POSE.replace(IAC, IAC + IAC) * number

    def send_and_end(connection: socket.socket) -> None:
        connection.sendall(frames)
        connection.shutdown(socket.SHUT_WR)

    with server(b"", send_and_end) as name, opened(name) as link:
        wait_until(lambda: link.state == "down" or link.stats.reconnects, "it ends")
        assert link.stats.receive.frames == number


@pytest.mark.parametrize(
    "data", [b"\x55" * 65536, pytest.param(IAC + SB + COM_PORT + b"A" * 65536, marks=pytest.mark.long)]
)
def test_a_server_that_floods_fills_no_memory(data: bytes) -> None:
    sent = [0]

    def flood(connection: socket.socket) -> None:
        while True:
            connection.sendall(data)
            sent[0] += len(data)

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with server(b"", flood) as name, opened(name) as link:
        wait_until(lambda: link.stats.receive.bytes > 50_000_000 or link.state == "down", "50 MB, or the end")
        if link.state != "down":
            assert sent[0] - link.stats.receive.bytes < 20_000_000  # the system's buffers, and a bounded queue
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 60_000  # KB


def test_telnet_reads_the_same_in_any_chunks() -> None:
    source = random.Random("telnet")
    data = b"".join(
        source.choice((b"x", b"yz", IAC + IAC, IAC + b"\xfb\x2c", IAC + SB + b"a" + IAC + IAC + b"b" + IAC + SE))
        for _ in range(300)
    )

    def read(pieces: list[bytes]) -> tuple[bytes, list[tuple[bytes, bytes]], list[bytes]]:
        asked: list[tuple[bytes, bytes]] = []
        settled: list[bytes] = []
        telnet = Telnet(lambda command, option: asked.append((command, option)), settled.append)
        return b"".join(map(telnet.feed, pieces)), asked, settled

    whole = read([data])
    assert whole[0].replace(IAC, b"").strip(b"xyz") == b""
    assert set(whole[1]) == {(b"\xfb", b"\x2c")}
    assert set(whole[2]) == {b"a\xffb"}
    for size in (1, 2, 7):
        assert read([data[at : at + size] for at in range(0, len(data), size)]) == whole
