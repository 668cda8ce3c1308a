"""A soak of every kind of protocol: numbers, addresses, shared ids, queues, ports that go away."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.shared import PROTOCOLS

import wirebond
from wirebond import Codec
from wirebond.cli.main import main
from wirebond.errors import UsageError
from wirebond.protocol import loads
from wirebond.protocol.model import End
from wirebond.sim.soak import Settings, mix_of, run
from wirebond.sim.soak.mix import without_services
from wirebond.sim.soak.report import DIRECTIONS, is_good
from wirebond.sim.soak.samples import SAMPLES, are_numbered, samples
from wirebond.sim.soak.unplug import AtRandom, plug_times, unplug

# Stuffed and numbered, so that the number changes the size; addresses; messages of one id told by `match`; messages
# without a field; both queues; a hello that a link would say by itself.
EVERYTHING = """
wirebond: 1
protocol: everything
link: {baud: 921600}
frame:
  - delimiter: 0x00
  - cobs:
    - id: u8
    - sequence: u8
    - {field: source, type: u8, address: sender}
    - {field: destination, type: u8, address: receiver}
    - payload: rest
    - check: crc-16/ibm-sdlc
  - delimiter: 0x00
messages:
  command: {id: 1, sender: host, fields: {speed: {type: i16, range: [-300, 300]}, mark: {type: u8}}}
  stop: {id: 2, sender: host}
  start: {id: 3, sender: host, match: {what: 1}, fields: {what: {type: u8}, flag: {type: bool}}}
  pause: {id: 3, sender: host, match: {what: 2}, fields: {what: {type: u8}}}
  state: {id: 1, sender: mcu, fields: {x: {type: f32}, number: {type: u16, scale: 0.5}}}
  tick: {id: 2, sender: mcu}
  near: {id: 3, sender: mcu, match: {kind: 1}, fields: {kind: {type: u8}, on: {type: bool}}}
  far: {id: 3, sender: mcu, match: {kind: 2}, fields: {kind: {type: u8}}}
  alarm: {id: 4, sender: mcu, queue: urgent}
  pose: {id: 5, sender: mcu, queue: latest, fields: {x: {type: i32}, y: {type: i32}}}
  hello: {id: 6, sender: both, fields: {protocol_hash: {type: u64}, version: {type: u16}}}
services:
  hello: {message: hello}
