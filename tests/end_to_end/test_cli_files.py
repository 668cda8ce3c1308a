"""The commands that explain, document and begin a protocol file, as a user meets them."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
from pathlib import Path

from tests.command import run
from tests.shared import PROTOCOLS, rejected_vectors

COMMAND = str(Path(sys.executable).with_name("wirebond"))
PID = str(PROTOCOLS / "pid_tuner.yaml")
NATIVE = str(PROTOCOLS / "native.yaml")
(REJECTED,) = (vector.frame for vector in rejected_vectors() if vector.protocol == "pid_tuner")


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
        assert process.wait(timeout=60) == 1
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
        assert "link.yaml: 1 message; its comments say what the header could not tell" in result.stdout
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
