"""`/views`: what a page sees of the link, live and recorded; and a page that does not keep up."""

from __future__ import annotations

import itertools
import json
import math
import socket
import struct
from typing import Any

import numpy as np
import pytest

from tests.console.conftest import Desk, batches, hear, say, view
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.live


def odometry(desk: Desk, count: int, first: int = 0) -> None:
    for number in range(first, first + count):
        desk.send("odometry", left_ticks=number, right_ticks=-number)


def row_of(said: dict[str, Any], name: str) -> dict[str, Any]:
    return next(row for row in said["rows"] if row["name"] == name)


def test_the_link_view_has_rates_and_changes_at_once(desk: Desk) -> None:
    with desk.look(link=True) as socket:
        link = view(socket, "link")
        assert link["protocol"] == "diffdrive" and link["connected"] and not link["stopped"]
        for key in ("rates", "receive", "send", "peer", "clock", "round_trip", "recording", "history", "line"):
            assert key in link
        desk.link.emergency_stop()
        assert view(socket, "link", lambda said: said["stopped"])["t"] >= link["t"]
        desk.link.release_stop()
        assert not view(socket, "link", lambda said: not said["stopped"])["stopped"]


def test_the_table_has_every_message_of_both_ends_with_what_it_says(desk: Desk) -> None:
    with desk.look(messages={"every": 0.05}) as socket:
        odometry(desk, 3, 7)
        desk.link.send("velocity", linear=0.5, angular=0.0)

        def is_all_there(said: dict[str, Any]) -> bool:
            """Earlier tests of this file have sent both: what they sent may still be shown."""
            went, came = row_of(said, "velocity").get("fields"), row_of(said, "odometry")
            return (
                went == {"linear": 0.5, "angular": 0.0}
                and came["count"] >= 3
                and came["fields"]["left_ticks"] == 9
                and came["rate"] > 0
            )

        said = view(socket, "messages", is_all_there)
        came = row_of(said, "odometry")
        assert came["fields"] == {"left_ticks": 9, "right_ticks": -9} and came["sender"] == "mcu"
        assert bytes.fromhex(came["bytes"]) == desk.codec.encode("odometry", left_ticks=9, right_ticks=-9)
        assert came["due"] == 20 and came["rate"] > 0 and came["count"] >= 3
        assert row_of(said, "velocity")["sender"] == "host"
        assert {row["name"] for row in said["rows"]} == {m.name for m in desk.codec.model.messages}
        sparks = view(socket, "messages", lambda said: "spark" in row_of(said, "odometry"))
        assert len(row_of(sparks, "odometry")["spark"]["values"]) == 40


def test_violations_are_marked(desk: Desk) -> None:
    payload = bytes([0xAA, 0x55, 0x01, 0xFF, 0x7F, 0, 0, 0, 0])  # 32.767 m/s
    with desk.look(messages={"every": 0.05}, frames={"most": 5}) as socket:
        desk.link.internals.engine.send(0, payload + bytes([0xAA ^ 0x55 ^ 1 ^ 0xFF ^ 0x7F, 0x0D]), -1, False, 0)
        said = view(socket, "messages", lambda said: "violations" in row_of(said, "velocity"))
        assert "linear" in row_of(said, "velocity")["violations"][0]


def test_frames_and_the_bytes_between_them_are_shown_and_explained(desk: Desk) -> None:
    good = desk.codec.encode("odometry", left_ticks=1, right_ticks=2)
    bad = good[:-2] + bytes([good[-2] ^ 1, good[-1]])
    with desk.look(frames={"message": "odometry", "most": 3}) as socket:
        desk.pty.write(good + bad + good)

        def has_come(said: dict[str, Any]) -> bool:
            return [entry["kind"] for entry in said["entries"]][-3:] == ["frame", "discarded", "frame"]

        entries = view(socket, "frames", has_come)["entries"]
        assert bytes.fromhex(entries[-2]["bytes"]) == bad and entries[-1]["message"] == "odometry"
        assert [entry["n"] for entry in entries] == sorted(entry["n"] for entry in entries)
        status, explained = desk.ask("/api/explain", {"bytes": entries[-2]["bytes"], "sender": "mcu"})
        assert status == 200
        assert explained["stretches"][0]["cause"] == "check_mismatch" and explained["stretches"][0]["rows"]
        say(socket, {"views": {"frames": {"message": "status"}}})
        assert all(entry["kind"] != "frame" for entry in view(socket, "frames", lambda said: said["t"] > 0)["entries"])


