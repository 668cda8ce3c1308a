"""Replies that nothing in their frames tells apart: the request before them says what they are."""

from __future__ import annotations

import os
import random
import subprocess
from pathlib import Path

import pytest

from tests import reference
from tests.conformance.build import FLAGS, build_decoder, decode
from tests.shared import ROOT, account_closes, loaded
from tests.streams import chunks, hard_stream, random_values
from wirebond import UsageError
from wirebond.generate.code import generate_cpp
from wirebond.protocol.model import End

pytestmark = pytest.mark.live

FORMATS = {name: ROOT / "tests" / "formats" / f"{name}.yaml" for name in ("by_request", "shared_ids")}


@pytest.mark.parametrize("name", FORMATS)
def test_each_reply_is_what_was_asked_for(name: str) -> None:
    proto = loaded(FORMATS[name])
    source = random.Random(name)
    requests = [m for m in proto.model.messages if m.reply]
    decoder = proto.decoder("mcu")
    for _ in range(300):
        request = source.choice(requests)
        reply = proto.model.message(request.reply or "")
        values = random_values(reply, source)
        frame = proto.encode(reply.name, values)
        decoder.expect(request.name)
        messages = [message for chunk in chunks(frame, source) for message in decoder.feed(chunk)]
        assert [(m.name, m.raw) for m in messages] == [(reply.name, frame)]
        assert proto.encode(reply.name, messages[0].fields) == frame
    assert account_closes(decoder.stats)


def test_a_shared_id_means_the_unrequested_message_until_a_request_leaves() -> None:
    proto = loaded(FORMATS["shared_ids"])
    status = proto.encode("status", code=3)
    decoder = proto.decoder("mcu")
    assert [m.name for m in decoder.feed(status)] == ["status"]
    decoder.expect("read_limits")
    assert decoder.feed(status) == []  # too short for the limits
    decoder.expect(None)
    assert [m.name for m in decoder.feed(status + status)] == ["status", "status"]


def test_a_reply_that_has_begun_to_arrive_is_read_by_the_latest_request() -> None:
    proto = loaded(FORMATS["by_request"])
    frame = proto.encode("speed", speed=0.5)
    decoder = proto.decoder("mcu")
    decoder.expect("read_state")
    assert decoder.feed(frame) == []  # a state is longer
    decoder.expect("read_speed")
    assert [m.fields for m in decoder.feed(b"")] == []
    assert [m.fields for m in decoder.finish()] == [{"speed": 0.5}]


def test_an_id_means_another_message_in_each_direction() -> None:
    proto = loaded(FORMATS["shared_ids"])
    frame = bytes.fromhex("5a 01 00")
    assert proto.encode("read_limits")[:3] == frame
    assert proto.encode("alive", count=7)[:2] == frame[:2]
    assert [m.name for m in proto.decoder("host").feed(proto.encode("read_limits"))] == ["read_limits"]
    assert [m.fields for m in proto.decoder("mcu").feed(proto.encode("alive", count=7))] == [{"count": 7}]
    with pytest.raises(UsageError, match="say whose bytes these are"):
        proto.decoder()


def test_expect_refuses_what_is_no_request() -> None:
    decoder = loaded(FORMATS["shared_ids"]).decoder("mcu")
    with pytest.raises(UsageError, match="reboot has no `reply` in shared_ids; messages that have one: read_limits"):
        decoder.expect("reboot")
    with pytest.raises(UsageError, match="has no message 'reed'"):
        decoder.expect("reed")


@pytest.mark.parametrize("name", FORMATS)
def test_engine_generated_code_and_reference_agree(name: str, tmp_path: Path) -> None:
    proto = loaded(FORMATS[name])
    program = build_decoder(proto.model, End.MCU)
    names = [m.name for m in proto.model.messages]
    file = tmp_path / "stream.bin"
    for request in [None, *(m.name for m in proto.model.messages if m.reply)]:
        source = random.Random(f"{name} {request}")
        stream = hard_stream(proto, source, pieces=150)
        expected = reference.decode(proto.model, stream, End.MCU, request)
        decoder = proto.decoder("mcu")
        decoder.expect(request)
        messages = [m for chunk in chunks(stream, source) for m in decoder.feed(chunk)] + decoder.finish()
        assert [reference.Frame(m.offset, m.raw, m.id, m.name, m.header) for m in messages] == expected.frames
        stats = decoder.stats.as_dict()
        assert stats["discarded_bytes"] == dict(expected.discarded_bytes)
        assert stats["rejected_candidates"] == dict(expected.rejected_candidates)

        file.write_bytes(stream)
        reply = -1 if request is None else names.index(proto.tables.reply_to(request))
        for chunk in (1, 0):
            result = decode(program, file, chunk=chunk, expected=reply)
            found = [(f.offset, f.wire, f.id, names[f.message] if f.message >= 0 else "unknown") for f in result.frames]
            assert found == [(f.offset, f.wire, f.id, f.name) for f in expected.frames]
            for cause, count in expected.discarded_bytes.items():
                assert result.account[f"discarded.{cause}"] == count


ASKING = """
#include "by_request.hpp"
#include <cstdio>

struct Asking {
  void on(const by_request::Speed& m) { std::printf("speed %d\\n", static_cast<int>(m.speed * 1000)); }
  void on(const by_request::State& m) { std::printf("state %d\\n", static_cast<int>(m.faults)); }
};

template <class Reply>
void answer(by_request::Receiver<by_request::FromMcu>& receiver, const Reply& reply, Asking& asking) {
  std::uint8_t frame[64];
  std::size_t size = 0;
  if (by_request::encode(reply, frame, sizeof frame, size) != wirebond::Status::ok) std::printf("not encoded\\n");
  receiver.feed(frame, size, 0, asking);
}

int main() {
  by_request::Receiver<by_request::FromMcu> receiver;
  Asking asking;
  by_request::Speed speed;
  speed.speed = 0.5F;
  by_request::State state;
  state.faults = 9;
  answer(receiver, speed, asking);  // nobody has asked
  receiver.expect<by_request::ReadState>();
  answer(receiver, state, asking);
  receiver.expect<by_request::ReadSpeed>();
  answer(receiver, speed, asking);
}
"""


def test_a_generated_receiver_learns_what_was_asked(tmp_path: Path) -> None:
    generate_cpp(loaded(FORMATS["by_request"]).model, tmp_path)
    (tmp_path / "asking.cpp").write_text(ASKING)
    program = tmp_path / "asking"
    compiler = os.environ.get("CXX", "g++")
    command = [compiler, *FLAGS, "-O0", f"-I{tmp_path}", str(tmp_path / "asking.cpp"), "-o", str(program)]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    run = subprocess.run([program], capture_output=True, text=True, check=True)
    assert run.stdout == "state 9\nspeed 500\n"
