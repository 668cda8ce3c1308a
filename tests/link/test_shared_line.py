"""One line that both ends send on: each frame has its sender where the protocol tells one."""

from __future__ import annotations

import json
import random
from typing import Any

import pytest

import wirebond
from tests.shared import PROTOCOLS, codec
from tests.waiting import PATIENCE, wait_until
from wirebond import Codec, UsageError
from wirebond.cli.main import main
from wirebond.link.shared_line import SharedLine
from wirebond.protocol import loads
from wirebond.sim.pty_port import PtyPort

ROVER = codec("diffdrive")
VELOCITY = ROVER.encode("velocity", linear=0.5, angular=0)
ODOMETRY = ROVER.encode("odometry", left_ticks=1, right_ticks=1)
HEAD = "wirebond: 1\nprotocol: bus\n"
FRAME = "frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/modbus]\n"
SAME_ID = """
messages:
  set: {id: 1, sender: host, fields: {x: {type: u8}}}
  state: {id: 1, sender: mcu, fields: {y: {type: u8}}}
  read: {id: 2, sender: host, reply: value}
  value: {id: 2, sender: mcu}
  note: {id: 3, sender: both}
"""


def heard(of: Codec, data: bytes, step: int = 0) -> list[tuple[str, str]]:
    line = SharedLine(of)
    found = []
    for at in range(0, len(data), step or len(data)):
        found += line.feed(data[at : at + (step or len(data))], 0.0)
    found += line.finish()
    stats = line.stats
    assert stats.bytes == len(data) == stats.frame_bytes + stats.other_bytes + stats.pending_bytes
    assert sum(stats.frames.values()) == len(found)
    return [(str(sender), message.name) for sender, message in found]


@pytest.mark.parametrize("step", [0, 1, 7])
def test_ids_identify_the_sender(step: int) -> None:
    source = random.Random(step)
    data = b"".join(frame + source.randbytes(source.randrange(4)) for frame in [VELOCITY, ODOMETRY] * 10)
    expected = [("host", "velocity"), ("mcu", "odometry")] * 10
    assert heard(ROVER, data, step) == expected
    assert SharedLine(ROVER).untold == []


def test_a_frame_that_one_end_alone_knows_is_its_own_although_the_other_reads_it_as_unknown() -> None:
    of = codec("native")
    data = of.encode("command", speed=1, mode="idle") + of.encode("state", position=1, current=2, faults=[])
    assert heard(of, data) == [("host", "command"), ("mcu", "state")]


def test_addresses_identify_the_sender_of_messages_of_both() -> None:
    addressed = Codec(loads(HEAD + """
frame:
  - magic: 0xA5
  - {field: source, type: u8, address: sender, default: {host: 1, mcu: 7}}
  - {field: target, type: u8, address: receiver, default: {host: 7, mcu: 1}}
  - id: u8
  - payload: 0
  - check: crc-16/modbus
messages: {note: {id: 3, sender: both}}
"""))  # fmt: skip
    data = b"".join(addressed.encode("note", sender=sender) for sender in ("host", "mcu", "mcu"))
    assert heard(addressed, data) == [("host", "note"), ("mcu", "note"), ("mcu", "note")]
    assert SharedLine(addressed).untold == []


def test_indistinguishable_messages_are_reported_and_come_as_either() -> None:
    of = Codec(loads(HEAD + FRAME + SAME_ID))
    line = SharedLine(of)
    assert [sentence.split(" look")[0].split(", and")[0] for sentence in line.untold] == [
        "set of the host and state of the MCU",
        "both ends send note",
    ]
    data = of.encode("set", x=1) + of.encode("note", sender="mcu") + of.encode("state", y=1)
    assert heard(of, data) == [("either", "set"), ("either", "note"), ("either", "set")]


def test_a_reply_follows_its_request_and_nothing_else_does() -> None:
    of = Codec(loads(HEAD + FRAME + SAME_ID))
    read, value = of.encode("read"), of.encode("value")
    assert read == value
    assert heard(of, read + value + read + value) == [("host", "read"), ("mcu", "value")] * 2


