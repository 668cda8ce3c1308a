"""The console without a link: connecting to a port, to another one, to none; and devices that no file describes."""

from __future__ import annotations

import os
import random
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed

from tests.console.conftest import Desk, hear, say, view
from tests.shared import ROOT, codec
from tests.waiting import PATIENCE
from wirebond.cli.main import main
from wirebond.cli.web import with_web_address
from wirebond.console import Console, Options
from wirebond.protocol import loads
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

COMMAND = [sys.executable, "-c", "from wirebond.cli.start import main; main()"]
DIFFDRIVE = ROOT / "protocols" / "diffdrive.yaml"


@pytest.fixture
def free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Desk]:
    """A console without a link, and a pty that it may connect to."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    pty = PtyPort()
    with Console(port=0, options=Options(may_connect=True)) as console:
        found = Desk(codec("diffdrive"), pty, None, None, console.port, console.token)  # type: ignore[arg-type]
        yield found
    pty.close()


def connect(desk: Desk, **facts: Any) -> tuple[int, Any]:
    return desk.ask("/api/connect", {"port": desk.pty.path, **facts})


def test_without_a_link_everything_says_so(free: Desk) -> None:
    for path in ("/api/protocol", "/api/document", "/api/lint", "/api/log", "/api/recordings"):
        status, answer = free.ask(path)
        assert (status, answer["error"]) == (404, "no_link"), path
    with free.look(link=True, messages={}, events=True) as socket:
        assert view(socket, "link")["connected"] is False
    with free.attach() as socket:
        assert hear(socket, bool)["error"] == "no_link"


def test_a_page_connects_to_a_port_and_sees_it_without_asking_again(free: Desk) -> None:
    with free.look(link=True, plots=[{"id": "a", "fields": ["odometry.left_ticks"], "seconds": 5}]) as socket:
        assert view(socket, "link")["connected"] is False
        assert connect(free, protocol=str(DIFFDRIVE.resolve())) == (200, {"ok": None})
        assert view(socket, "link", lambda link: link["connected"])["protocol"] == "diffdrive"
        free.send("odometry", left_ticks=5, right_ticks=6)
        while not (isinstance(said := socket.recv(timeout=PATIENCE), bytes) and b'"n": 1' in said):
            pass
        assert free.ask("/api/disconnect", {}) == (200, {"ok": None})
        assert view(socket, "link", lambda link: not link["connected"])


def test_a_wrong_protocol_leaves_the_old_link_in_force(free: Desk) -> None:
    assert connect(free, protocol=str(DIFFDRIVE.resolve()))[0] == 200
    text = DIFFDRIVE.read_text(encoding="utf-8")
    status, answer = connect(free, text=text.replace("id: u8", "id: u9"))
    assert status == 422 and answer["problems"][0]["line"] > 1
    assert connect(free, protocol="/etc/passwd")[0] == 422
    assert free.ask("/api/protocol")[1]["hash"] == f"{free.codec.hash:016x}"
    assert connect(free, text=text.replace("protocol: diffdrive", "protocol: other"))[0] == 200
    assert free.ask("/api/protocol")[1]["name"] == "other"


def test_a_controlled_link_is_taken_only_on_purpose_and_its_page_is_notified(free: Desk) -> None:
    assert connect(free, protocol=str(DIFFDRIVE.resolve()))[0] == 200
    with free.attach(name="driver") as socket:
        hear(socket, lambda said: said.get("re") == 1)
        say(socket, {"do": "take", "id": 2})
        hear(socket, lambda said: said.get("re") == 2)
        assert free.ask("/api/disconnect", {})[0] == 409
        assert connect(free)[0] == 409
        assert free.ask("/api/disconnect", {"over": True})[0] == 200
        with pytest.raises(ConnectionClosed, match="1012"):
            hear(socket, lambda _: False)


def test_a_device_without_a_file_shows_its_bytes_and_what_it_may_be(free: Desk) -> None:
    assert connect(free, baud=57600)[0] == 200
    with free.look(link=True, frames={"most": 20}, messages={}) as socket:
        link = view(socket, "link", lambda link: link["connected"])
        assert link["protocol"] is None and link["baud"] == 57600
        for number in range(60):
            free.send("odometry", left_ticks=number, right_ticks=-number)
        entries = view(socket, "frames", lambda said: said["entries"])["entries"]
        assert {entry["kind"] for entry in entries} == {"bytes"} and entries[0]["bytes"].startswith("aa5583")
        assert view(socket, "link", lambda link: link["receive"]["bytes"] == 660)["receive"]["frames"] == 0
    assert free.ask("/api/protocol")[1]["error"] == "no_protocol"
    matches = free.ask("/api/identify", {"live": 10})[1]["matches"]
    assert matches[0]["name"] == "diffdrive" and "protocol: diffdrive" in matches[0]["text"]
    assert free.ask("/api/identify", {"port": free.pty.path})[0] == 409


def test_identify_shows_what_can_be_seen_in_bytes_that_no_format_fits(free: Desk) -> None:
    source = random.Random(1)
    unknown = [bytes([0x5A, 0xC3, number % 256, *source.randbytes(9)]) for number in range(150)]
    data = b"".join(frame + bytes([sum(frame) & 0xFF]) for frame in unknown)
    status, told = free.ask("/api/identify", {"bytes": data.hex()})
    assert status == 200 and told["matches"] == told["other_sizes"] == []
    assert "- check: {type: sum8" in told["inferred"] and loads(told["inferred"]).name == "inferred"


def test_a_first_file_comes_from_a_template_or_a_header(free: Desk) -> None:
    status, made = free.ask("/api/new", {"name": "My Robot", "template": "length"})
    assert status == 200 and loads(made["text"]).name == made["name"] == "my_robot"
    status, made = free.ask("/api/new", {"name": "arm", "has": "joints=12"})
    assert status == 200 and "joint_states" in made["text"] and "odometry" not in made["text"]
    status, made = free.ask("/api/new", {"name": "arm", "has": "wheels"})
    assert (status, made["error"]) == (422, "wrong_parts") and "base, joints, imu, battery" in made["text"]
    header = "#include <stdint.h>\n#pragma pack(1)\ntypedef struct { uint8_t a; int16_t b; } speed_t;\n"
    status, made = free.ask("/api/import", {"header": header, "name": "robot"})
    assert status == 200 and made["messages"] == 1 and "b:" in made["text"]
    status, made = free.ask("/api/import", {"header": "struct {", "name": "robot"})
    assert status == 422 and "robot.h" in made["text"] and "/tmp" not in made["text"]


def test_a_program_s_own_console_connects_to_nothing_else_and_saves_no_file(tmp_path: Path) -> None:
    with Console(port=0) as console:
        desk = Desk(codec("diffdrive"), PtyPort(), None, None, console.port, console.token)  # type: ignore[arg-type]
        assert "one program" in connect(desk)[1]["text"]
        assert desk.ask("/api/save", {"text": "x"})[1]["error"] == "no_file"
        desk.pty.close()


def test_only_a_file_without_problems_is_saved(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    text = DIFFDRIVE.read_text(encoding="utf-8")
    file.write_text(text, encoding="utf-8")
    with Console(port=0, options=Options(may_save=file)) as console:
        desk = Desk(codec("diffdrive"), PtyPort(), None, None, console.port, console.token)  # type: ignore[arg-type]
        assert desk.ask("/api/save", {"text": text.replace("id: u8", "id: u9")})[0] == 422
        assert file.read_text(encoding="utf-8") == text
        assert desk.ask("/api/save", {"text": f"{text}# edited\n"})[0] == 200
        assert file.read_text(encoding="utf-8").endswith("# edited\n")
        desk.pty.close()


def test_a_first_file_gets_a_name_and_replaces_none_that_the_page_did_not_make(
    free: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = DIFFDRIVE.read_text(encoding="utf-8")
    (tmp_path / "taken.yaml").write_text("mine", encoding="utf-8")
    status, answer = free.ask("/api/save", {"text": text, "name": "Taken.yaml"})
    assert status == 422 and "exists already" in answer["text"]
    assert (tmp_path / "taken.yaml").read_text(encoding="utf-8") == "mine"
    assert free.ask("/api/save", {"text": text, "name": "../outside"})[1]["path"] == str(tmp_path / "outside.yaml")
    status, answer = free.ask("/api/save", {"text": f"{text}# first\n", "name": "new robot"})
    assert (status, answer["path"]) == (200, str(tmp_path / "new_robot.yaml"))
    assert connect(free, protocol=answer["path"])[0] == 200
    assert free.ask("/api/save", {"text": f"{text}# second\n"}) == (200, answer)
    assert (tmp_path / "new_robot.yaml").read_text(encoding="utf-8").endswith("# second\n")


def test_serve_prints_the_address_and_serves_the_page_s_data(tmp_path: Path) -> None:
    pty = PtyPort()
    command = [*COMMAND, "serve", "--web", str(DIFFDRIVE), pty.path, "--no-browser", "--seconds", "30"]
    command[command.index("--web") + 1 : command.index("--web") + 1] = ["0"]
    environment = os.environ | {"XDG_RUNTIME_DIR": str(tmp_path)}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stderr is not None
        told = ""
        while (found := re.search(r"Console: http://127\.0\.0\.1:(\d+)/#token=(\S+)", told)) is None:
            line = process.stderr.readline()
            assert line, told
            told += line
        desk = Desk(codec("diffdrive"), pty, None, None, int(found[1]), found[2])  # type: ignore[arg-type]
        assert desk.ask("/api/protocol")[1]["name"] == "diffdrive"
        assert desk.ask("/api/protocol", headers={"Authorization": ""})[0] == 401
        assert found[2] == (tmp_path / "wirebond" / "token").read_text()  # the next server has the same
        process.terminate()
        assert process.wait(PATIENCE) == 0, process.stderr.read()
    pty.close()


def test_serve_without_a_file_needs_the_page(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["serve"]) == 2
    assert "--web" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        (["serve", "a.yaml", "p", "--web"], ["serve", "a.yaml", "p", "--web", "127.0.0.1:8765"]),
        (["serve", "--web", "a.yaml", "p"], ["serve", "--web", "127.0.0.1:8765", "a.yaml", "p"]),
        (["serve", "--web", "--no-browser"], ["serve", "--web", "127.0.0.1:8765", "--no-browser"]),
        (["serve", "--web", "9000", "a.yaml", "p"], ["serve", "--web", "9000", "a.yaml", "p"]),
        (["serve", "--web", "[::]:9000"], ["serve", "--web", "[::]:9000"]),
    ],
)
def test_an_address_after_web_may_be_left_out(given: list[str], meant: list[str]) -> None:
    assert with_web_address(given) == meant
