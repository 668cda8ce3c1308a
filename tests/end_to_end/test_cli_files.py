"""The commands that explain, document and begin a protocol file, as a user meets them."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from tests.command import run
from tests.shared import PROTOCOLS, rejected_vectors
from tests.waiting import PATIENCE
from wirebond.generate.code import PORTS

pytestmark = pytest.mark.live

COMMAND = str(Path(sys.executable).with_name("wirebond"))
PID = str(PROTOCOLS / "pid_tuner.yaml")
NATIVE = str(PROTOCOLS / "native.yaml")
(REJECTED,) = (vector.frame for vector in rejected_vectors() if vector.protocol == "pid_tuner")


def from_stdin(text: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [COMMAND, *arguments], input=text, capture_output=True, text=True, timeout=PATIENCE, check=False
    )


class TestStdin:
    """``-`` in the place of a protocol file."""

    def test_check_reads_it(self) -> None:
        text = Path(PID).read_text()
        done = from_stdin(text, "check", "-")
        assert (done.returncode, done.stderr) == (0, "")
        assert "<stdin>: protocol pid_tuner" in done.stdout
        findings = json.loads(from_stdin(text, "check", "-", "--json").stdout)
        assert findings["file"] == "<stdin>"
        assert findings["findings"] == json.loads(run("check", PID, "--json").stdout)["findings"]  # with their places

    def test_problems_have_their_places(self) -> None:
        done = from_stdin("wirebond: 1\nprotocol: 5 x\n", "check", "-")
        assert done.returncode == 1
        assert "\n<stdin>:2:11: `5 x` is not a name" in done.stderr
        assert json.loads(from_stdin("", "check", "-", "--json").stdout)["file"] == "<stdin>"

    def test_diff_reads_one_of_its_files(self) -> None:
        changed = Path(PID).read_text().replace("protocol: pid_tuner", "protocol: pid_tuned")
        for words in (("-", PID), (PID, "-")):
            done = from_stdin(changed, "diff", *words)
            assert done.returncode in (0, 1)
            assert "<stdin>" in done.stdout
            assert "Traceback" not in done.stderr
        both = from_stdin(changed, "diff", "-", "-")
        assert (both.returncode, "only one of the two files" in both.stderr) == (2, True)


def test_python_runs_the_package_as_the_command() -> None:
    whole = [sys.executable, "-m", "wirebond"]
    done = subprocess.run([*whole, "check"], capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (done.returncode, done.stderr) == (2, run("check").stderr)
    shown = subprocess.run([*whole, "--version"], capture_output=True, text=True, timeout=PATIENCE, check=True)
    assert shown.stdout == run("--version").stdout


def test_shells_complete_commands_and_help_says_how() -> None:
    shown = run("--help").stdout
    assert "--install-completion" in shown
    assert "--show-completion" in shown
    asked = {**os.environ, "_WIREBOND_COMPLETE": "complete_bash", "COMP_WORDS": "wirebond ex", "COMP_CWORD": "1"}
    done = subprocess.run([COMMAND], env=asked, capture_output=True, text=True, timeout=PATIENCE, check=True)
    assert done.stdout.split() == ["explain", "export"]


def test_gen_names_every_port_that_it_has() -> None:
    shown = " ".join(run("gen", "--help").stdout.replace("│", " ").split())
    assert f"Add a port's files: {', '.join(PORTS)}." in shown


class TestExplain:
    def test_a_frame_is_explained_with_exit_0(self) -> None:
        result = run("explain", PID, "--hex", "7A 02 01 00 00 7B", "--sender", "host")
        assert (result.returncode, result.stderr) == (0, "")
        assert "frame  offset 0, 6 bytes" in result.stdout
        assert "read_gains from the host: idx 0" in result.stdout

    def test_refused_bytes_have_their_rule_and_the_nearest_explanation_and_exit_1(self) -> None:
        result = run("explain", PID, "--hex", REJECTED.hex())
        assert result.returncode == 1
        assert "check, sum16 high byte over id..payload: expected 05, found 04" in result.stdout
        assert "pid_tuner_listing computes it so" in result.stdout
        assert "Write `- check: {type: sum16, byte: high, over: length..payload}`." in result.stdout

    def test_piped_output_is_plain(self) -> None:
        out = run("explain", PID, "--hex", REJECTED.hex()).stdout
        assert "\x1b" not in out
        assert all(line == line.rstrip() and len(line) <= 120 for line in out.splitlines())

    def test_a_terminal_gets_colour(self) -> None:
        leader, follower = pty.openpty()
        environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100"}
        environment.pop("NO_COLOR", None)
        process = subprocess.Popen(
            [COMMAND, "explain", PID, "--hex", REJECTED.hex()], stdout=follower, stderr=follower, env=environment
        )
        os.close(follower)
        out = b""
        try:
            while chunk := os.read(leader, 65536):
                out += chunk
        except OSError:  # the other end is closed
            pass
        os.close(leader)
        assert process.wait(timeout=PATIENCE) == 1
        assert b"\x1b[" in out
        assert b"check_mismatch" in out

    def test_json_holds_every_byte_and_every_guess(self) -> None:
        report = json.loads(run("explain", PID, "--hex", REJECTED.hex(), "--json").stdout)
        (stretch,) = report["stretches"]
        assert stretch["wire"] == REJECTED.hex(" ").upper()
        assert (stretch["kind"], stretch["cause"]) == ("refused", "check_mismatch")
        assert "over: length..payload" in stretch["guesses"][0]["remedy"]
        assert report["discarded_bytes"] == {"check_mismatch": len(REJECTED)}
        assert "".join(row["wire"] for row in stretch["rows"] if row["level"] == 0).replace(" ", "") == "".join(
            stretch["wire"].split()
        )

    def test_bad_hex_and_bad_senders_are_wrong_usage(self) -> None:
        for arguments in (["--hex", "zz"], ["--hex", "7A0"], ["--hex", ""], ["--hex", "7A", "--sender", "me"], []):
            result = run("explain", PID, *arguments)
            assert result.returncode == 2, arguments
            assert result.stdout == ""
            assert result.stderr


class TestDocument:
    def test_it_goes_to_stdout_or_to_a_file(self, tmp_path: Path) -> None:
        shown = run("doc", NATIVE).stdout
        assert shown.startswith("# native\n")
        out = tmp_path / "native.md"
        assert run("doc", NATIVE, "--out", str(out)).returncode == 0
        assert out.read_text() == shown
        assert run("doc", NATIVE, "--out", str(out)).returncode == 0  # made again

    def test_it_never_replaces_the_protocol_file(self, tmp_path: Path) -> None:
        file = tmp_path / "own.yaml"
        text = Path(NATIVE).read_text()
        file.write_text(text)
        result = run("doc", str(file), "--out", str(file))
        assert result.returncode == 2
        assert "is the protocol file itself" in result.stderr
        assert file.read_text() == text

    def test_a_wrong_place_is_a_sentence(self, tmp_path: Path) -> None:
        assert "is a folder" in run("doc", NATIVE, "--out", str(tmp_path)).stderr
        assert (
            "there is no such file or folder; check the path"
            in run("doc", NATIVE, "--out", str(tmp_path / "no" / "x.md")).stderr
        )


class TestNew:
    def test_the_file_is_accepted_by_check(self, tmp_path: Path) -> None:
        for template in ("native", "fixed", "length"):
            assert run("new", f"{template}.yaml", "--template", template, cwd=tmp_path).returncode == 0
            assert run("check", f"{template}.yaml", cwd=tmp_path).returncode == 0

    def test_it_writes_over_nothing(self, tmp_path: Path) -> None:
        assert run("new", "a.yaml", cwd=tmp_path).returncode == 0
        before = (tmp_path / "a.yaml").read_text()
        result = run("new", "a.yaml", "--template", "fixed", cwd=tmp_path)
        assert (result.returncode, (tmp_path / "a.yaml").read_text()) == (2, before)
        assert "exists already" in result.stderr


class TestImport:
    HEADER = "#include <stdint.h>\n#pragma pack(1)\nstruct drive_cmd { float speed; uint8_t on; };\n"

    def test_a_header_becomes_a_file_that_check_accepts(self, tmp_path: Path) -> None:
        (tmp_path / "link.h").write_text(self.HEADER + "struct bad { void *p; };\n")
        result = run("import", "link.h", "--out", "link.yaml", cwd=tmp_path)
        assert result.returncode == 0
        assert "link.yaml: 1 message; its comments list what the header does not say" in result.stdout
        assert "left out: bad (line 4): p is a pointer" in result.stderr
        assert run("check", "link.yaml", cwd=tmp_path).returncode == 0
        assert run("encode", "link.yaml", "drive_cmd", "speed=1", "on=1", cwd=tmp_path).returncode == 0

    def test_without_out_it_goes_to_stdout(self, tmp_path: Path) -> None:
        (tmp_path / "link.h").write_text(self.HEADER)
        result = run("import", "link.h", cwd=tmp_path)
        assert "protocol: link\n" in result.stdout
        assert "  drive_cmd:" in result.stdout

    def test_it_writes_over_nothing(self, tmp_path: Path) -> None:
        (tmp_path / "link.h").write_text(self.HEADER)
        result = run("import", "link.h", "--out", "link.h", cwd=tmp_path)
        assert (result.returncode, (tmp_path / "link.h").read_text()) == (2, self.HEADER)

    def test_bad_headers_are_sentences_with_exit_1(self, tmp_path: Path) -> None:
        (tmp_path / "bad.h").write_text("struct a { vec3 x; };\n")
        for header, said in (
            ("bad.h", "bad.h:1:1: the type `vec3`"),
            ("none.h", "there is no such file"),
            (".", "is a folder"),
        ):
            result = run("import", header, cwd=tmp_path)
            assert result.returncode in (1, 2)
            assert said in result.stderr


def test_the_document_is_written_in_chinese_where_it_is_asked_for() -> None:
    done = run("doc", NATIVE, "--language", "zh")
    assert done.returncode == 0 and "## 线路" in done.stdout and "## Line" not in done.stdout
    done = run("doc", NATIVE, "--language", "fr")
    assert done.returncode == 2 and "expected en or zh" in done.stderr
