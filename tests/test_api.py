"""The public surface as its users meet it: wrong arguments, and what objects say of themselves."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wirebond

PROTOCOLS = Path(__file__).resolve().parents[1] / "protocols"
DIFFDRIVE = wirebond.load(PROTOCOLS / "diffdrive.yaml")
FRAME = DIFFDRIVE.encode("velocity", linear=0.5, angular=0.25)


class Stubborn:
    """A value that raises when it is asked for its number."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def __float__(self) -> float:
        raise self.error


class StubbornIndex(Stubborn):
    def __index__(self) -> int:
        raise self.error


class TestWrongArguments:
    @pytest.mark.parametrize("name", [None, 3, b"velocity", ["velocity"]])
    def test_a_message_that_is_no_name_is_a_sentence(self, name: Any) -> None:
        with pytest.raises(
            wirebond.MessageError, match=r"is not a message's name; diffdrive has velocity, status_query"
        ):
            DIFFDRIVE.encode(name)
        if name is not None:
            with pytest.raises(wirebond.UsageError, match=r"is not a message's name; diffdrive has"):
                DIFFDRIVE.decoder().expect(name)

    def test_values_and_header_are_mappings(self) -> None:
        with pytest.raises(wirebond.MessageError, match=r"velocity is 5; expected its fields as a mapping"):
            DIFFDRIVE.encode("velocity", 5)  # type: ignore[arg-type]
        with pytest.raises(wirebond.MessageError, match=r"header is \[1\]; expected the frame's own fields"):
            DIFFDRIVE.encode("velocity", header=[1])  # type: ignore[arg-type]

    @pytest.mark.parametrize("threads", [0, -1, "2", 1.5])
    def test_threads_are_a_number_of_1_or_more(self, threads: Any) -> None:
        with pytest.raises(wirebond.UsageError, match="expected 1 or more"):
            DIFFDRIVE.decode_columns(FRAME, threads=threads)

    def test_an_exception_of_a_values_own_conversion_comes_through(self) -> None:
        with pytest.raises(ZeroDivisionError, match="mine"):
            DIFFDRIVE.encode("velocity", linear=Stubborn(ZeroDivisionError("mine")), angular=0)
        with pytest.raises(ZeroDivisionError, match="mine"):
            DIFFDRIVE.encode("odometry", left_ticks=StubbornIndex(ZeroDivisionError("mine")), right_ticks=0)
        with pytest.raises(OverflowError, match="mine"):
            DIFFDRIVE.encode("velocity", linear=Stubborn(OverflowError("mine")), angular=0)

    def test_a_type_error_of_a_values_own_conversion_is_the_cause(self) -> None:
        with pytest.raises(wirebond.MessageError, match=r"velocity.linear is .* expected a number") as caught:
            DIFFDRIVE.encode("velocity", linear=Stubborn(TypeError("mine")), angular=0)
        assert str(caught.value.__cause__) == "mine"

    def test_numbers_of_numpy_are_numbers(self) -> None:
        values = {"left_ticks": np.float64(3.0), "right_ticks": np.array(4.0)}
        assert DIFFDRIVE.encode("odometry", values) == DIFFDRIVE.encode("odometry", left_ticks=3, right_ticks=4)

    @pytest.mark.parametrize("t", [float("nan"), float("inf"), 1e300])
    def test_a_time_that_is_none_is_wrong_usage(self, t: float) -> None:
        decoder = DIFFDRIVE.decoder()
        for call in (lambda: decoder.feed(b"", t), lambda: decoder.idle(t)):
            with pytest.raises(wirebond.UsageError, match="expected a finite number of seconds"):
                call()

    def test_times_and_buffers_of_a_wrong_type_are_type_errors(self) -> None:
        with pytest.raises(TypeError, match="must be real number"):
            DIFFDRIVE.decoder().feed(b"", None)  # type: ignore[arg-type]
        for wrong in ("text", 5, None):
            with pytest.raises(TypeError, match="expected bytes, a bytearray, a memoryview or another buffer, not"):
                DIFFDRIVE.decoder().feed(wrong)  # type: ignore[arg-type]
            with pytest.raises(TypeError, match="expected bytes, a bytearray, a memoryview or another buffer, not"):
                DIFFDRIVE.decode_columns(wrong)  # type: ignore[arg-type]

    def test_an_index_that_a_column_does_not_have_is_a_sentence(self) -> None:
        columns = DIFFDRIVE.decode_columns(FRAME)
        with pytest.raises(KeyError, match="no 'status' in this capture; it has velocity"):
            columns["status"]
        with pytest.raises(KeyError, match="the table has no column 'up'; it has linear, angular"):
            columns["velocity"]["up"]


class TestBytesThatDoNotLieTogether:
    def test_every_second_byte(self) -> None:
        apart = memoryview(b"".join(bytes((byte, 0xEE)) for byte in FRAME))[::2]
        assert [m.name for m in DIFFDRIVE.decoder().feed(apart)] == ["velocity"]
        assert len(DIFFDRIVE.decode_columns(apart)["velocity"]) == 1

    def test_backwards_and_from_numpy(self) -> None:
        assert [m.name for m in DIFFDRIVE.decoder().feed(memoryview(FRAME[::-1])[::-1])] == ["velocity"]
        column = np.frombuffer(FRAME * 2, dtype=np.uint8).reshape(2, -1).T  # Fortran's order: gathered as C reads it
        assert column.tobytes() != FRAME * 2
        assert [m.name for m in DIFFDRIVE.decoder().feed(column.T.copy(order="F"))] == ["velocity"] * 2  # type: ignore[arg-type]

    def test_a_large_capture_on_several_threads(self) -> None:
        apart = memoryview(bytes(b for byte in FRAME * 30_000 for b in (byte, 0)))[::2]
        assert len(DIFFDRIVE.decode_columns(apart, threads=4)["velocity"]) == 30_000


