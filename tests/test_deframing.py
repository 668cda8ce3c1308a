"""Guarantees 1 to 4 through the Python API: what is delivered, when a false start gives up, where every byte goes."""

from __future__ import annotations

import random
import resource

import numpy as np
import pytest

from tests.shared import ROOT, account_closes, codec
from tests.streams import hard_stream, random_frame
from wirebond import UsageError, load
from wirebond.analysis.explain import Kind, explain
from wirebond.protocol.model import End

IDLE = 0.020  # seconds: the default of these protocols
MEGABYTE = 1_000_000


def false_start(payload: int = 41) -> bytes:
    """An enterprize header that holds and promises ``payload`` bytes that never come."""
    frame = codec("enterprize").encode("field_msg", FIELD_MSG)
    assert frame[1] == payload
    return frame[:5]


FIELD_MSG = {
    "game_state": 1, "remain_time": 2, "bullet_remain": 3, "team": 0, "red_hp": [1] * 8, "blue_hp": [2] * 8,
    "in_combat": False, "bullet_supply_available": True, "shooter_locked": False,
}  # fmt: skip
CHASSIS = {"x_vel": 0.5, "y_vel": -0.25, "w_vel": 3.0}


class TestFalseStart:
    def test_holds_a_good_frame_back_until_the_line_was_idle(self) -> None:
        proto = codec("enterprize")
        decoder = proto.decoder("mcu")
        good = proto.encode("chassis_msg", CHASSIS)
        assert decoder.feed(false_start() + good, t=1.0) == []
        assert decoder.idle(t=1.0 + IDLE * 0.9) == []
        (message,) = decoder.idle(t=1.0 + IDLE)
        assert (message.name, message.raw) == ("chassis_msg", good)
        stats = decoder.stats
        assert stats.discarded_bytes["incomplete"] == 5
        assert account_closes(stats)

    def test_is_given_up_as_soon_as_its_promised_bytes_disprove_it(self) -> None:
        proto = codec("enterprize")
        decoder = proto.decoder("mcu")
        good = proto.encode("chassis_msg", CHASSIS)
        messages = decoder.feed(false_start() + good * 3, t=0.0)
        assert [m.raw for m in messages] == [good] * 3

    def test_with_an_impossible_length_holds_nothing_back(self) -> None:
        proto = codec("pid_tuner")
        good = proto.encode("pid", idx=0, p=1.0, i=2.0, d=3.0)
        decoder = proto.decoder("host")
        (message,) = decoder.feed(b"\x7a\x01\xff" + good)
        assert message.raw == good
        assert decoder.stats.discarded_bytes["length_out_of_range"] == 3

    def test_frame_that_comes_in_pieces_is_not_given_up_between_them(self) -> None:
        proto = codec("enterprize")
        decoder = proto.decoder("mcu")
        frame = proto.encode("chassis_msg", CHASSIS)
        t = 0.0
        for byte in frame[:-1]:
            assert decoder.feed(bytes([byte]), t) == []
            t += IDLE * 0.9
            assert decoder.idle(t) == []
        (message,) = decoder.feed(frame[-1:], t)
        assert message.raw == frame

    def test_clock_that_steps_back_gives_nothing_up(self) -> None:
        proto = codec("enterprize")
        decoder = proto.decoder("mcu")
        frame = proto.encode("chassis_msg", CHASSIS)
        decoder.feed(frame[:10], t=100.0)
        assert decoder.idle(t=1.0) == []
        assert decoder.feed(frame[10:], t=1.0)[0].raw == frame


class TestUnknown:
    def test_id_is_delivered_where_the_check_is_strong(self) -> None:
        proto = codec("enterprize")
        frame = proto.encode("gimbal_cmd", target_pitch=0.0, target_yaw=0.0, shoot_mode=0)
        (message,) = proto.decoder("mcu").feed(frame)  # the mcu has no such message
        assert (message.name, message.id, message.raw, message.fields) == ("unknown", 0xB2, frame, {})
        assert message.sender is None

    def test_id_is_a_false_start_where_the_check_is_weak(self) -> None:
        proto = codec("diffdrive")
        frame = proto.encode("velocity", linear=0.5, angular=0.0)
        decoder = proto.decoder("mcu")
        assert decoder.feed(frame) == []
        assert decoder.stats.rejected_candidates["unknown_message"] == 1

    def test_longer_payload_of_a_newer_peer_is_decoded_and_the_rest_ignored(self) -> None:
        proto = codec("native")
        newer = proto.encode("parameter_value", index=1, value=2.0, result="ok")
        longer = proto.encode("pong", number=7)
        assert newer != longer
        frame = _with_trailing_bytes(longer, b"new")
        (message,) = proto.decoder("mcu").feed(frame)
        assert (message.name, message.fields) == ("pong", {"number": 7})
        assert message.payload.endswith(b"new")

    def test_shorter_payload_than_the_message_needs_is_unknown(self) -> None:
        proto = codec("native")
        frame = _with_payload(proto.encode("pong", number=7), lambda payload: payload[:2])
        (message,) = proto.decoder("mcu").feed(frame)
        assert (message.name, message.id, message.fields) == ("unknown", 0x72, {})