"""

SECONDS = 1 / 60  # in minutes
FILES = sorted([*PROTOCOLS.glob("*.yaml"), *PROTOCOLS.glob("contrib/*.yaml")])


@pytest.fixture(scope="module")
def everything() -> Codec:
    return Codec(loads(EVERYTHING))


FAULTS = {"ber": 1e-4, "drops": 1e-4, "inserts": 1e-4, "bursts": 2e-5, "jitter": 5e-4}


@pytest.mark.live
def test_frames_with_numbers_addresses_shared_ids_and_queues_are_accounted_for(everything: Codec) -> None:
    for faults in ({}, FAULTS, {**FAULTS, "unplugs": (AtRandom(5),)}):
        result = run(everything, Settings(minutes=3 * SECONDS, **faults))
        assert result["unaccounted"] == 0
        for name, _ in DIRECTIONS:
            found = result[name]
            assert found["lost_intact"] == 0
            assert (found["lost_to_faults"] > 50) == bool(faults)
            assert found["delivered"] > 1000
            lost = found["lost_to_faults"] + found["lost_to_false"]
            assert found["delivered"] + lost == found["sent"]
        to_host = result["to_host"]
        assert to_host["replaced"] > 0  # of `queue: latest`
        assert to_host["wait_bound_us"] is None  # urgent frames may keep others waiting
        assert to_host["refused_queue_full"] > 0
        assert result["to_mcu"]["line_use"] > (0.99 if "unplugs" not in faults else 0.4)
        assert is_good(result)


@pytest.mark.live
@pytest.mark.long
def test_a_soak_with_no_check_counts_false_frames_and_loses_no_intact_one() -> None:
    """Its frames are known by their place on the line, and not by what they say."""
    slip = wirebond.load(PROTOCOLS / "contrib" / "slip.yaml")
    result = run(slip, Settings(minutes=2 * SECONDS, ber=1e-4))
    assert result["unaccounted"] == 0
    for name, _ in DIRECTIONS:
        assert result[name]["false_frames"] > 10
        assert result[name]["lost_intact"] == 0


def test_samples_hold_a_running_number_where_a_message_has_room(everything: Codec) -> None:
    plain = without_services(everything)
    numbered = {
        m.name for m in plain.model.messages if are_numbered(plain, m.name, End(m.sender.replace("both", "mcu")))
    }
    assert numbered == {"command", "state", "pose", "hello"}
    decoder = plain.decoder("mcu")
    values = [decoder.feed(frame)[0].fields["number"] for frame in samples(plain, "state", End.MCU)]
    assert values == [number / 2 for number in range(SAMPLES)]
    assert len(set(samples(plain, "near", End.MCU))) == 2  # a bool has room for one bit


def test_a_direction_without_messages_is_left_out() -> None:
    ibus = wirebond.load(PROTOCOLS / "contrib" / "ibus.yaml")
    mix = mix_of(ibus)
    assert not mix.host
    assert mix.mcu


def test_experiments_that_cannot_be_judged_are_refused_with_the_reason() -> None:
    with pytest.raises(UsageError, match="silence ends its frames"):
        mix_of(wirebond.load(PROTOCOLS / "contrib" / "modbus_rtu.yaml"))
    asked = """
wirebond: 1
protocol: asked
frame: [magic: 0xA5, id: u8, payload: 2, check: crc-16/modbus]
messages:
  ask_a: {id: 1, sender: host, reply: a}
  ask_b: {id: 2, sender: host, reply: b}
  a: {id: 3, sender: mcu, fields: {x: {type: u16}}}
  b: {id: 3, sender: mcu, fields: {y: {type: u16}}}
"""
    with pytest.raises(
        UsageError, match="only a request identifies these messages, but a soak sends them without one: a, b"
    ):
        mix_of(Codec(loads(asked)))


@pytest.mark.parametrize("text", ["", "x", "1:", "0", "2:0.001", "-1:1", "20000"])
def test_unplug_that_makes_no_sense_is_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["soak", "--virtual", f"--unplug={text}"]) == 2
    assert "expected AT:FOR in seconds, such as 2:0.5" in " ".join(capsys.readouterr().err.split())


def test_unplug_needs_virtual_time(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["soak", "--unplug", "1:1"]) == 2
    assert "--unplug is for the simulated adapter of --virtual" in " ".join(capsys.readouterr().err.split())


def test_times_of_unplugging_are_those_of_the_seed() -> None:
    given = (unplug("2:0.5"), unplug("2.2:1"), unplug("9.9:5"))
    assert plug_times(given, 10, 1) == pytest.approx([2, 3.2, 9.9, 10])
    drawn = plug_times([unplug("7")], 60, 3)
    assert drawn == plug_times([unplug("7")], 60, 3) != plug_times([unplug("7")], 60, 4)
    assert drawn == sorted(drawn)
    assert 0 <= drawn[0] < drawn[-1] <= 60


@pytest.mark.live
@pytest.mark.long
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_protocol_file_of_the_project(path: Path) -> None:
    one = wirebond.load(path)
    try:
        mix_of(one)
    except UsageError as error:
        assert "silence ends its frames" in str(error)  # noqa: PT017 most files raise none
        return
    settings: list[dict[str, Any]] = [{}, {"ber": 1e-4}, {"ber": 1e-4, "unplugs": (AtRandom(3),)}]
    for faults in settings:
        result = run(one, Settings(minutes=0.05, **faults))
        assert result["unaccounted"] == 0
        assert is_good(result)
