"""Time stamps of an MCU in the host's time: units, wraps, bounds, and times that cannot be true."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest

import wirebond
from wirebond.cli.main import main
from wirebond.link.clock_sync import ClockSync
from wirebond.link.stamps import LiveClock, Stamper

FILE = """
wirebond: 1
protocol: stamped
frame: [magic: 0xAA, id: u8, payload: by_id, check: crc-16/ibm-sdlc]
messages:
  sample: {{id: 1, sender: mcu, fields: {{value: {{type: u8}}, at: {{{options}, clock: mcu}}}}}}
  plain: {{id: 2, sender: mcu, fields: {{at: {{type: u32, unit: us}}}}}}
"""
DRIFT = 80e-6
BOOTED = 50.0  # of the host's time
DELAY = 0.002  # seconds from the sample to its arrival


def codec_with(folder: Path, options: str) -> wirebond.Codec:
    path = folder / "stamped.yaml"
    path.write_text(FILE.format(options=options))
    return wirebond.load(path)


def mcu_us(t: float) -> int:
    """The MCU's clock; it is fast, and has wrapped before."""
    return int((t - BOOTED) * (1 + DRIFT) * 1e6) + 3 * 2**32 - 5_000_000


def followed(until: float) -> ClockSync:
    sync = ClockSync()
    for second in range(100, int(until)):
        stamp = mcu_us(second + 0.001) % 2**32
        sync.feed(float(second), stamp, stamp, second + 0.002)
    return sync


def sample(codec: wirebond.Codec, count: int, scale: float, t: float) -> wirebond.Message:
    width = codec.model.message("sample").fields[1].width
    value: Any = count % 2**width * scale if scale != 1 else count % 2**width
    return codec.decoder("mcu").feed(codec.encode("sample", value=1, at=value), t)[0]


UNITS = [
    ("type: u32, unit: us", 1, 1),
    ("type: u24be, unit: us", 1, 1),
    ("type: u64, unit: us", 1, 1),
    ("type: u32, unit: ms", 1000, 1),
    ("type: u32, unit: ms, scale: 0.001", 1, 0.001),
    ("type: u32, unit: s, scale: 0.000001", 1, 0.000001),
    ("type: u32, unit: s, scale: 0.0001", 100, 0.0001),
    ("type: u16, unit: us, scale: 256", 256, 256),
]


@pytest.mark.parametrize(("options", "step", "scale"), UNITS, ids=[options for options, _, _ in UNITS])
def test_a_stamp_of_any_unit_is_within_its_bound_also_when_it_wraps(
    options: str, step: int, scale: float, tmp_path: Path
) -> None:
    codec = codec_with(tmp_path, options)
    sync = followed(200.0)
    stamper = Stamper(codec, LiveClock(sync, threading.Lock()))
    for i in range(400):
        true = 195.0 + i * 0.05  # 20 s, in which u24 wraps
        # A clock that wraps before it is divided: a firmware has no more than its 32 bits.
        found = stamper(sample(codec, mcu_us(true) % 2**32 // step, scale, true + DELAY))
        assert found is not None
        assert abs(found[0] - true) <= found[1] < 0.02
        assert found[1] >= step * 1e-6


def test_a_count_of_milliseconds_that_goes_on_where_microseconds_wrap_is_the_same_time(tmp_path: Path) -> None:
    codec = codec_with(tmp_path, "type: u32, unit: ms")
    stamper = Stamper(codec, LiveClock(followed(150.0), threading.Lock()))
    found = stamper(sample(codec, mcu_us(149.0) // 1000, 1, 149.0 + DELAY))  # HAL_GetTick
    assert found is not None
    assert abs(found[0] - 149.0) <= found[1]


def test_nothing_is_said_before_the_clock_is_known_nor_of_times_that_cannot_be_true(tmp_path: Path) -> None:
    codec = codec_with(tmp_path, "type: u32, unit: us")
    sync = ClockSync()
    stamper = Stamper(codec, LiveClock(sync, threading.Lock()))
    early = sample(codec, mcu_us(99.0), 1, 99.0 + DELAY)
    assert stamper(early) is None
    stamp = mcu_us(100.001) % 2**32
    sync.feed(100.0, stamp, stamp, 100.002)
    assert stamper(early) is None  # perhaps of an MCU that has restarted since
    good = sample(codec, mcu_us(100.5), 1, 100.5 + DELAY)
    assert stamper(good) is not None
    assert stamper(sample(codec, mcu_us(100.7), 1, 100.5)) is None  # measured after it came
    assert stamper(sample(codec, mcu_us(80.0), 1, 100.5)) is None  # as a restarted clock gives them
    plain = codec.decoder("mcu").feed(codec.encode("plain", at=1), 100.5)[0]
    assert stamper(plain) is None
    assert (good.stamp, good.stamp_error) == (None, None)  # a decoder follows no clock


def test_a_restarted_clock_begins_again_and_old_messages_have_no_stamp(tmp_path: Path) -> None:
    codec = codec_with(tmp_path, "type: u32, unit: us")
    sync = followed(110.0)
    stamper = Stamper(codec, LiveClock(sync, threading.Lock()))
    before = sample(codec, mcu_us(109.0), 1, 109.0 + DELAY)
    assert stamper(before) is not None
    sync.restart()
    assert stamper(before) is None
    sync.feed(120.0, 1000, 1000, 120.002)
    assert stamper(before) is None
    found = stamper(sample(codec, 500_000, 1, 120.501))
    assert found is not None
    assert abs(found[0] - 120.5) <= found[1]


def test_check_warns_of_a_stamp_without_the_clock_service(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    codec_with(tmp_path, "type: u32, unit: us")
    main(["check", str(tmp_path / "stamped.yaml"), "--json"])
    assert '"stamp-without-clock"' in capsys.readouterr().out


def test_diff_says_that_the_wire_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    new = codec_with(tmp_path, "type: u32, unit: us")
    path = tmp_path / "old.yaml"
    path.write_text(FILE.format(options="type: u32, unit: us").replace(", clock: mcu", ""))
    assert wirebond.load(path).hash == new.hash
    assert main(["diff", str(path), str(tmp_path / "stamped.yaml")]) == 0
    assert "sample.at: is now read as a time of the MCU's clock" in " ".join(capsys.readouterr().out.split())