def test_a_request_identifies_its_reply_if_nothing_else_does() -> None:
    of = Codec(loads(HEAD + FRAME + """
messages:
  ask_speed: {id: 1, sender: host, reply: speed}
  ask_heat: {id: 2, sender: host, reply: heat}
  speed: {id: 9, sender: mcu, fields: {v: {type: u16}}}
  heat: {id: 9, sender: mcu, fields: {t: {type: i16}}}
"""))  # fmt: skip
    speed, heat = of.encode("speed", v=1), of.encode("heat", t=1)
    data = of.encode("ask_heat") + heat + of.encode("ask_speed") + speed
    for step in (0, 1):
        assert [name for _, name in heard(of, data, step)] == ["ask_heat", "heat", "ask_speed", "speed"]


def test_requests_and_replies_of_modbus_on_rs_485() -> None:
    """Silence ends its frames, and its replies have the ids of their requests."""
    of = wirebond.load(PROTOCOLS / "contrib" / "modbus_rtu.yaml")
    line = SharedLine(of)
    got = []
    requests = [m.name for m in of.model.messages if m.reply is not None and m.sent_by("host")][:2]
    t = 0.0
    for name in requests:
        reply = of.model.message(name).reply
        assert reply is not None
        for sent, sender in ((name, "host"), (reply, "mcu")):
            got += line.feed(of.encode(sent, VALUES.get(sent, {}), sender=sender), t)
            t += 0.1
            got += line.idle(t)
    assert [(str(sender), message.name) for sender, message in got] == [
        pair for name in requests for pair in (("host", name), ("mcu", of.model.message(name).reply))
    ]


VALUES: dict[str, dict[str, object]] = {
    "read_holding_registers": {"first": 1, "number": 2},
    "holding_registers": {"registers": [5, 6]},
    "write_register": {"address": 1, "value": 2},
}


@pytest.mark.live
def test_listen_reads_one_port_that_hears_both() -> None:
    port = PtyPort()
    with wirebond.listen(ROVER, port=port.path) as line:
        got: list[wirebond.Heard] = []
        for frame in (
            VELOCITY,
            b"\x00rubbish",
            ODOMETRY,
        ):
            port.write(frame)
        while len(got) < 2:
            more = line.receive(PATIENCE)
            assert more
            got += more
        assert [(h.sender, h.message.name) for h in got] == [("host", "velocity"), ("mcu", "odometry")]
        assert line.shared is not None
        assert line.shared.other_bytes == 8
        assert line.links["line"].stats.send.offered == 0
    assert port.read(0) == b""
    port.close()
    with pytest.raises(UsageError, match="give host_port and mcu_port"):
        wirebond.listen(ROVER, port="/dev/a", mcu_port="/dev/b")


@pytest.mark.live
def test_the_command_names_the_senders_on_one_port(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    port = PtyPort()

    def listen_and_hear(*arguments: Any, **options: Any) -> wirebond.Listener:
        listener = wirebond.listen(*arguments, **options)
        port.write(VELOCITY + ODOMETRY)
        wait_until(lambda: listener.links["line"].stats.receive.bytes == len(VELOCITY + ODOMETRY), "both")
        return listener

    monkeypatch.setattr("wirebond.cli.commands.listen.listen", listen_and_hear)
    file = str(PROTOCOLS / "diffdrive.yaml")
    assert main(["listen", file, "--port", port.path, "--seconds", "0.3", "--json"]) == 0
    said = capsys.readouterr()
    assert [json.loads(line)["from"] for line in said.out.splitlines()] == ["host", "mcu"]
    assert "frames: 1 of host, 1 of mcu, 0 of either; 0 bytes in none" in " ".join(said.err.split())
    port.close()
    assert main(["listen", file, "--port", "/dev/a", "--mcu-port", "/dev/b"]) == 2
    assert "or --port for a line that both ends send on" in " ".join(capsys.readouterr().err.split())
