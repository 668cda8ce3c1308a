"""`/api/samples.csv`: every sample of a range, with units and the times of its message, live and of a recording."""

from __future__ import annotations

import csv
import io
import time
from datetime import UTC, datetime
from typing import Any

import pytest

from tests.console.conftest import Desk
from tests.shared import codec
from tests.waiting import let_pass, wait_until
from wirebond.console.samples import csv_of_samples
from wirebond.protocol.model import End
from wirebond.recording.history.source import Source

pytestmark = pytest.mark.live


def rows_of(data: bytes) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(data.decode())))


def test_live_samples_have_their_units_and_the_time_of_day(desk: Desk) -> None:
    came = desk.link.stats.receive.messages.get("odometry", 0)
    begun = f"&from={time.monotonic()}"
    for number in range(300):
        desk.send("odometry", left_ticks=7000 + number, right_ticks=-number)
    desk.send("status", battery=11.97, errors=[], state=[])
    path = "/api/samples.csv?fields=odometry.left_ticks,status.battery,odometry.right_ticks"
    wait_until(lambda: desk.link.stats.receive.messages.get("odometry", 0) >= came + 300)
    wait_until(
        lambda: any(row["message"] == "status" for row in rows_of(desk.ask(path + begun)[1])), "all is in the history"
    )
    status, data = desk.ask(f"{path}{begun}&to={time.monotonic()}")
    assert status == 200
    rows = rows_of(data)
    assert list(rows[0]) == [
        "time",
        "t [s]",
        "message",
        "odometry.left_ticks [ticks]",
        "status.battery [V]",
        "odometry.right_ticks [ticks]",
    ]
    ticks = [row for row in rows if row["message"] == "odometry"]
    assert [int(row["odometry.left_ticks [ticks]"]) for row in ticks] == list(range(7000, 7300))
    assert {row["status.battery [V]"] for row in ticks} == {""}
    assert [row["status.battery [V]"] for row in rows if row["message"] == "status"] == ["11.97"]
    for row in rows:
        at = datetime.strptime(row["time"], "%Y-%m-%dT%H:%M:%S.%fZ").replace(tzinfo=UTC)
        assert at.timestamp() == pytest.approx(float(row["t [s]"]), abs=2e-6)
        assert at.timestamp() == pytest.approx(time.time(), abs=3600)


def test_samples_of_a_recording_are_those_of_the_range(desk: Desk) -> None:
    desk.server.recordings.start()
    came = desk.link.stats.receive.messages.get("odometry", 0)
    for number in range(50):
        desk.send("odometry", left_ticks=number, right_ticks=0)
        let_pass(0.001)
    wait_until(lambda: desk.link.stats.receive.messages.get("odometry", 0) == came + 50)
    name = desk.server.recordings.stop().name
    path = f"/api/samples.csv?fields=odometry.left_ticks&recording={name}"
    rows = rows_of(desk.ask(path)[1])
    assert [int(row["odometry.left_ticks [ticks]"]) for row in rows] == list(range(50))
    table = desk.ask(f"/api/recordings/{name}.csv?message=odometry")[1].decode().splitlines()[1:]
    assert [float(row["t [s]"]) for row in rows] == [float(line.split(",")[0]) for line in table]
    begin, end = (float(rows[place]["t [s]"]) for place in (10, 19))
    part = rows_of(desk.ask(f"{path}&from={begin - 5e-7}&to={end + 5e-7}")[1])
    assert part == [row for row in rows if begin <= float(row["t [s]"]) <= end]
    assert rows_of(desk.ask(f"{path}&from=1e6")[1]) == []


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("", "give ?fields="),
        ("fields=no.field", "no.field"),
        ("fields=odometry.left_ticks&from=soon", "soon"),
        ("fields=odometry.left_ticks&recording=no.mcap", "no.mcap"),
    ],
)
def test_a_wrong_request_is_a_sentence(desk: Desk, query: str, said: str) -> None:
    status, answer = desk.ask(f"/api/samples.csv?{query}")
    assert status == 422 and said in answer["text"]


def test_measurements_of_the_mcu_have_their_own_time() -> None:
    """Its clock is 100 s ahead; each exchange takes 1 ms either way, and what is measured arrives 5 ms later."""
    proto = codec("linear_axis")
    source = Source(proto, End.HOST, 0.01)

    def feed(end: End, name: str, t: float, **fields: Any) -> None:
        source.feed(end, [proto.encode(name, sender=end.value, **fields)], [t])

    def us(t: float) -> int:
        return round((t + 100) * 1e6)

    for number in range(10):
        t = 1.0 + number * 0.5
        feed(End.HOST, "clock_request", t, host_us=number)
        feed(End.MCU, "clock_reply", t + 0.002, host_us=number, received_us=us(t + 0.001), sent_us=us(t + 0.001))
        feed(End.MCU, "state", t + 0.105, measured=us(t + 0.1), position=0.25, speed=0, stops=[])
    data = b"".join(csv_of_samples(source, ["state.position"], 0, 100, 0.0, counts_from_start=True))
    rows = rows_of(data)
    assert len(rows) == 10 and rows[0]["state.position [m]"] == "0.25"
    for row in rows[1:]:
        assert float(row["t [s]"]) - float(row["measured [s]"]) == pytest.approx(0.005, abs=0.002)


def test_a_raw_capture_in_the_folder_is_decoded_with_the_links_protocol(desk: Desk) -> None:
    folder = desk.server.recordings.folder
    assert folder is not None
    capture = folder / "line.bin"
    capture.write_bytes(b"".join(desk.link.codec.encode("odometry", left_ticks=n, right_ticks=0) for n in range(50)))
    try:
        listed = {one["name"]: one for one in desk.ask("/api/recordings")[1]["recordings"]}
        assert listed["line.bin"]["state"] == "capture" and listed["line.bin"]["size"] == capture.stat().st_size
        rows = rows_of(desk.ask("/api/samples.csv?fields=odometry.left_ticks&recording=line.bin")[1])
        assert [int(row["odometry.left_ticks [ticks]"]) for row in rows] == list(range(50))
        table = desk.ask("/api/recordings/line.bin.csv?message=odometry")[1].decode().splitlines()
        assert len(table) == 51
        assert desk.ask("/api/recordings/line.bin")[1] == capture.read_bytes()
        text = desk.link.codec.model.text
        status, compared = desk.ask("/api/decode", {"text": text.replace("xor8", "sum8"), "recording": "line.bin"})
        assert status == 200
        assert compared["before"]["messages"] == {"odometry": 50} and not compared["after"]["messages"].get("odometry")
    finally:
        capture.unlink()