def test_events_come_once_each_and_all_to_a_later_client(desk: Desk) -> None:
    """The machine's pauses add events of the link."""

    def marks(said: dict[str, Any]) -> list[str]:
        return [event["text"] for event in said["events"] if event["kind"] == "mark"]

    with desk.look(events=True) as socket:
        whole = view(socket, "events")
        assert whole["replace"] is True
        earlier = marks(whole)  # those of other tests
        for text in ("look here", "and here"):
            desk.server.recordings.mark(text)
            told = view(socket, "events", marks)
            assert (told["replace"], marks(told)) == (False, [text])
    with desk.look(events=True) as socket:
        assert marks(view(socket, "events")) == [*earlier, "look here", "and here"]


def test_a_plot_gets_only_new_rows_and_ends_with_every_sample(desk: Desk) -> None:
    fields = ["odometry.left_ticks", "odometry.right_ticks"]
    held: dict[str, dict[float, tuple[float, float]]] = {name: {} for name in fields}
    with desk.look(plots=[{"id": "p", "fields": fields, "seconds": 30, "pixels": 4000}]) as socket:
        sent = 0
        for batch in batches(socket):
            for name, (t, low, high) in batch.columns.items():
                known = {} if batch.head["replace"] else {at: row for at, row in held[name].items() if at < t[0]}
                new = zip(t.tolist(), zip(low.tolist(), high.tolist(), strict=True), strict=True)
                held[name] = known | dict(new)
            newest = [
                max((high for _, high in rows.values() if not math.isnan(high)), default=0) for rows in held.values()
            ]
            if sent == 60 and newest[0] == 5059:
                break
            if sent == 0 or (newest[0] == 5000 + sent - 1 and sent < 60):
                odometry(desk, 20, 5000 + sent)
                sent += 20
    shown = [row for _, row in sorted(held[fields[0]].items()) if row[0] >= 5000]
    assert shown[0][0] == 5000 and shown[-1][1] == 5059
    for (_, high), (low, _) in itertools.pairwise(shown):
        assert low == high + 1  # no sample is missing, and none is in two pixels
    assert min(low for low, _ in held[fields[1]].values()) == -5059


def test_a_range_that_reaches_into_the_future_gets_only_what_is_new(desk: Desk) -> None:
    with desk.look(link=True) as socket:
        begin = view(socket, "link")["t"]
    plot = {"id": "p", "fields": ["odometry.left_ticks"], "from": begin, "to": begin + 60, "pixels": 12000}
    with desk.look(plots=[plot]) as socket:
        came = batches(socket)
        first = next(came)
        assert first.head["replace"] and first.head["width"] == pytest.approx(60 / 12000)
        for number in (500, 501, 502):
            odometry(desk, 1, number)
            batch = next(came)
            (_, low, high) = batch.columns["odometry.left_ticks"]
            assert not batch.head["replace"] and len(low) <= 3 and high[-1] == number
            assert (batch.head["from"], batch.head["to"]) == (plot["from"], plot["to"])


def test_a_wrong_wish_is_a_sentence_and_the_rest_goes_on(desk: Desk) -> None:
    with desk.look(link=True) as socket:
        view(socket, "link")
        for wrong in [
            {"views": {"plots": [{"id": "a", "fields": [], "seconds": -1}]}},
            {"views": {"plots": [{"id": "a", "from": 2, "to": 1}]}},
            {"views": {"plots": [{"id": "a", "seconds": 1}, {"id": "a", "seconds": 1}]}},
            {"views": {"frames": {"most": 10**9}}},
            {"views": {"messages": {"every": 0}}},
            {"views": {"mesages": {"every": 1}}},
            {"views": 7},
            [],
        ]:
            say(socket, wrong)
            text = view(socket, "error")["text"]
            assert "does not name the data to show" in text or "plot" in text or "there is no view 'mesages'" in text, (
                text
            )
        say(socket, {"views": {"link": True, "plots": [{"id": "a", "fields": ["no.field"], "seconds": 5}]}})
        assert "no.field" in view(socket, "error")["text"]
        view(socket, "link")


