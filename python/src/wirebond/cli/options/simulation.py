"""Commands that simulate an MCU, a wire, or both."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from wirebond.cli.interrupts import raise_from_here
from wirebond.cli.numbers import amount, whole
from wirebond.cli.options.shared import AsJson, Baud, Browser, ProtocolFile, Seconds

commands = typer.Typer()
Ber = Annotated[
    float | None,
    typer.Option(parser=amount, metavar="CHANCE", help="Chance that a bit of the line is wrong, such as 1e-5."),
]
Bursts = Annotated[
    float | None,
    typer.Option(
        parser=amount, metavar="CHANCE", help="Chance of each byte that 16 bytes from it on become any bytes."
    ),
]
Drops = Annotated[float | None, typer.Option(parser=amount, metavar="CHANCE", help="Chance that a byte is lost.")]
Inserts = Annotated[
    float | None,
    typer.Option(
        parser=amount, metavar="CHANCE", help="Chance of each byte that one comes before it that was not sent."
    ),
]
Splits = Annotated[
    float | None,
    typer.Option(parser=amount, metavar="CHANCE", help="Chance that the line pauses for 2 ms after a byte."),
]
FaultSeed = Annotated[
    int | None, typer.Option("--seed", parser=whole, metavar="INTEGER", help="Of the random faults. Default: 1.")
]


@commands.command()
def sim(
    file: ProtocolFile,
    link: Annotated[Path | None, typer.Option(help="Also reach the pty under this name (a symbolic link).")] = None,
    seconds: Seconds = None,
    address: Annotated[
        list[str] | None,
        typer.Option(metavar="ADDRESS", help="Play the device of this address, or of several. Without it: of any."),
    ] = None,
    script: Annotated[
        Path | None, typer.Option(metavar="PATH", help="Python that says how it behaves; docs/simulation.md shows it.")
    ] = None,
    with_stats: Annotated[
        bool, typer.Option("--stats", help="At the end, print as JSON how much the MCU received and refused.")
    ] = False,
    clock_drift: Annotated[
        float, typer.Option(metavar="PPM", help="Its clock is fast by this many parts per million; negative: slow.")
    ] = 0.0,
) -> None:
    """Run a virtual MCU that speaks this protocol, on a pty; print the pty's path."""
    from wirebond.cli.commands.live import simulate

    raise_from_here()
    simulate(file, link, seconds, address or [], script, with_stats, clock_drift)


