"""Running a soak's C++ program: its settings, its progress, its result."""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wirebond import paths
from wirebond.codec import Codec
from wirebond.errors import UsageError, WirebondError
from wirebond.generate.code import generate_cpp
from wirebond.protocol.model import End
from wirebond.sim.build import Program, cache, compile_once
from wirebond.sim.faults import LineFaults
from wirebond.sim.soak.header import header
from wirebond.sim.soak.mcu_cost import mcu_cpu_percent
from wirebond.sim.soak.mix import SEED_PERIOD, Mix, mix_of, without_services
from wirebond.sim.soak.samples import are_numbered
from wirebond.sim.soak.unplug import Unplug, plug_times
from wirebond.whole_file import write_whole

RESTART_GAP = 3e-6  # seconds between two runs of the MCU's DMA
BATCH = 1e-3  # seconds: an adapter on full-speed USB hands over once a millisecond


@dataclass(frozen=True, kw_only=True)
class Settings(LineFaults):
    """``load`` None: the mix at its own rate, 1 kHz. Not ``virtual``: in real time, over a paced pair of ptys."""

    minutes: float = 90.0
    load: float | None = 1.2  # times the line's bytes, in each direction
    baud: int | None = None  # None: the file's
    virtual: bool = True
    jitter: float = 0.0  # seconds that the adapter hands over later than its turn, at most and at random
    unplugs: tuple[Unplug, ...] = ()  # how often and when the host's port goes away


@dataclass(frozen=True)
class Progress:
    virtual_seconds: float
    seconds: float


def build(codec: Codec, mix: Mix, virtual: bool = True) -> Path:
    """Return the program for this protocol; it is compiled unless it exists already.

    :raises WirebondError: there is no C++ compiler, or it fails.
    """
    folder = cache(f"soak/{codec.name}-{codec.hash:016x}")
    generated = folder / "generated"
    generate_cpp(codec.model, generated)
    write_whole(generated / "mix.hpp", header(codec, mix))
    # The generated folder has the core without the host's part.
    includes = [generated, paths.sim() / "include", paths.sim() / "soak", paths.core_include(), paths.posix_include()]
    name, source = ("soak", "main.cpp") if virtual else ("soak-real-time", "real_time.cpp")
    return compile_once(Program("the soak", name, paths.sim() / "soak" / source, includes), folder)


def periods(codec: Codec, mix: Mix, settings: Settings) -> dict[End, float]:
    """Return the seconds between two runs of each topic of the host, and of each task of the MCU."""
    if settings.load is None:
        return {End.HOST: SEED_PERIOD, End.MCU: SEED_PERIOD}
    link = codec.model.link
    line = (settings.baud or link.baud) / link.bits_per_byte  # bytes per second
    rounds = {end: mix.bytes_per_round(codec, end) / (settings.load * line) for end in (End.HOST, End.MCU)}
    return {end: seconds or SEED_PERIOD for end, seconds in rounds.items()}  # where nothing is offered any will do


def arguments(codec: Codec, mix: Mix, settings: Settings) -> list[str]:
    link = codec.model.link
    every = periods(codec, mix, settings)
    values = {
        "length_ns": settings.minutes * 60e9,
        "baud": settings.baud or link.baud,
        "bits_per_byte": -(-link.bits_per_byte // 1),
        "host_period_ns": every[End.HOST] * 1e9,
        "mcu_period_ns": every[End.MCU] * 1e9,
    }
    if settings.virtual:
        values |= {"restart_gap_ns": RESTART_GAP * 1e9, "batch_ns": BATCH * 1e9}
        values["jitter_ns"] = settings.jitter * 1e9
    plugs = [f"plug_ns={round(t * 1e9)}" for t in plug_times(settings.unplugs, settings.minutes * 60, settings.seed)]
    return [*(f"{name}={round(value)}" for name, value in values.items()), *settings.fault_arguments(), *plugs]


def run(
    codec: Codec,
    settings: Settings,
    on_progress: Callable[[Progress], None] = lambda _: None,
) -> dict[str, Any]:
    """Return what ``wirebond soak --json`` prints. KeyboardInterrupt ends it early: the result then covers the time
    until then.

    :raises UsageError: the protocol cannot be soaked, or not with this load, or there is no C++ compiler.
    :raises WirebondError: the program does not compile, or fails.
    """
    mix = mix_of(codec)
    codec = without_services(codec)
    if settings.load is None and not mix.is_seed:
        raise UsageError(f"{codec.name}: the load `seed` is the experiment of enterprize; give a number, such as 1.2")
    program = build(codec, mix, settings.virtual)
    command = [str(program), *arguments(codec, mix, settings)]
    # A session of its own: Ctrl-C in the terminal is for us, and we pass it on.
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
        assert process.stdout is not None
        result: dict[str, Any] | None = None
        interrupted = False
        while True:
            try:
                line = process.stdout.readline()
                if not line:
                    break
                told = json.loads(line)
                if "result" in told:
                    result = told["result"]
                else:
                    on_progress(Progress(**told))
            except KeyboardInterrupt:
                interrupted = True
                process.send_signal(signal.SIGINT)
    if result is None:
        raise WirebondError(f"the soak's program ended with code {process.returncode} and without a result")
    return _completed(codec, mix, settings, result) | {"interrupted": interrupted}


def _completed(codec: Codec, mix: Mix, settings: Settings, result: dict[str, Any]) -> dict[str, Any]:
    causes = list(codec.decoder(End.HOST).stats.discarded_bytes)
    every = periods(codec, mix, settings)
    line = (settings.baud or codec.model.link.baud) / codec.model.link.bits_per_byte
    for name, end in (("to_mcu", End.HOST), ("to_host", End.MCU)):
        found = result[name]
        counts = dict(zip(causes, found["discarded_bytes"], strict=True))
        found["discarded_bytes"] = {cause: count for cause, count in counts.items() if count}
        found["offered_load"] = mix.bytes_per_round(codec, end) / every[end] / line
        found["line_use"] = round(found["line_use"], 6)
        names = {turn.message for turn in mix.turns(end)}
        found["messages"] = len(names)
        found["numbered_messages"] = sum(are_numbered(codec, one, end) for one in names)
    seconds = result["virtual_seconds"] or 1.0
    result["host_cpu_percent"] = 100 * result["host_cpu_seconds"] / seconds
    told = {
        "protocol": codec.name,
        "baud": settings.baud or codec.model.link.baud,
        "load": "seed" if settings.load is None else settings.load,
        "ber": settings.ber,
        "seed": settings.seed,
        "virtual": settings.virtual,
        "unplugs": len(plug_times(settings.unplugs, settings.minutes * 60, settings.seed)) // 2,
        "restart_gap_us": RESTART_GAP * 1e6 if settings.virtual else 0.0,
        "batch_us": BATCH * 1e6 if settings.virtual else 0.0,
    } | result
    return told | {"mcu_cpu_percent": mcu_cpu_percent(told)}
