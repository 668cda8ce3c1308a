"""A soak's result as a Markdown report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from wirebond.sim.soak.mcu_cost import CLOCK_HZ, SOURCE

DIRECTIONS = (("to_mcu", "host to MCU"), ("to_host", "MCU to host"))

_FATES = (
    ("offered", "offered"),
    ("refused_queue_full", "refused: the queue was full"),
    ("refused_otherwise", "refused for another reason: the port was away"),
    ("accepted", "accepted"),
    ("expired", "expired: too old, or the port went away"),
    ("replaced", "replaced by a newer one (`queue: latest`)"),
    ("queued", "still queued"),
    ("sent", "sent"),
    ("delivered", "delivered"),
    ("lost_to_faults", "lost: a fault touched them"),
    ("lost_to_false", "lost: a false frame may lie over them"),
    ("lost_intact", "lost: no fault touched them"),
    ("false_frames", "delivered, and not sent like this"),
    ("refused_by_rules", "came, and a rule of the file kept them from the handler"),
)


def is_good(result: dict[str, Any]) -> bool:
    """Check that every frame is accounted for, no intact frame is lost, and none was kept for too long."""
    return not result["unaccounted"] and all(
        not found["lost_intact"]
        and (found["wait_bound_us"] is None or found["longest_wait_us"] <= found["wait_bound_us"])
        for found in (result[name] for name, _ in DIRECTIONS)
    )


def verdicts(result: dict[str, Any]) -> list[str]:
    """Return the results of the soak, a sentence each."""
    lines = [
        f"{_count(result['unaccounted'], 'frame or byte', 'frames or bytes')} unaccounted for.",
    ]
    for name, title in DIRECTIONS:
        found = result[name]
        if not found["messages"]:
            continue
        lost = f"{_count(found['lost_intact'], 'frame', 'frames')} lost that no fault touched"
        wait = ""
        if found["wait_bound_us"] is not None:
            wait = f", longest wait {_time(found['longest_wait_us'])} of {_time(found['wait_bound_us'])} allowed"
        lines.append(f"{title}: line use {100 * found['line_use']:.2f} %, {lost}{wait}.")
    return lines


def markdown(result: dict[str, Any], plots: Sequence[str] = (), note: str = "") -> str:
    """Return the whole report. ``plots`` are file names of pictures, ``note`` is a sentence in their place."""
    mcu = result["mcu_cpu_percent"]
    sections = [
        f"# Soak of {result['protocol']}",
        f"{_length(result)} at {result['baud']} baud, load {result['load']}, bit errors {result['ber']:g}, "
        f"seed {result['seed']}. {_line(result)}",
        "\n".join(f"- {line}" for line in verdicts(result)),
        "## Frames",
        _table(["", *(title for _, title in DIRECTIONS)], [[text, *_row(result, key)] for key, text in _FATES]),
        "offered = refused + accepted; accepted = sent + queued + expired + replaced; sent = delivered + lost. All of "
        f"this was counted outside of the links and compared with their own accounts. {_numbers(result)}",
        "## Line",
        _table(
            ["", *(title for _, title in DIRECTIONS)],
            [
                ["offered load", *(f"{100 * result[n]['offered_load']:.1f} %" for n, _ in DIRECTIONS)],
                ["line use", *(f"{100 * result[n]['line_use']:.3f} %" for n, _ in DIRECTIONS)],
                ["bytes", *_row(result, "bytes")],
                ["bit errors", *_row(result, "bit_errors")],
                ["bytes in bursts", *_row(result, "burst_bytes")],
                ["bytes dropped", *_row(result, "dropped_bytes")],
                ["bytes inserted", *_row(result, "inserted_bytes")],
                ["pauses", *_row(result, "splits")],
                ["bytes lost with the adapter", *_row(result, "unplugged_bytes")],
                ["bytes lapped in the ring", *_row(result, "lapped_bytes")],
                *_causes(result),
            ],
        ),
        "## Latency",
        f"From accepted to delivered. {_latency(result)}",
        _table(
            ["", *(title for _, title in DIRECTIONS)],
            [
                *(
                    [key, *(_time(result[n]["latency_us"][key]) for n, _ in DIRECTIONS)]
                    for key in ("p50", "p90", "p99", "p99.9", "max")
                ),
                *(
                    [text, *("none" if result[n][key] is None else _time(result[n][key]) for n, _ in DIRECTIONS)]
                    for text, key in (
                        ("longest from accepted to gone", "longest_wait_us"),
                        ("allowed", "wait_bound_us"),
                    )
                    if result["virtual"]
                ),
            ],
        ),
        "\n".join(f"![{name}]({name})" for name in plots) or note,
        "## Processors",
        f"- Host: {result['host_cpu_percent']:.2f} % of a core, measured: "
        + ("the link's core, without system calls and Python." if result["virtual"] else "its thread, without Python."),
        f"- MCU: {mcu:.2f} % of {CLOCK_HZ / 1e6:g} MHz, computed: {SOURCE}."
        if mcu is not None
        else "- MCU: not known; instructions were counted for enterprize alone.",
        f"- The soak itself took {result['seconds']:.1f} s, {result['speedup']:.0f} times faster than real time."
        if result["virtual"]
        else "",
    ]
    return "\n\n".join(section for section in sections if section) + "\n"


def _line(result: dict[str, Any]) -> str:
    if not result["virtual"]:
        return "In real time, over a pair of ptys with a paced wire between them."
    unplugged = f" It was pulled out {_count(result['unplugs'], 'time', 'times')}." if result["unplugs"] else ""
    return (
        f"Each run of the MCU's DMA costs a gap of {result['restart_gap_us']:g} us; the host's adapter hands over "
        f"every {result['batch_us'] / 1000:g} ms.{unplugged}"
    )


def _numbers(result: dict[str, Any]) -> str:
    numbered, all_of_them = (sum(result[name][key] for name, _ in DIRECTIONS)
                             for key in ("numbered_messages", "messages"))  # fmt: skip
    return (
        f"Each frame is known by its place on the line; {numbered} of {_count(all_of_them, 'message', 'messages')} "
        "have room for a running number beside."
    )


def _latency(result: dict[str, Any]) -> str:
    if result["virtual"]:
        return "The host's end includes its adapter, the MCU's end the wait for the next poll, each 1 ms."
    return "With the ptys' buffers of 8 KB each, and with the lateness of this machine."


def _row(result: dict[str, Any], key: str) -> list[str]:
    return [str(result[name][key]) for name, _ in DIRECTIONS]


def _causes(result: dict[str, Any]) -> list[list[str]]:
    causes = dict.fromkeys(cause for name, _ in DIRECTIONS for cause in result[name]["discarded_bytes"])
    return [
        [f"bytes discarded, {cause}", *(str(result[name]["discarded_bytes"].get(cause, 0)) for name, _ in DIRECTIONS)]
        for cause in causes
    ]


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---", *("--:" for _ in head[1:])], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _length(result: dict[str, Any]) -> str:
    seconds = result["virtual_seconds"]
    told = f"{seconds / 60:g} minutes" if seconds >= 60 else f"{seconds:g} s"
    return f"Ended early after {told}" if result["interrupted"] else f"{told[0].upper()}{told[1:]}"


def _time(microseconds: float) -> str:
    return f"{microseconds / 1000:.2f} ms" if microseconds >= 1000 else f"{microseconds:.1f} us"


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"