@commands.command()
def wire(
    a: Annotated[Path, typer.Argument(metavar="A", help="Name for one end: a symbolic link to its pty.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="Name for the other end.")],
    baud: Baud = None,
    line: Annotated[str, typer.Option(metavar="8N1", help="Data bits, parity and stop bits.")] = "8N1",
    baud_b: Annotated[
        int | None, typer.Option(parser=whole, metavar="N", help="End B runs at this rate, if it differs.")
    ] = None,
    line_b: Annotated[str | None, typer.Option(metavar="8E1", help="End B has this shape of a byte.")] = None,
    ber: Ber = None,
    bursts: Bursts = None,
    drops: Drops = None,
    inserts: Inserts = None,
    splits: Splits = None,
    seed: FaultSeed = None,
    batch: Annotated[
        float | None, typer.Option(parser=amount, metavar="MS", help="An adapter hands over at multiples of this time.")
    ] = None,
    jitter: Annotated[
        float | None, typer.Option(parser=amount, metavar="MS", help="And up to this much later, at random.")
    ] = None,
    unplug: Annotated[
        str | None, typer.Option(metavar="AT:FOR", help="Pull the cable after AT seconds, for FOR seconds.")
    ] = None,
    echo: Annotated[
        bool, typer.Option("--echo", help="Both directions share one line, as on RS-485: an end hears its own bytes.")
    ] = False,
    script: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Faults at times, one a line: `2.5 a_to_b drop 10`.")
    ] = None,
    seconds: Seconds = None,
    as_json: AsJson = False,
) -> None:
    """Join two ptys by a simulated wire with a baud rate and faults; say at the end what became of every byte."""
    from wirebond.cli.commands.wire import join_ptys, line_shape, unplugging
    from wirebond.sim.wire.process import WireSettings
    from wirebond.sim.wire.script import read_script

    raise_from_here()
    given = {"baud": baud, "ber": ber, "bursts": bursts, "drops": drops, "inserts": inserts, "splits": splits}
    given |= {"baud_b": baud_b, "seed": seed, "batch": None if batch is None else batch / 1000}
    given |= {"jitter": None if jitter is None else jitter / 1000}
    settings = WireSettings(
        line=line_shape(line),
        line_b=None if line_b is None else line_shape(line_b),
        unplug=None if unplug is None else unplugging(unplug),
        echo=echo,
        script=() if script is None else read_script(script),
        **_given(given),
    )
    join_ptys(a, b, settings, seconds, as_json)


def _given(values: dict[str, Any]) -> dict[str, Any]:
    """Remove options that were not given: the settings have defaults."""
    return {name: value for name, value in values.items() if value is not None}


@commands.command()
def soak(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="Protocol file; without it: enterprize.")
    ] = None,
    virtual: Annotated[
        bool,
        typer.Option("--virtual", help="Under virtual time, as fast as this machine can; without it in real time."),
    ] = False,
    minutes: Annotated[
        float | None,
        typer.Option(
            parser=amount, metavar="NUMBER", help="How long, by the line's clock. Default: 90, in real time 1."
        ),
    ] = None,
    load: Annotated[
        str,
        typer.Option(metavar="X|seed", help="Offer X times the capacity of the line; seed: the experiment's own rate."),
    ] = "1.2",
    baud: Baud = None,
    ber: Ber = None,
    bursts: Bursts = None,
    drops: Drops = None,
    inserts: Inserts = None,
    splits: Splits = None,
    seed: FaultSeed = None,
    jitter: Annotated[
        float | None,
        typer.Option(parser=amount, metavar="MS", help="The adapter hands over up to this much later, at random."),
    ] = None,
    unplug: Annotated[
        list[str] | None,
        typer.Option(
            metavar="AT:FOR|N",
            help="Pull the host's adapter at AT seconds for FOR seconds, or N times at random. Repeat it.",
        ),
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Write a report in Markdown, and its plot beside it.")] = None,
    as_json: AsJson = False,
) -> None:
    """Offer more than the line carries at both ends, and account for every frame. Exit 1 if one is missing."""
    from wirebond.cli.commands.soak import soak_protocol
    from wirebond.sim.soak.run import Settings
    from wirebond.sim.soak.unplug import unplug as unplug_of

    raise_from_here()
    given = {
        "unplugs": tuple(unplug_of(text) for text in unplug or ()),
        "minutes": minutes,
        "baud": baud,
        "ber": ber,
        "bursts": bursts,
        "drops": drops,
        "inserts": inserts,
    }
    if minutes is None and not virtual:
        given["minutes"] = 1.0
    given |= {"splits": splits, "seed": seed, "jitter": None if jitter is None else jitter / 1000}
    settings = Settings(virtual=virtual, **_given(given))
    raise typer.Exit(soak_protocol(file, load, settings, as_json, report))


@commands.command()
def demo(
    seconds: Seconds = None,
    in_terminal: Annotated[bool, typer.Option("--terminal", help="Show it here, and not in a browser.")] = False,
    browser: Browser = True,
    ros2: Annotated[
        bool, typer.Option("--ros2", help="Make the rover a node of ROS 2. It does not move until ROS drives it.")
    ] = False,
) -> None:
    """Drive a simulated rover over a tty and watch the link in the console, until Ctrl-C."""
    from wirebond.cli.commands.demo import run_demo

    raise_from_here()
    raise typer.Exit(run_demo(seconds, in_terminal, browser, ros2))
