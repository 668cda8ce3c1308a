"""Every public format of protocols/contrib, byte for byte against another implementation of it."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

import pytest

from tests.contrib.cases import CONTRIB, random_case
from tests.contrib.oracles import ORACLES
from tests.contrib.oracles.mavlink import pack
from tests.contrib.oracles.msp import pack as pack_msp
from tests.shared import account_closes, few_or_many, loaded
from wirebond import Codec, Message
from wirebond.protocol.model import End

DAMAGES = 3  # to each frame

each_format = pytest.mark.parametrize("name", sorted(ORACLES))


def test_every_file_has_an_oracle() -> None:
    assert sorted(ORACLES) == sorted(path.stem for path in CONTRIB.glob("*.yaml"))


def decoded(codec: Codec, stream: bytes, sender: End) -> list[Message]:
    decoder = codec.decoder(sender)
    messages = decoder.feed(stream) + decoder.finish()
    assert account_closes(decoder.stats)
    return messages


def valued(message: Message, values: dict[str, Any]) -> dict[str, Any]:
    """The fields that a sender gives values; the others count those, which the other side's bytes prove."""
    return {name: message.fields.get(name) for name in values}


@few_or_many(100, 10_000)
@each_format
def test_both_write_and_read_the_same_bytes(name: str, number: int) -> None:
    codec, oracle = loaded(CONTRIB / f"{name}.yaml"), ORACLES[name]
    source = random.Random(f"{name} {number}")
    compared = 0
    for _ in range(number):
        case, values = random_case(codec, oracle, source)
        frame = codec.encode(case.message, values, header=case.header)
        theirs = oracle.encode(case)
        assert theirs in (None, frame)
        (message,) = decoded(codec, frame, case.sender)
        assert (message.name, valued(message, values), message.violations) == (case.message, values, [])
        assert case.header.items() <= message.header.items()
        read = oracle.decode(frame, case.sender)
        assert read == (case if oracle.reads(case) else None)
        compared += theirs is not None or read is not None
    assert compared == number  # each message was written or read by the other side


@few_or_many(100, 10_000)
@each_format
def test_damaged_frames_are_refused_where_the_other_side_refuses_them(name: str, number: int) -> None:
    codec, oracle = loaded(CONTRIB / f"{name}.yaml"), ORACLES[name]
    source = random.Random(f"damaged {name} {number}")
    refused = 0
    for _ in range(number):
        case, values = random_case(codec, oracle, source)
        while not oracle.reads(case):
            case, values = random_case(codec, oracle, source)
        frame = codec.encode(case.message, values, header=case.header)
        for _ in range(DAMAGES):
            bad = damaged(frame, source)
            messages = decoded(codec, bad, case.sender)
            accepted = oracle.decode(bad, case.sender) is not None
            assert not accepted or [m.raw for m in messages] == [bad]
            for message in messages:  # damage can leave, or make, another frame
                assert is_for_newer_peers(codec, message) or oracle.decode(message.raw, case.sender) is not None
            refused += not accepted
    assert refused > number


def is_for_newer_peers(codec: Codec, message: Message) -> bool:
    """Delivered because its checks hold, with an id, length or value that the file does not know."""
    if message.name == "unknown" or message.violations:
        return True
    return codec.encode(message.name, message.fields, header=message.header) != message.raw


def damaged(frame: bytes, source: random.Random) -> bytes:
    """A bit turned, a byte replaced, lost, doubled, or the end cut off; never the frame itself."""
    while True:
        at = source.randrange(len(frame))
        bad = source.choice(
            [
                frame[:at] + bytes([frame[at] ^ 1 << source.randrange(8)]) + frame[at + 1 :],
                frame[:at] + source.randbytes(1) + frame[at + 1 :],
                frame[:at] + frame[at + 1 :],
                frame[:at] + frame[at : at + 1] + frame[at:],
                frame[:at],
            ]
        )
        if bad != frame:
            return bad


# ---- what one format has and the others have not


@pytest.mark.parametrize(("version_1", "secret"), [(True, None), (False, bytes(range(32)))])
def test_mavlink_of_version_1_and_signed_frames_are_read(version_1: bool, secret: bytes | None) -> None:
    codec, oracle = loaded(CONTRIB / "mavlink.yaml"), ORACLES["mavlink"]
    source = random.Random("mavlink")
    for _ in range(300):
        case, values = random_case(codec, oracle, source)
        if version_1 and case.message == "command_ack":
            case = replace(case, wire=[*case.wire[:2], 0, 0, 0, 0])  # extensions are not sent
            values |= {"progress": 0, "result_param2": 0, "target_system": 0, "target_component": 0}
        (message,) = decoded(codec, pack(case, version_1, secret), case.sender)
        assert (message.name, valued(message, values), message.violations) == (case.message, values, [])


def test_a_dynamixel_status_has_its_error_flags_as_id() -> None:
    codec = loaded(CONTRIB / "dynamixel_1.yaml")
    (message,) = decoded(codec, bytes.fromhex("FF FF 01 02 24 D8"), End.MCU)  # overload and overheating
    assert (message.name, message.id, message.header) == ("status", 0x24, {"servo": 1, "id": 0x24})


def test_an_hdlc_frame_of_a_receiver_that_is_not_ready() -> None:
    codec = loaded(CONTRIB / "hdlc.yaml")
    frame = codec.encode("not_ready", header={"receive": 3})
    assert frame[1:3] == bytes([0xFF, 0x65])  # ISO/IEC 13239: 1 0 1 0 P/F and the number, from the lowest bit
    (message,) = decoded(codec, frame, End.MCU)
    assert (message.name, message.header["receive"]) == ("not_ready", 3)


def test_msp_of_version_1_is_read_and_an_error_reply_names_the_request() -> None:
    codec, oracle = loaded(CONTRIB / "msp.yaml"), ORACLES["msp"]
    source = random.Random("msp")
    for _ in range(300):
        case, values = random_case(codec, oracle, source)
        if case.message == "set_air_speed" or case.header.get("id", 0) > 0xFF:
            continue  # its id has two bytes
        (message,) = decoded(codec, pack_msp(case, version_1=True), case.sender)
        assert (message.name, message.fields, message.violations) == (case.message, values, [])
    (message,) = decoded(codec, b"$M!\x00\x6c\x6c", End.MCU)
    assert (message.name, message.id, message.header) == ("failed", 108, {"magic": 0x244D21, "id": 108})