def one(frame: bytes) -> wirebond.Message:
    (message,) = DIFFDRIVE.decoder().feed(frame)
    return message


class TestAMessageAsItsFields:
    def test_fields_by_name(self) -> None:
        message = one(FRAME)
        assert message["linear"] == 0.5
        assert "linear" in message
        assert "up" not in message
        assert 3 not in message
        assert list(message) == ["linear", "angular"]
        assert dict(message) == message.fields

    def test_a_field_that_it_does_not_have_is_a_key_error(self) -> None:
        with pytest.raises(KeyError, match="velocity has no field 'up'; it has linear, angular"):
            one(FRAME)["up"]
        with pytest.raises(KeyError, match="status_query has no field 'up'; it has none"):
            one(DIFFDRIVE.encode("status_query"))["up"]

    def test_a_message_without_fields_is_still_true(self) -> None:
        message = one(DIFFDRIVE.encode("status_query"))
        assert message
        assert dict(message) == {}


class TestWhatObjectsSay:
    def test_a_tables_length_is_its_rows(self) -> None:
        columns = DIFFDRIVE.decode_columns(FRAME * 5 + DIFFDRIVE.encode("status_query"))
        table = columns["velocity"]
        assert len(table) == table.rows == len(table["linear"]) == 5
        assert list(table) == list(table.keys()) == ["linear", "angular"]
        assert set(dict(table)) == {"linear", "angular"}
        assert "linear" in table
        assert repr(table) == "<wirebond.Table 5 rows: linear, angular>"
        assert repr(columns) == "<wirebond.Columns of 66 bytes: velocity 5, status_query 1>"
        assert len(columns["status_query"]) == 1

    def test_a_decoder_says_how_far_it_is(self) -> None:
        decoder = DIFFDRIVE.decoder("host")
        decoder.feed(FRAME + FRAME[:3])
        assert repr(decoder) == "<wirebond.Decoder diffdrive from the host: 1 frames in 14 bytes, 3 pending>"
        assert "from either end" in repr(DIFFDRIVE.decoder())

    def test_a_message_says_its_values(self) -> None:
        (message,) = DIFFDRIVE.decoder().feed(FRAME)
        assert repr(message) == "<wirebond.Message velocity {'linear': 0.5, 'angular': 0.25}>"


class TestPorts:
    @pytest.mark.parametrize("name", ["", b""])
    def test_an_empty_name_is_wrong_usage(self, name: Any) -> None:
        with pytest.raises(wirebond.UsageError, match="the port's name is empty"):
            wirebond.open(DIFFDRIVE, name)

    @pytest.mark.live
    def test_a_zero_byte_does_not_cut_a_name(self) -> None:
        leader, follower = os.openpty()
        try:
            with pytest.raises(wirebond.UsageError, match="has a byte that a port cannot have in its name"):
                wirebond.open(DIFFDRIVE, os.ttyname(follower) + "\0 and more")
        finally:
            os.close(leader)
            os.close(follower)

    def test_a_file_with_a_zero_byte_in_its_name_is_a_sentence(self) -> None:
        with pytest.raises(wirebond.ProtocolFileError, match="a file's name cannot contain a zero byte"):
            wirebond.load(str(PROTOCOLS / "diffdrive.yaml") + "\0.txt")

    def test_an_error_has_the_systems_number_and_the_port(self, tmp_path: Path) -> None:
        with pytest.raises(wirebond.PortError, match="there is no port") as missing:
            wirebond.open(DIFFDRIVE, tmp_path / "ttyUSB9")
        assert (missing.value.errno, missing.value.filename) == (errno.ENOENT, str(tmp_path / "ttyUSB9"))
        with pytest.raises(wirebond.PortError, match="is not a serial port") as no_tty:
            wirebond.open(DIFFDRIVE, "/dev/null")
        assert no_tty.value.errno == errno.ENOTTY

    @pytest.mark.live
    def test_a_busy_port_has_its_number(self) -> None:
        leader, follower = os.openpty()
        try:
            with wirebond.open(DIFFDRIVE, os.ttyname(follower)) as link:
                assert repr(link).startswith(f"<wirebond.Link diffdrive on {link.port}: ")
                with pytest.raises(wirebond.PortError, match="is in use") as busy:
                    wirebond.open(DIFFDRIVE, os.ttyname(follower))
                assert busy.value.errno in (errno.EBUSY, errno.EWOULDBLOCK)
            assert repr(link).endswith(": closed>")
        finally:
            os.close(leader)
            os.close(follower)


@pytest.mark.live
def test_a_command_begins_without_protocol_files_and_links() -> None:
    """Each command pays for what all import, and so does --help."""
    heavy = ("wirebond.link", "wirebond.protocol", "serial")
    code = f"import sys, wirebond.cli.main; print([name for name in {heavy} if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout == "[]\n"
