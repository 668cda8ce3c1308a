"""Text from a device, a file or a file's name is shown as text in a terminal: it commands nothing and hides nothing."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import wirebond
from tests.shared import PROTOCOLS
from tests.waiting import PATIENCE

pytestmark = pytest.mark.live

COMMAND = str(Path(sys.executable).with_name("wirebond"))
# Sets the title, turns red (C0 and C1), turns the direction of writing, forges a line, closes rich's markup.
HOSTILE = "\x1b]0;own\x07\x1b[31m\x9b1m\u202e\x7f\nok[/][bold]B"
SHOWN = r"\x1b]0;own\x07\x1b[31m\x9b1m\u202e\x7f\nok[/][bold]B"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The native protocol with a hostile description and unit."""
    text = (PROTOCOLS / "native.yaml").read_text()
    assert "{type: u8, enum: {debug: 0" in text
    about = f"description: {json.dumps('about ' + HOSTILE)}\n"
    text = re.sub(r"^description:.*?(?=^\w)", lambda _: about, text, flags=re.M | re.S)
    text = text.replace("id: 0x75\n", f"id: 0x75\n    description: {json.dumps('what ' + HOSTILE)}\n")
    unit = json.dumps("m" + HOSTILE)
    text = text.replace("index:  {type: u8}", f"index:  {{type: u8, unit: {unit}, range: [0, 1]}}")
    path = tmp_path / "native.yaml"
    path.write_text(text)
    return path


def terminal(*arguments: str, columns: int = 100, until: str = "") -> tuple[int, str]:
    """Run the command in a terminal of its own; its exit code and all that the terminal receives. ``until``: Ctrl-C
    ends it once this is there."""
    leader, follower = os.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": str(columns), "LINES": "40"}
    environment.pop("NO_COLOR", None)
    process = subprocess.Popen([COMMAND, *arguments], stdin=follower, stdout=follower, stderr=follower, env=environment)
    os.close(follower)
    out = b""
    try:
        while chunk := os.read(leader, 65536):
            out += chunk
            if until and until.encode() in out:
                process.send_signal(signal.SIGINT)
                until = ""
    except OSError:  # the other end is closed
        pass
    os.close(leader)
    return process.wait(PATIENCE), out.decode()


def assert_harmless(out: str) -> None:
    """Nothing but text, line ends, and what rich itself does: colours, and moving about in a live picture."""
    rest = re.sub(r"\x1b\[[0-9;]*m|\x1b\[\?25[lh]|\x1b\[[0-9]*[AK]|\x1b\[2K|\r", "", out)
    rest = re.sub(r"\n", "", rest)
    assert rest.isprintable(), [c for c in rest if not c.isprintable()]
    assert "\x1b[31mm" not in out


@contextmanager
def device(frame: bytes) -> Iterator[str]:
    """A port that sends this frame again and again."""
    leader, follower = os.openpty()
    stop = threading.Event()

    def send() -> None:
        while not stop.wait(0.02):
            os.write(leader, frame)

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield os.ttyname(follower)
    finally:
        stop.set()
        thread.join()
        os.close(leader)
        os.close(follower)


def log_frame(file: Path) -> bytes:
    return wirebond.load(file).encode("log", level="info", text=HOSTILE)


def test_monitor_shows_a_log_line_of_a_device_as_text(file: Path) -> None:
    with device(log_frame(file)) as port:
        code, out = terminal("monitor", str(file), port, until=r"\x1b]0;own")
    assert code == 0
    assert_harmless(out)
    assert r"\x1b]0;own\x07" in out
    with (
        device(log_frame(file)) as port,
        subprocess.Popen([COMMAND, "monitor", str(file), port], stdout=subprocess.PIPE, text=True) as piped,
    ):
        assert piped.stdout is not None
        lines = [piped.stdout.readline().rstrip()]
        piped.send_signal(signal.SIGINT)
        lines += piped.stdout.read().splitlines()
    assert lines
    assert all(line.endswith(f"info: {SHOWN}") for line in lines)


def test_json_escapes_and_gives_the_text_back(file: Path) -> None:
    frame = log_frame(file).hex()
    code, out = terminal("decode", str(file), "--hex", frame)
    assert code == 0
    assert_harmless(out)
    message = json.loads(out.splitlines()[0])
    assert message["fields"]["text"] == HOSTILE


def test_explain_check_and_doc_show_texts_of_device_and_file(file: Path) -> None:
    codec = wirebond.load(file)
    code, out = terminal("explain", str(file), "--hex", log_frame(file).hex())
    assert code == 0
    assert_harmless(out)
    assert r"\x1b" in out
    broken = bytearray(codec.encode("parameter_value", index=1, value=0, result="ok"))
    code, out = terminal("explain", str(file), "--hex", broken.hex())
    assert_harmless(out)
    for arguments in (("check", str(file)), ("doc", str(file)), ("encode", str(file), "parameter_value", "index=9")):
        code, out = terminal(*arguments)
        assert_harmless(out)
    assert r"outside 0 ... 1 m\x1b]0;own" in out


def test_names_of_files_and_ports_are_shown_as_text(tmp_path: Path) -> None:
    name = tmp_path / HOSTILE.replace("/", "")
    for arguments in (
        ("check", str(name)),
        ("decode", str(PROTOCOLS / "native.yaml"), str(name)),
        ("monitor", str(PROTOCOLS / "native.yaml"), str(name)),
        ("encode", str(PROTOCOLS / "native.yaml"), HOSTILE),
        (HOSTILE,),
        ("new", str(name)),
        ("check", str(name)),
    ):
        _, out = terminal(*arguments)
        assert_harmless(out)
        assert r"\x1b]0;own\x07" in out


def test_an_error_of_the_api_is_safe_to_print() -> None:
    with pytest.raises(wirebond.PortError) as caught:
        wirebond.open(PROTOCOLS / "native.yaml", "/dev/" + HOSTILE)
    assert r"there is no port /dev/\x1b]0;own\x07\x1b[31m\x9b1m\u202e\x7f" in str(caught.value)
    assert "\x1b" not in str(caught.value)