def test_a_page_that_draws_slowly_gets_at_most_two_rounds_and_then_the_newest(desk: Desk) -> None:
    with desk.web("/views") as socket:
        say(socket, {"token": desk.token, "acks": True, "views": {"messages": {"every": 0.05}}})
        view(socket, "end")
        odometry(desk, 1, 1)
        view(socket, "end")  # both are under way now: nothing tells that they were drawn
        newest = 11
        for number in range(2, newest + 1):
            odometry(desk, 1, number)
            assert json.loads(socket.recv(timeout=PATIENCE))["view"] == "beat"
        with desk.look(messages={"every": 0.05}) as other:
            view(other, "messages", lambda said: row_of(said, "odometry")["fields"]["left_ticks"] == newest)
        say(socket, {"seen": 2})
        assert row_of(view(socket, "messages"), "odometry")["fields"]["left_ticks"] == newest


def deaf(desk: Desk, said: Any) -> socket.socket:
    """A client that says this, and never reads."""
    found = socket.create_connection(("127.0.0.1", desk.port))
    upgrade = f"GET /views HTTP/1.1\r\nHost: {desk.host}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    found.sendall(f"{upgrade}Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode())
    assert found.recv(16).startswith(b"HTTP/1.1 101")
    text = json.dumps(said).encode()
    found.sendall(b"\x81\xfe" + struct.pack(">H", len(text)) + bytes(4) + text)  # masked by zeros
    return found


def test_a_page_that_does_not_read_delays_nobody(desk: Desk) -> None:
    plots = [{"id": "p", "fields": ["odometry.left_ticks"], "seconds": 10, "pixels": 4000}]
    wish = {"messages": {"every": 0.05}, "frames": {"most": 500}, "plots": plots}
    with deaf(desk, {"token": desk.token, "views": wish}), desk.look(messages={"every": 0.05}) as other:
        for number in range(100, 120):
            odometry(desk, 1, number)
            view(
                other,
                "messages",
                lambda s, n=number: (row_of(s, "odometry").get("fields") or {}).get("left_ticks") == n,
            )


def test_a_recording_has_the_same_views(desk: Desk) -> None:
    desk.server.recordings.start()
    with desk.look(messages={"every": 0.05}) as socket:
        odometry(desk, 30, 900)
        view(socket, "messages", lambda said: (row_of(said, "odometry").get("fields") or {}).get("left_ticks") == 929)
    desk.server.recordings.mark("end")
    name = desk.server.recordings.stop().name
    plot = {"id": "p", "fields": ["odometry.left_ticks"], "from": 0.0, "to": 60.0, "pixels": 4000}
    wish = {"source": {"recording": name}, "messages": {}, "frames": {"most": 3}, "events": True, "plots": [plot]}
    with desk.look(**wish) as socket:
        about = view(socket, "recording")
        assert about["to"] > 0 and about["problems"] == []
        assert row_of(view(socket, "messages"), "odometry")["fields"]["left_ticks"] == 929
        assert len(view(socket, "frames")["entries"]) == 3
        assert view(socket, "events")["events"][-1]["text"] == "end"
        (_, low, high) = next(batches(socket)).columns["odometry.left_ticks"]
        assert (np.nanmin(low), np.nanmax(high)) == (900, 929)
        say(socket, {"views": {**wish, "at": 0.0}})
        assert row_of(view(socket, "messages"), "odometry")["count"] == 0
        say(socket, {"views": {**wish, "source": {"recording": "../nothing.mcap"}}})
        assert "nothing" in view(socket, "error")["text"]
    assert desk.ask("/api/recordings")[1]["recordings"][0]["name"] == name
    assert desk.ask(f"/api/recordings/{name}")[1].startswith(b"\x89MCAP")
    status, rows = desk.ask(f"/api/recordings/{name}.csv?message=odometry")
    assert status == 200 and rows.splitlines()[0] == b"t,left_ticks,right_ticks" and len(rows.splitlines()) == 31
    assert desk.ask(f"/api/recordings/{name}.csv?message=no")[0] == 422
    assert desk.ask("/api/recordings/no.mcap")[0] == 422