def _with_trailing_bytes(frame: bytes, more: bytes) -> bytes:
    return _with_payload(frame, lambda payload: payload + more)


def _with_payload(frame: bytes, change) -> bytes:  # type: ignore[no-untyped-def]
    """A native frame with another payload, stuffed and checked by libraries that are not ours."""
    from cobs import cobs  # noqa: PLC0415
    from crccheck.crc import Crc16X25  # noqa: PLC0415  (CRC-16/IBM-SDLC by its older name)

    inner = cobs.decode(frame[1:-1])
    body = inner[:1] + change(inner[1:-2])
    return b"\x00" + cobs.encode(body + Crc16X25.calc(body).to_bytes(2, "little")) + b"\x00"


class TestDelimited:
    def test_delimiter_shared_by_two_frames_belongs_to_the_frame_it_ends(self) -> None:
        proto = codec("native")
        first, second = proto.encode("pong", number=1), proto.encode("pong", number=2)
        messages = proto.decoder("mcu").feed(first + second[1:])
        assert [(m.raw, m.offset) for m in messages] == [(first, 0), (second[1:], len(first))]

    def test_delimiters_between_frames_are_fill(self) -> None:
        proto = codec("native")
        frame = proto.encode("pong", number=1)
        decoder = proto.decoder("mcu")
        assert len(decoder.feed(bytes(5) + frame + bytes(3) + frame)) == 2
        stats = decoder.stats
        assert (stats.fill_bytes, stats.frame_bytes) == (8, 2 * len(frame))
        assert account_closes(stats)

    def test_inserted_zero_is_never_accepted(self) -> None:
        proto = codec("native")
        frame = proto.encode("clock_request", host_us=0x1122334455667788)
        for at in range(1, len(frame)):
            decoder = proto.decoder("host")
            messages = decoder.feed(frame[:at] + b"\x00" + frame[at:]) + decoder.finish()
            whole = [m for m in messages if m.raw not in (frame, frame[1:])]
            assert whole == [], at


@pytest.mark.parametrize("name", ["diffdrive", "enterprize", "pid_tuner", "native"])
class TestBadInput:
    def test_ten_megabytes_of_zeros_are_counted_in_bounded_memory(self, name: str) -> None:
        decoder = codec(name).decoder()
        zeros = bytes(MEGABYTE)
        decoder.feed(zeros)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for _ in range(9):
            assert decoder.feed(zeros) == []
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2000  # kilobytes
        stats = decoder.stats
        assert stats.bytes == 10 * MEGABYTE
        assert account_closes(stats)
        assert stats.pending_bytes < 200

    def test_random_bytes_end_in_counted_buckets(self, name: str) -> None:
        decoder = codec(name).decoder()
        source = random.Random(name)
        for _ in range(50):
            decoder.feed(source.randbytes(source.randrange(1, 5000)))
            assert account_closes(decoder.stats)
        decoder.finish()
        assert decoder.stats.pending_bytes == 0

    def test_every_truncation_of_a_capture_is_accounted_for(self, name: str) -> None:
        proto = codec(name)
        source = random.Random(name)
        capture = b"".join(random_frame(proto, source) for _ in range(5))
        for end in range(len(capture)):
            columns = proto.decode_columns(capture[:end])
            assert account_closes(columns.stats)
            assert columns.stats.pending_bytes == 0

    def test_endless_block_without_delimiter_or_end_keeps_pending_small(self, name: str) -> None:
        proto = codec(name)
        decoder = proto.decoder()
        head = random_frame(proto, random.Random(1))[:3]
        for _ in range(100):
            decoder.feed(head + b"\x55" * 500)
            assert decoder.stats.pending_bytes <= proto.model.max_wire_bytes()
            assert account_closes(decoder.stats)


