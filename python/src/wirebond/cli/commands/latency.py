"""``wirebond latency``: measures, and shows percentiles, a histogram, JSON and a picture."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from wirebond.cli.output import ReaderGone, console, errors, fail, plain, warn, write
from wirebond.cli.signals import ended_by_signals
from wirebond.cli.values import parse_assignments, parse_header, to_json
from wirebond.codec import load
from wirebond.errors import UsageError
from wirebond.link import Link, open_link
from wirebond.sim.latency import Figures, Measurement, Probe, figures, histogram, measure, probe_for
from wirebond.sim.latency.plot import draw, drawing_for
from wirebond.whole_file import write_whole

DEFAULT_COUNT, DEFAULT_RATE, DEFAULT_TIMEOUT = 1000, 100.0, 1.0
_BAR = 40  # characters of the longest bar
_KNOWN_WAIT = 0.5  # seconds for the MCU's clock to be known
_PERCENTILES = {"p50": "p50", "p90": "p90", "p99": "p99", "p99_9": "p99.9", "most": "max"}


def measure_latency(
    path: Path,
    port: str,
    words: list[str],
    *,
    message: str | None,
    header_words: list[str],
    count: int | None,
    rate: float | None,
    seconds: float | None,
    timeout: float | None,
    baud: int | None,
    as_json: bool,
    plot: Path | None,
) -> int:
    """Measure, and return the exit code: 0 if an answer came, 1 if none did, 3 if the port was away at the end."""
    codec = load(path)
    if words and message is None:
        raise UsageError("fields need --message; name the request")
    values: dict[str, Any] = {}
    if message is not None:
        codec.tables.reply_to(message)
        values = parse_assignments(codec.model.message(message), words)
    header = parse_header(codec.model, header_words)
    probe = probe_for(codec, message, values)
    rate = _within("--rate", rate, DEFAULT_RATE, 10_000.0, "per second")
    timeout = _within("--timeout", timeout, DEFAULT_TIMEOUT, 60.0, "seconds")
    if count == 0:
        raise UsageError("--count is 0; expected 1 or more")
    if count is None and seconds is None:
        count = DEFAULT_COUNT
    module = None if plot is None else drawing_for(plot)
    measured = Measurement()
    with ended_by_signals(), open_link(codec, port, baud) as link:
        is_away = False
        try:
            _wait_for_clock(link)
            end = math.inf if seconds is None else time.monotonic() + seconds
            measure(link, probe, measured, count=count, rate=rate, end=end, timeout=timeout, header=header)
        except (KeyboardInterrupt, ReaderGone):  # then the values so far are shown
            pass
        is_away = link.state == "down"
        if link.peer.state == "different":
            warn(link.peer.why)
    title = f"{codec.name} on {port}, by {probe.message}"
    if as_json:
        write(to_json(_as_dict(path, port, probe, measured)) + "\n")
    else:
        _show(title, measured, rate)
    if plot is not None and measured.round_trips:
        write_whole(plot, draw(module, title, measured, plot.suffix[1:].lower()))
        errors.print(f"{plain(str(plot))} has the picture")
    if is_away:
        fail(measured.advice or f"{port} was away at the end")
        return 3
    if not measured.round_trips:
        fail(measured.advice or "nothing was asked; give it more time")
        return 1
    return 0


def _within(option: str, given: float | None, default: float, most: float, unit: str) -> float:
    if given is None:
        return default
    if not 0 < given <= most:
        raise UsageError(f"{option} is {given:g}; expected more than 0 and at most {most:g} {unit}")
    return given


def _wait_for_clock(link: Link) -> None:
    """Wait for the first clock exchanges, so that one-way times exist from the first question on."""
    end = time.monotonic() + _KNOWN_WAIT
    has_clock = link.codec.model.service("clock") is not None
    while has_clock and time.monotonic() < end and ((clock := link.clock) is None or clock.exchanges < 5):
        time.sleep(0.01)


# ---- output


def _series(measured: Measurement) -> dict[str, list[float]]:
    return {"round trip": measured.round_trips, "to the MCU": measured.to_mcu, "to the host": measured.to_host}


def _show(title: str, measured: Measurement, rate: float) -> None:
    lost = f"{measured.lost} lost ({measured.lost / measured.asked:.2%})" if measured.asked else "nothing asked"
    wrong = f", {measured.wrong} of them answered with another number" if measured.wrong else ""
    console.print(f"{plain(title)}: {measured.asked} asked in {measured.seconds:.1f} s, {lost}{wrong}")
    if measured.asked > 10 and measured.asked / measured.seconds < 0.9 * rate:
        console.print(
            f"answers took too long for {rate:g} per second: {measured.asked / measured.seconds:.0f} were asked"
        )
    table = Table(box=None, pad_edge=False)
    for heading in ("ms", *_PERCENTILES.values()):
        table.add_column(heading, justify="left" if heading == "ms" else "right", no_wrap=True)
    for name, times in _series(measured).items():
        made = figures(times)
        if made is not None:
            bound = "" if name == "round trip" else f" ±{measured.one_way_error * 1e3:.3f}"
            table.add_row(name + bound, *(f"{getattr(made, key) * 1e3:.3f}" for key in _PERCENTILES))
    if measured.round_trips:
        console.print()
        console.print(table)
        console.print()
        _show_histogram(measured.round_trips)
        if len(measured.round_trips) < 1000:
            console.print("fewer than 1000 answers: p99.9 is the longest", style="dim")


def _show_histogram(times: list[float]) -> None:
    bins = histogram(times)
    most = max(count for _, _, count in bins)
    for low, high, count in bins:
        bar = "#" * max(round(count / most * _BAR), 1 if count else 0)
        console.print(Text(f"{low * 1e3:9.3f} to {high * 1e3:9.3f} ms {count:7} {bar}"), soft_wrap=True)


def _as_dict(path: Path, port: str, probe: Probe, measured: Measurement) -> dict[str, Any]:
    out: dict[str, Any] = {
        "file": str(path),
        "port": port,
        "message": probe.message,
        "asked": measured.asked,
        "answered": len(measured.round_trips),
        "lost": measured.lost,
        "wrong": measured.wrong,
        "seconds": round(measured.seconds, 3),
    }
    for name, times in _series(measured).items():
        made = figures(times)
        if made is not None:
            out[name.replace(" the", "").replace(" ", "_").lower()] = _figures_dict(made)
    if measured.to_mcu:
        out["one_way_error_us"] = _us(measured.one_way_error)
    out["histogram"] = [{"from_us": _us(a), "to_us": _us(b), "count": n} for a, b, n in histogram(measured.round_trips)]
    if measured.lost:
        out["advice"] = measured.advice
    return out


def _figures_dict(made: Figures) -> dict[str, float]:
    names = {"count": "count", "least": "min_us", "mean": "mean_us", "most": "max_us"}
    return {names.get(key, f"{key}_us"): value if key == "count" else _us(value) for key, value in vars(made).items()}


def _us(seconds: float) -> float:
    return round(seconds * 1e6, 1)