def test_an_edited_file_is_tried_on_received_bytes(desk: Desk) -> None:
    odometry(desk, 10)
    wait_until(lambda: desk.link.stats.receive.pending_bytes == 0 and desk.link.stats.receive.frames >= 10)
    text = desk.codec.model.text
    wait_until(lambda: desk.ask("/api/decode", {"text": text, "live": 100})[1]["before"]["frames"] >= 10)
    status, same = desk.ask("/api/decode", {"text": text, "live": 100})
    assert status == 200 and same["before"] == same["after"] and same["rows"][-1]["name"] == "odometry"
    _, other = desk.ask("/api/decode", {"text": text.replace("xor8", "sum8"), "live": 100})
    assert other["after"]["discarded_bytes"]["check_mismatch"] > 0
    assert other["after"]["messages"].get("odometry", 0) < other["before"]["messages"]["odometry"]
    status, wrong = desk.ask("/api/decode", {"text": "x", "live": 100})
    assert status == 422 and wrong["problems"][0]["line"] == 1


@pytest.mark.parametrize("body", [b"", b"[]", b"{", b'{"text": 3}', b"\xff" * 50])
@pytest.mark.parametrize("path", ["explain", "check", "decode", "identify", "connect", "new", "import", "save"])
def test_a_wrong_body_is_a_sentence(desk: Desk, path: str, body: bytes) -> None:
    status, answer = desk.ask(f"/api/{path}", body, method="POST")
    assert 400 <= status < 500 and answer["text"]


def test_a_body_without_end_is_refused(desk: Desk) -> None:
    assert desk.ask("/api/check", b" " * (5 << 20))[0] == 413


def test_the_protocol_is_described_for_forms(desk: Desk) -> None:
    form = desk.ask("/api/protocol")[1]
    assert form["hash"] == f"{desk.codec.hash:016x}" and form["text"] == desk.codec.model.text
    velocity = next(m for m in form["messages"] if m["name"] == "velocity")
    assert velocity["is_controlled"] and velocity["every"] == 0.05
    linear = velocity["fields"][0]
    assert (linear["kind"], linear["unit"], linear["min"], linear["max"], linear["step"]) == (
        "number",
        "m/s",
        -2,
        2,
        0.001,
    )
    assert linear["columns"] == ["velocity.linear"]
    status = next(m for m in form["messages"] if m["name"] == "status")
    assert {field["name"]: field["kind"] for field in status["fields"]}["errors"] == "flags"
    assert form["emergency_stop"][0]["message"] == "velocity"
    assert desk.ask("/api/document")[1]["markdown"].startswith("# diffdrive")
    assert desk.ask("/api/schema")[0] == 200
    assert "simulators" in desk.ask("/api/ports")[1]


def test_commands_are_logged_with_their_client(desk: Desk) -> None:
    with desk.attach(name="tester") as socket:
        hear(socket, lambda said: said.get("re") == 1)
        for number, fields in enumerate([{"number": 1}, {"number": 1}, {"no": 2}]):
            say(
                socket,
                {"do": "send", "id": number + 2, "message": "status_query", "fields": {} if number < 2 else fields},
            )
            hear(socket, lambda said, id=number + 2: said.get("re") == id)
    mine = [c for c in desk.ask("/api/log")[1]["commands"] if c["name"] == "tester"]
    assert [(c["do"], c["message"], c["count"], c["error"]) for c in mine] == [
        ("send", "status_query", 2, ""),
        ("send", "status_query", 1, "message"),
    ]
