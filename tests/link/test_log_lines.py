"""The MCU's log lines: handlers by level, Python's `logging` with a bound, and what `monitor` makes of them."""

from __future__ import annotations

import asyncio
import io
import logging

import pytest
from rich.console import Console

import wirebond
from tests.link.mcu import linked
from tests.link.protocol import manipulator
from tests.shared import codec
from tests.waiting import PATIENCE, moments, wait_until
from wirebond import LogEvent, UsageError
from wirebond.cli.dashboard import Dashboard
from wirebond.cli.shown import log_text
from wirebond.link.log_lines import MOST_A_SECOND, LineLimit
from wirebond.protocol import loads
from wirebond.protocol.log import LogLine

pytestmark = pytest.mark.live

NATIVE = codec("native")
BY_NUMBER = wirebond.Codec(
    loads("""
wirebond: 1
protocol: by_number
frame: [magic: 0xA5, id: u8, payload: by_id, check: crc-16/modbus]
messages:
  hot:   {id: 1, sender: mcu, log: "motor {motor} is hot", level: warning, fields: {motor: {type: u8}}}
  state: {id: 2, sender: mcu, fields: {x: {type: u8}}}
""")
)


def said(level: str, text: str) -> bytes:
    return NATIVE.encode("log", level=level, text=text)


def test_a_handler_gets_lines_from_its_level_on() -> None:
    with linked(NATIVE) as (link, mcu):
        events: list[LogEvent] = []

        @link.on_log("warning")
        def note(event: LogEvent) -> None:
            events.append(event)

        everything: list[LogEvent] = []
        link.on_log()(everything.append)
        for level in ("debug", "info", "warning", "error"):
            mcu.write(said(level, f"a {level}\x1b[2J"))
        wait_until(lambda: len(everything) == 4, "four lines")
        assert [(e.line.level, e.message["text"]) for e in events] == [
            ("warning", "a warning\x1b[2J"),
            ("error", "a error\x1b[2J"),
        ]
        assert str(events[0]) == "warning: a warning\\x1b[2J"
        assert link.receive() == []  # it has a handler
        link.off(note)
        link.off(everything.append)


def test_lines_whose_text_is_in_the_file_are_handled_too() -> None:
    with linked(BY_NUMBER) as (link, mcu):
        events: list[LogEvent] = []
        link.on_log()(events.append)
        mcu.send("state", x=1)
        mcu.send("hot", motor=3)
        wait_until(lambda: events, "the line")
        assert events[0].line == LogLine("warning", "motor 3 is hot")
        assert [m.name for m in link.receive(PATIENCE)] == ["state"]


def test_coroutines_handle_lines() -> None:
    async def wait_for_line() -> LogEvent:
        with linked(NATIVE) as (link, mcu):
            found: asyncio.Future[LogEvent] = asyncio.get_running_loop().create_future()

            @link.aio.on_log("error")
            async def note(event: LogEvent) -> None:
                found.set_result(event)

            mcu.write(said("info", "no") + said("error", "yes"))
            return await asyncio.wait_for(found, PATIENCE)

    assert asyncio.run(wait_for_line()).line == LogLine("error", "yes")


def test_wrong_use_is_a_sentence() -> None:
    with linked(NATIVE) as (link, _):
        with pytest.raises(UsageError, match="level is 'loud'; expected debug, info, warning, error"):
            link.on_log("loud")
        with pytest.raises(UsageError, match=r"register it with link\.aio\.on_log"):

            @link.on_log()
            async def note(event: LogEvent) -> None: ...

    with linked(manipulator()) as (link, _), pytest.raises(UsageError, match="manipulator has no log lines"):
        link.on_log()


def test_logging_gets_every_line_with_its_level(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG, "wirebond.log")
    with linked(NATIVE) as (link, mcu):
        mcu.write(said("debug", "d") + said("info", "i") + said("warning", "w\x1b") + said("error", "e"))
        wait_until(lambda: len(caplog.records) == 4, "four records")
        assert [(r.name, r.levelname, r.getMessage()) for r in caplog.records] == [
            ("wirebond.log", "DEBUG", f"{link.port}: d"),
            ("wirebond.log", "INFO", f"{link.port}: i"),
            ("wirebond.log", "WARNING", f"{link.port}: w\\x1b"),
            ("wirebond.log", "ERROR", f"{link.port}: e"),
        ]
        assert [m.name for m in link.receive()] == ["log"] * 4  # the program has them as well


def test_a_flood_of_lines_is_cut_for_logging_and_counted(caplog: pytest.LogCaptureFixture) -> None:
    """A pause of the machine inside a flood ends the second for which lines are counted: then comes another flood."""
    caplog.set_level(logging.DEBUG, "wirebond.log")
    flood = MOST_A_SECOND + 50
    sent, came = 0, 0

    def lines() -> int:
        return sum(r.levelno == logging.INFO for r in caplog.records)

    def missed() -> int:
        return sum(int(str(r.args[1])) for r in caplog.records if r.levelno == logging.WARNING and r.args)

    def all_are_told() -> bool:
        return lines() + missed() == sent

    with linked(NATIVE) as (link, mcu):
        for _ in moments("lines that are cut"):
            mcu.write(said("info", "x") * flood)
            sent += flood
            wait_until(all_are_told, lambda: f"all lines; {lines()} came, {missed()} are missed")
            if missed():
                break
        for _ in moments("the lines as messages"):
            came += len([m for m in link.receive(0.1) if m.name == "log"])
            if came >= sent:
                break
    assert came == sent
    assert MOST_A_SECOND <= lines() < sent


def test_the_limit_counts_failed_attempts() -> None:
    limit = LineLimit(3)
    assert [limit.passes(10.0 + i / 10) for i in range(5)] == [True, True, True, False, False]
    assert limit.take_missed(10.5) == 0  # the second is not over
    assert limit.take_missed(11.0) == 2
    assert limit.take_missed(11.0) == 0
    assert limit.passes(11.0)


# ---- in monitor


@pytest.mark.parametrize(("level", "code"), [("debug", "2"), ("info", "36"), ("warning", "33"), ("error", "1;31")])
def test_a_level_has_its_colour_where_the_terminal_has_colours(level: str, code: str) -> None:
    line = LogLine(level, "hot\x1b[2J")
    shown, plain = io.StringIO(), io.StringIO()
    Console(file=shown, force_terminal=True, color_system="standard", highlight=False).print(log_text(line))
    assert shown.getvalue() == f"\x1b[{code}m{level}\x1b[0m: hot\\x1b[2J\n"
    Console(file=plain, highlight=False).print(log_text(line))
    assert plain.getvalue() == f"{level}: hot\\x1b[2J\n"


def test_the_table_of_monitor_shows_the_last_lines() -> None:
    with linked(NATIVE) as (link, mcu):
        mcu.write(b"".join(said("info", f"line {i}") for i in range(12)))
        messages: list[wirebond.Message] = []
        wait_until(lambda: messages.extend(link.receive(0.01)) or len(messages) == 12, "twelve lines")
        dashboard = Dashboard(link, "a link")
        dashboard.update(messages)
        screen = io.StringIO()
        Console(file=screen, width=100, highlight=False).print(dashboard.render())
    assert "info: line 4 " in screen.getvalue()
    assert "info: line 11 " in screen.getvalue()
    assert "info: line 3 " not in screen.getvalue()
