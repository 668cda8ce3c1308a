"""Short benchmarks: the same code with fewer frames, so that a figure of the README cannot rot unseen."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from bench import (
    collateral,
    columns,
    encoding,
    host_cpu,
    loaded_round_trip,
    m4_cost,
    m4_runtime,
    mcu_line,
    native,
    python_round_trip,
    reconnect,
    round_trip,
    send_queue,
    work_per_byte,
)
from bench.peers.work import Flat

import wirebond
from tests.shared import ROOT
from tests.waiting import moments

pytestmark = pytest.mark.live

LONG = pytest.mark.long
NO_TABLES = ("servo_bus", "native", "enterprize", "contrib/sphero", "contrib/xbee_api_2")


def test_intact_frames_survive_their_neighbours_faults() -> None:
    for figure in collateral.measure(frames=20_000):
        assert figure.value <= 1, figure.key  # a false frame may overlap an intact one: 7 in a million at the reference


@LONG
def test_the_mcus_clock_and_its_bad_line_keep_their_goals() -> None:
    assert all(figure.met for figure in mcu_line.measure())


def test_perfect_line_loses_nothing_at_any_chunk_size() -> None:
    (figure,) = collateral.measure_clean(frames=100, chunks=range(1, 300))
    assert figure.value == 0


def test_damage_is_seen_by_the_measure_itself() -> None:
    """A test of the test: frames that cannot be found must show."""
    random = np.random.default_rng(1)
    sent = collateral.clean_traffic(1000, random)
    lossy = sent.data.copy()
    lossy[sent.starts[::10]] = 0
    outcome = collateral.run(sent, collateral.Traffic(lossy, sent.starts, sent.sizes), chunk=64)
    assert outcome.collateral == 100


def test_no_frame_is_lost_between_threads() -> None:
    lost = [figure.value for figure in send_queue.measure(frames=20_000) if "lost" in figure.key]
    assert lost == [0, 0, 0, 0]


def test_a_busy_line_loses_nothing_in_either_direction() -> None:
    for _ in moments("frames in both directions"):
        _, sent, handled, lost = host_cpu.load(seconds=0.5, line_use=0.1)
        assert lost == 0
        if sent > 100 and handled > 50:
            break


def test_a_link_comes_back_each_time() -> None:
    assert len(reconnect.came_back(3)) == 3


def test_each_frame_of_a_round_trip_comes_back() -> None:
    """Either end fails where a frame does not."""
    program = native.build("round_trip", round_trip.PROTOCOL)
    processors = os.sched_getaffinity(0)
    for ends in (
        round_trip.bare,
        round_trip.with_wirebond,
        python_round_trip.with_wirebond,
        python_round_trip.with_pyserial,
    ):
        p50, p99 = ends(program, processors, trips=100)
        assert 0 < p50 <= p99


def test_probes_come_back_on_a_busy_line() -> None:
    program = native.build("loaded_round_trip", round_trip.PROTOCOL)
    processors = os.sched_getaffinity(0)
    for ends in (loaded_round_trip.bare, loaded_round_trip.with_wirebond):
        for _ in moments("probes"):
            trips, _ = ends(program, processors, seconds=0.3)
            if len(trips) > 10:
                break
        assert min(trips) > 0.9 * 2 * 45 * 11 / 2e6 * 1e9  # the line's own time both ways


def test_work_per_byte_is_bounded_for_the_worst_input() -> None:
    (figure,) = work_per_byte.measure()
    assert figure.met, f"{figure.value:.0f} instructions"


def test_generated_code_on_a_cortex_m4_agrees_with_the_host_and_keeps_its_cost() -> None:
    """The measure fails where a frame is not found or comes out as another."""
    for figure in m4_cost.measure_shortly():
        assert figure.met, f"{figure.key}: {figure.value:.0f} instructions"


def test_a_send_on_a_cortex_m4_takes_few_instructions() -> None:
    """`measure_send` fails where what lies in the queue is not the message's frame."""
    figure, _ = m4_runtime.measure_send()  # the other one has no goal
    assert figure.goal == 400 and figure.met, f"{figure.value:.0f} instructions"


def test_a_link_on_a_cortex_m4_takes_little_memory_and_its_stack_has_a_bound() -> None:
    figures = m4_runtime.measure_memory(("diffdrive",))
    goals = {figure.key: figure.goal for figure in figures if figure.goal is not None}
    assert goals == {"m4_flash_bytes": 6656, "m4_ram_bytes": 448}
    for figure in figures:
        assert figure.met, f"{figure.key}: {figure.value:.0f} {figure.unit}"


@pytest.mark.parametrize(
    "name",
    [
        "contrib/mavlink",
        *(pytest.param(name, marks=LONG) for name in NO_TABLES),
    ],
)
def test_no_table_of_the_frame_format_is_in_flash(name: str) -> None:
    """It has room for the largest format that there can be, ten kilobytes: all of it folds into the code. Of the
    formats here some are stuffed or numbered, and two have several forms."""
    sizes = replace(m4_runtime.OTHERS, receive=2048, send=2048)
    program, _ = m4_runtime.runtime(wirebond.load(ROOT / "protocols" / f"{name}.yaml").model, "-Os", sizes)
    assert not [symbol for symbol in program.symbols if "format_from" in symbol]


def test_a_servo_on_a_cortex_m4_answers_only_its_own_frames_and_takes_little_memory() -> None:
    """`measure_servo` fails where it answers another's request or a broadcast, or not its own."""
    found = {figure.key: figure.value for figure in m4_runtime.measure_servo()}
    assert found["m4_servo_flash_bytes"] < 8 * 1024
    assert found["m4_servo_ram_bytes"] < 512


def test_a_debug_build_on_a_cortex_m4_fits_flash_and_task_stacks() -> None:
    figures = m4_runtime.measure_debug_builds()
    assert len(figures) == 8
    assert not [figure for figure in figures if not figure.met]


def test_frames_made_by_hand_are_the_codecs() -> None:
    figures = encoding.measure(frames=900, rounds=1, least_seconds=0)  # raises where the bytes differ
    assert [figure.key for figure in figures] == ["encode_per_s", "encode_over_struct"]


def test_all_codecs_make_the_same_of_the_same_frames() -> None:
    found: dict[str, Flat] = {}
    for entry in columns.entries(frames=900):
        codec = entry.codec
        assert codec.messages(entry.stream) == entry.frames, codec.name
        flat = codec.flat(codec.columns(entry.stream))
        found[codec.name] = {name: [tuple(column)[:3] for column in table] for name, table in flat.items()}
        assert sum(len(table[0]) for table in flat.values()) == entry.frames, codec.name
    assert len(found) == 1 + len(columns.PEERS), "a peer is not installed"
    for name, values in found.items():
        assert values == found["Wirebond"], name