@pytest.mark.parametrize("wrong", [None, 5, "text", [1, 2]])
def test_feeding_something_that_is_no_bytes_is_a_type_error(wrong: object) -> None:
    with pytest.raises(TypeError, match="expected bytes"):
        codec("diffdrive").decoder("mcu").feed(wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [float("nan"), float("inf"), 1e300])
def test_time_that_is_no_time_is_refused(wrong: float) -> None:
    with pytest.raises(ValueError, match="finite number of seconds"):
        codec("diffdrive").decoder("mcu").feed(b"", t=wrong)


PARALLEL = ["enterprize", "native", "diffdrive", "pid_tuner"]


@pytest.mark.parametrize("name", PARALLEL)
def test_a_capture_is_decoded_alike_by_any_number_of_threads(name: str) -> None:
    proto = codec(name)
    source = random.Random(name)
    sender = End.MCU
    pieces = [hard_stream(proto, source, pieces=200) for _ in range(8)]
    capture = b""
    while len(capture) < 300_000:  # less is not worth several threads
        capture += source.choice(pieces) + source.randbytes(source.choice([0, 0, 3, 5000]))
    alone = proto.decode_columns(capture, sender, threads=1)
    for threads in (2, 3):
        together = proto.decode_columns(capture, sender, threads=threads)
        assert together.stats == alone.stats
        assert account_closes(together.stats)
        assert together.keys() == alone.keys()
        for message, table in alone.items():
            assert np.array_equal(together[message].offset, table.offset)
            for field, column in table.items():
                np.testing.assert_array_equal(together[message][field], column)


def test_progress_of_a_large_capture_is_reported_and_may_stop_it() -> None:
    proto = codec("enterprize")
    capture = proto.encode("chassis_cmd", x_vel=1, y_vel=2, w_vel=3) * 400_000
    told: list[tuple[int, int]] = []
    proto.decode_columns(capture, "host", progress=lambda done, size: told.append((done, size)))
    assert all(done <= size == len(capture) for done, size in told)
    assert told == sorted(told)
    assert told[-1] == (len(capture), len(capture))

    def stop(done: int, size: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        proto.decode_columns(capture * 2, "host", progress=stop)
    with pytest.raises(UsageError, match="threads is 0; expected 1 or more"):
        proto.decode_columns(capture, "host", threads=0)


def test_the_block_after_one_that_was_too_long_is_a_block_of_its_own() -> None:
    """For formats whose frames end by silence. The bytes before are discarded at once, so nothing is left to give
    up."""
    proto = load(ROOT / "tests" / "formats" / "modbus_rtu.yaml")
    frame = proto.encode("write_register", {"number": 1, "value": 2})
    decoder = proto.decoder("host")
    assert decoder.feed(bytes(74), t=1.0) == []
    assert decoder.idle(t=1.1) == []
    assert decoder.feed(frame, t=1.1) == []
    assert [m.raw for m in decoder.idle(t=1.2)] == [frame]


@pytest.mark.parametrize("chunk", [1, 5, 1000])
def test_missing_bytes_are_not_taken_from_an_earlier_frame(chunk: int) -> None:
    """The rest of a frame that was given up may still lie in memory, where the frame before left it."""
    proto = codec("enterprize")
    frame = proto.encode("field_msg", FIELD_MSG)
    for cut in range(1, len(frame)):
        decoder = proto.decoder("mcu")
        found = [m for at in range(0, len(frame), chunk) for m in decoder.feed(frame[at : at + chunk], t=1.0)]
        assert [m.raw for m in found] == [frame]
        assert decoder.feed(frame[:cut], t=1.0) == []
        assert decoder.idle(t=2.0) == []
        assert decoder.stats.pending_bytes == 0
        assert account_closes(decoder.stats)
        assert [m.raw for m in decoder.feed(frame, t=3.0)] == [frame]


def test_a_delimiter_that_only_ends_frames_goes_with_the_frame_it_ends() -> None:
    """One that may also open frames is the next frame's first byte where it ends a refused one."""
    proto = load(ROOT / "tests" / "formats" / "crlf.yaml")
    good = proto.encode("line", text="hello")
    refused = b"J" + good[1:]
    decoder = proto.decoder("mcu")
    (message,) = decoder.feed(b"\r\n" + refused + good)
    assert (message.offset, message.raw) == (2 + len(refused), good)
    stats = decoder.stats
    assert stats.fill_bytes == 2
    assert stats.discarded_bytes["check_mismatch"] == len(refused)
    assert account_closes(stats)
    first = explain(proto.model, refused + good, End.MCU).stretches[0]
    assert (first.kind, first.wire) == (Kind.REFUSED, refused)
