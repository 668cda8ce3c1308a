"""The inputs of `wirebond explain`: hex digits, a capture, a recording, or stdin."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from tests.shared import PROTOCOLS, codec

from wirebond.cli.main import main
from wirebond.recording.capture import as_recording

FILE = str(PROTOCOLS / "diffdrive.yaml")
FRAME = codec("diffdrive").encode("velocity", linear=0.5, angular=0)
SHOWN = "velocity from the host: linear 0.5 m/s, angular 0 rad/s"


def shown(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["explain", FILE, *arguments]) == 0, capsys.readouterr().err
    return capsys.readouterr().out


def test_hex_digits_need_no_option(capsys: pytest.CaptureFixture[str]) -> None:
    assert SHOWN in shown(capsys, FRAME.hex(" "))
    assert SHOWN in shown(capsys, "0x" + FRAME.hex(",").replace(",", ",0x"))
    assert SHOWN in shown(capsys, "--hex", FRAME.hex())


@pytest.mark.parametrize(("name", "content"), [("frame.bin", FRAME), ("frame.hex", FRAME.hex(" ").encode())])
def test_a_capture_is_explained(name: str, content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    assert SHOWN in shown(capsys, str(path))


@pytest.mark.parametrize("content", [FRAME, FRAME.hex(" ").encode() + b"\n", FRAME.hex(":").encode()])
def test_stdin_holds_bytes_or_hex_digits(
    content: bytes, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    reads, writes = os.pipe()
    os.write(writes, content)
    os.close(writes)
    with os.fdopen(reads) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        assert main(["explain", FILE, "-"]) == 0
    told = capsys.readouterr()
    assert SHOWN in told.out
    reads_digits = f"read as the {len(FRAME)} bytes that it spells" in " ".join(told.err.split())
    assert reads_digits == (content != FRAME)


def test_a_recording_is_explained_by_whose_bytes_are_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capture = tmp_path / "frame.bin"
    capture.write_bytes(FRAME)
    with as_recording(capture, codec("diffdrive")) as recording:
        assert SHOWN in shown(capsys, str(recording), "--sender", "host")
        assert main(["explain", FILE, str(recording)]) == 2  # the MCU's, and it sent none
    assert "there are no bytes to explain" in capsys.readouterr().err


def test_of_a_long_capture_the_first_refused_bytes_are_explained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = bytearray(FRAME)
    broken[4] ^= 1
    capture = tmp_path / "long.bin"
    capture.write_bytes(FRAME * 1000 + bytes(broken) + FRAME * 1000)
    assert main(["explain", FILE, str(capture)]) == 1
    told = capsys.readouterr()
    begin = 999 * len(FRAME)
    assert f"from byte {begin} on, the frame before the first refused ones" in " ".join(told.err.split())
    assert "refused  offset 11, 11 bytes  check_mismatch" in told.out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "give bytes one way"),
        (["--hex", "7A", "AA"], "give bytes one way"),
        (["no_such_file.bin"], "there is no such file"),
        (["sim:"], "knows its protocol"),
        (["--hex", "AA 5"], "do not make whole bytes"),
    ],
)
def test_text_that_is_no_bytes_gets_a_sentence(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", FILE, *arguments]) != 0
    assert sentence in " ".join(capsys.readouterr().err.split())
