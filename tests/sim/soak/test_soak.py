"""The overload experiment under virtual time: the line is full, every frame is accounted for, no intact one is lost."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from tests.shared import PROTOCOLS, codec

import wirebond
from wirebond.cli.main import main
from wirebond.errors import UsageError
from wirebond.sim.soak import Progress, Settings, run
from wirebond.sim.soak.plots import NOT_INSTALLED
from wirebond.sim.soak.report import DIRECTIONS, is_good, markdown
from wirebond.sim.soak.unplug import At

pytestmark = pytest.mark.live

SECONDS = 1 / 60  # in minutes
TIMES = ("seconds", "speedup", "host_cpu_seconds", "host_cpu_percent")


def soaked(**settings: Any) -> dict[str, Any]:
    return run(codec("enterprize"), Settings(**settings))


def test_overload_fills_the_line_both_ways_and_every_frame_is_accounted_for() -> None:
    result = soaked(minutes=4 * SECONDS, load=1.2)
    assert result["unaccounted"] == 0
    for name, _ in DIRECTIONS:
        found = result[name]
        assert found["line_use"] >= 0.995
        assert found["longest_wait_us"] <= found["wait_bound_us"]
        assert found["refused_queue_full"] > 0
        assert found["delivered"] == found["sent"] == found["accepted"]
        assert found["offered_load"] == pytest.approx(1.2)
    assert is_good(result)


def test_load_of_the_seed_equals_that_of_its_experiment() -> None:
    """Ten frames of 20.2 bytes and four of 45 bytes each millisecond, on 181.8 bytes."""
    result = soaked(minutes=2 * SECONDS, load=None)
    assert result["to_mcu"]["offered"] == pytest.approx(20_000, abs=10)
    assert result["to_host"]["offered"] == pytest.approx(8_000, abs=4)
    assert result["to_mcu"]["offered_load"] == pytest.approx(1.111)
    assert result["to_host"]["offered_load"] == pytest.approx(0.99)
    assert result["to_host"]["refused_queue_full"] == 0
    assert result["unaccounted"] == 0


def test_no_frame_is_lost_that_no_fault_touched() -> None:
    faults = {"ber": 2e-5, "bursts": 2e-5, "drops": 5e-5, "inserts": 5e-5, "splits": 1e-5}
    result = soaked(minutes=10 * SECONDS, load=1.2, **faults)
    assert result["unaccounted"] == 0
    for name, _ in DIRECTIONS:
        found = result[name]
        assert found["lost_intact"] == 0
        assert found["lost_to_faults"] > 100
        assert found["delivered"] + found["lost_to_faults"] == found["sent"]
        assert all(
            found[kind] > 0 for kind in ("bit_errors", "burst_bytes", "dropped_bytes", "inserted_bytes", "splits")
        )
        assert found["discarded_bytes"]["check_mismatch"] > 0


def test_an_adapter_that_is_late_at_random_loses_nothing() -> None:
    even, late = (soaked(minutes=4 * SECONDS, jitter=jitter) for jitter in (0.0, 0.9e-3))
    for result in (even, late):
        assert result["unaccounted"] == 0
        assert result["to_host"]["lost_intact"] == result["to_host"]["lost_to_faults"] == 0
    assert late["to_host"]["latency_us"] != even["to_host"]["latency_us"]


def test_a_port_that_goes_away_loses_waiting_and_held_bytes_only() -> None:
    times = (At(0.5, 0.3), At(1.2, 1.5))  # the MCU begins reception again after a second
    result = run(codec("enterprize"), Settings(minutes=4 * SECONDS, unplugs=times))
    assert (result["unaccounted"], result["unplugs"]) == (0, 2)
    to_mcu, to_host = (result[name] for name, _ in DIRECTIONS)
    assert to_mcu["expired"] > 100  # the queue, twice
    assert to_mcu["refused_otherwise"] / to_mcu["offered"] == pytest.approx(1.8 / 4, abs=0.01)
    assert to_mcu["line_use"] == pytest.approx(2.2 / 4, abs=0.01)
    assert 0 < to_mcu["unplugged_bytes"] < 2 * 0.006 * 181_819  # what the driver held
    assert to_host["unplugged_bytes"] / to_host["bytes"] == pytest.approx(1.8 / 4, abs=0.01)
    assert 0 < to_mcu["lost_to_faults"] < 2 * 60
    assert is_good(result)
    assert "It was pulled out 2 times." in markdown(result)
    again = run(codec("enterprize"), Settings(minutes=4 * SECONDS, unplugs=times))
    assert again["to_mcu"] == to_mcu


def test_same_seed_gives_the_same_soak() -> None:
    results = [soaked(minutes=SECONDS, ber=1e-4, seed=seed) for seed in (5, 5, 6)]
    once, again, other = ({k: v for k, v in r.items() if k not in (*TIMES, "seed")} for r in results)
    assert once == again
    assert once != other


def test_report_has_the_losses_and_whether_it_ended_early() -> None:
    result = soaked(minutes=SECONDS, ber=1e-4)
    text = markdown(result, ["soak-latency.svg"])
    lost = result["to_mcu"]["lost_to_faults"]
    assert f"| lost: a fault touched them | {lost} |" in text
    assert "![soak-latency.svg](soak-latency.svg)" in text
    assert "Ended early" not in text
    assert "Ended early after 1 s" in markdown(result | {"interrupted": True})
    assert not is_good(result | {"unaccounted": 1})
    assert not is_good(result | {"to_host": result["to_host"] | {"lost_intact": 1}})


def test_ctrl_c_ends_with_the_result_so_far() -> None:
    def press_ctrl_c(_: Progress) -> None:
        raise KeyboardInterrupt

    result = run(codec("enterprize"), Settings(minutes=300), press_ctrl_c)
    assert result["interrupted"]
    assert 0 < result["virtual_seconds"] < 300 * 60
    assert result["unaccounted"] == 0


def test_command_prints_json_and_writes_a_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = tmp_path / "report.md"
    soak = ["soak", "--virtual", "--minutes", "0.02", "--ber", "1e-4"]
    assert main([*soak, "--json", "--report", str(report)]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["virtual_seconds"] == 1.2
    assert result["ber"] == 1e-4
    assert report.read_text().startswith("# Soak of enterprize")
    picture = tmp_path / "report-latency.svg"
    assert picture.exists() == ("![report-latency.svg]" in report.read_text())
    assert picture.exists() or NOT_INSTALLED in report.read_text()


@pytest.mark.parametrize(
    ("option", "sentence"),
    [
        ("--load=0", "--load 0: expected 0.01 to 20 times the capacity of the line, or `seed`"),
        ("--load=much", "--load much: expected 0.01 to 20"),
        ("--minutes=0", "--minutes 0: expected more than 0, and 300 at most"),
        ("--ber=0.5", "--ber 0.5: expected a probability from 0 to 0.1, such as 1e-5"),
        ("--baud=1", "--baud 1: expected 300 to 100000000"),
        ("--jitter=2", "--jitter 2: expected at most 1 ms"),
    ],
)
def test_options_out_of_range_are_refused(option: str, sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["soak", "--virtual", option]) == 2
    assert sentence in " ".join(capsys.readouterr().err.split())


def test_in_real_time_over_a_paced_pair_of_ptys_no_frame_is_lost_that_no_fault_touched() -> None:
    """The load of the line depends on this machine: `make bench ONLY=soak_real_time` measures it."""
    result = soaked(minutes=1.5 * SECONDS, load=1.2, ber=1e-5, virtual=False)
    assert result["unaccounted"] == 0
    assert not result["virtual"]
    for name, _ in DIRECTIONS:
        found = result[name]
        assert found["lost_intact"] == 0
        assert found["delivered"] + found["lost_to_faults"] == found["sent"] > 1000
        assert 0 < found["line_use"] <= 1
    assert is_good(result)
    assert "In real time, over a pair of ptys" in markdown(result)


def test_the_load_of_the_seed_is_for_its_experiment_alone() -> None:
    with pytest.raises(UsageError, match="the load `seed` is the experiment of enterprize"):
        run(codec("diffdrive"), Settings(load=None))


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.long) for name in ("diffdrive", "pid_tuner")])
def test_other_protocols_are_soaked_too(name: str) -> None:
    result = run(wirebond.load(PROTOCOLS / f"{name}.yaml"), Settings(minutes=1, ber=1e-5))
    assert result["unaccounted"] == 0
    assert result["to_mcu"]["lost_intact"] == 0
    assert result["to_host"]["lost_intact"] == 0
    assert result["mcu_cpu_percent"] is None


@pytest.mark.long
def test_a_minute_in_real_time() -> None:
    result = soaked(minutes=1, load=1.2, ber=1e-5, virtual=False)
    assert is_good(result)
    assert result["to_mcu"]["lost_to_faults"] > 0


@pytest.mark.long
def test_ninety_minutes_with_bit_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CXXFLAGS", "")
    for ber in (0.0, 1e-5):
        result = soaked(minutes=90, load=1.2, ber=ber)
        assert is_good(result)
        assert result["to_mcu"]["line_use"] >= 0.995
        assert result["to_host"]["line_use"] >= 0.995
