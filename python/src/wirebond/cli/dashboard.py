"""The live view of a link in a terminal: messages with their rates, line use, statistics. Draws only; reads no port."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from wirebond.analysis.diagnosis import Diagnosis
from wirebond.cli.message_rows import MessageRows, Row, Widths
from wirebond.cli.shown import behind_schedule, log_text, sequence_parts, units_of, unlisted_text, values_text
from wirebond.codec import Message
from wirebond.link import Link, LinkStats
from wirebond.protocol.model import End
from wirebond.protocol.planning import plan_for

_LINES = 8  # of the log, the last ones
_WINDOW = 2.0  # seconds over which rates are taken
_STATE_STYLE = {"up": "bold green", "stale": "bold yellow", "down": "bold red"}


@dataclass
class _Seen:
    count: int = 0
    times: deque[float] = field(default_factory=deque)
    last: Message | None = None
    widths: Widths = field(default_factory=Widths)
    units: Mapping[str, str] = field(default_factory=dict)

    def rate(self, now: float) -> float:
        """Return the messages per second over the window, from the intervals between them."""
        while self.times and now - self.times[0] > _WINDOW:
            self.times.popleft()
        if len(self.times) < 2:
            return float(len(self.times)) / _WINDOW
        return (len(self.times) - 1) / (self.times[-1] - self.times[0]) if self.times[-1] > self.times[0] else 0.0


class Dashboard:
    """Feed it with messages, print what ``render`` returns."""

    def __init__(self, link: Link, title: str) -> None:
        self._link = link
        self._title = title
        self._seen: dict[str, _Seen] = {}
        self._lines: deque[Text] = deque(maxlen=_LINES)
        plan = plan_for(link.codec.model, End.MCU if link.role == End.HOST else End.HOST)
        self._peer = "" if plan.peer is None else plan.header[plan.peer].name

    def update(self, messages: list[Message]) -> None:
        for message in messages:
            title = self._title_of(message)
            if title not in self._seen:
                self._seen[title] = _Seen(units=self._units_of(message))
            seen = self._seen[title]
            seen.count += 1
            seen.times.append(message.t)
            seen.last = message
            line = self._link.codec.log_line(message)
            if line is not None:
                self._lines.append(Text.assemble(f"{message.t:.3f} ", log_text(line)))

    def render(self, note: str = "", wrong: Sequence[Diagnosis] = ()) -> RenderableType:
        """Draw the dashboard. ``wrong``: the present diagnosis of the line."""
        now = time.monotonic()
        stats = self._link.stats
        parts: list[RenderableType] = [self._messages(now), self._statistics(now, stats)]
        if self._lines:
            parts.insert(1, Text("\n").join([Text("\nlog", style="bold"), *self._lines]))
        if wrong:
            parts.append(_diagnoses(wrong))
        if note:
            parts.append(Text.from_markup(note))
        state = self._link.state
        title = f"{escape(self._title)}  [{_STATE_STYLE[state]}]{state}[/]"
        return Panel(Group(*parts), title=title, subtitle="Ctrl-C ends", border_style="dim")

    def _messages(self, now: float) -> MessageRows:
        return MessageRows([self._row(name, self._seen[name], now) for name in sorted(self._seen)])

    def _row(self, name: str, seen: _Seen, now: float) -> Row:
        message, rate = seen.last, f"{seen.rate(now):.1f} Hz"
        if message is None:
            return Row(name, str(seen.count), rate, {}, seen.widths)
        said = self._said(message)
        fields = message.fields if said is None else {}
        header = values_text({n: v for n, v in message.header.items() if n != self._peer}, between=", ")
        shown = Text.assemble(f"[{header}] " if header else "", said or "")
        wrong = "; ".join(message.violations)
        return Row(name, str(seen.count), rate, fields, seen.widths, seen.units, shown, wrong)

    def _units_of(self, message: Message) -> dict[str, str]:
        described = next((m for m in self._link.codec.model.messages if m.name == message.name), None)
        return {} if described is None else units_of(described.fields)

    def _title_of(self, message: Message) -> str:
        """Return the title of a row: the message's name, with its sender if frames have one."""
        peer = message.header.get(self._peer) if self._peer else None
        return message.name if peer is None else f"{message.name} [{self._peer} {peer}]"

    def _said(self, message: Message) -> Text | None:
        """Return the text that replaces the values of a log line or of the MCU's counters."""
        line, counters = self._link.codec.log_line(message), self._link.codec.counters(message)
        if counters is not None:
            return Text(str(counters))
        return None if line is None else log_text(line)

    def _statistics(self, now: float, stats: LinkStats) -> Table:
        rates = self._link.rates(_WINDOW)
        table = Table.grid(padding=(0, 2))
        receive, send = stats.receive, stats.send
        discarded = ", ".join(f"{n} {cause}" for cause, n in receive.discarded_bytes.items() if n) or "none"
        table.add_row("", "")
        used = f"receive {rates.receive.line_use:.1%}  send {rates.send.line_use:.1%}"
        table.add_row("line use", f"{used}  of {rates.baud} baud, {rates.bits_per_byte:g} bits a byte")
        if behind := behind_schedule(rates):
            table.add_row("behind schedule", f"[yellow]{', '.join(behind)}[/]")
        if receive.unlisted_frames:
            table.add_row("not in the file", f"{receive.unlisted_frames} frames ({unlisted_text(receive)})")
        table.add_row(
            "received",
            f"{receive.bytes} bytes, {receive.frames} frames, {receive.unknown_frames} unknown, "
            f"{receive.foreign_frames} foreign, "
            f"{stats.late} late, {stats.held_back} held back, {stats.dropped_messages} not taken in time",
        )
        table.add_row("discarded", f"bytes: {discarded}")
        if receive.sequence is not None:
            table.add_row("numbers", ", ".join(sequence_parts(receive.sequence)) or "no frame is missing")
        table.add_row(
            "sent",
            f"{send.sent} frames of {send.offered} offered ({send.queued} queued, {send.replaced} replaced, "
            f"{send.expired} expired, {send.overruled} overruled, {send.refused_down + send.refused_full} refused)",
        )
        table.add_row("reconnects", str(stats.reconnects))
        if self._link.codec.model.link.echo:
            table.add_row("own echo", f"{stats.echoed_bytes} bytes dropped, {stats.collisions} collisions")
        line = self._link.line
        if line is not None:
            table.add_row("line", Text(str(line), overflow="fold"))
        peer = self._link.peer
        if peer.state == "different":
            table.add_row("[red]peer[/]", Text(peer.why, style="bold red", overflow="fold"))
        elif peer.since is not None:
            table.add_row("peer", f"has the same protocol, seen for {now - peer.since:.0f} s")
        elif self._link.codec.model.service("hello") is not None:
            table.add_row("peer", "has not said hello")
        struck = [name for name, is_struck in self._link.deadlines.items() if is_struck]
        if struck:
            table.add_row("[red]deadlines[/]", f"[bold red]{', '.join(struck)}[/]")
        return table


def _diagnoses(wrong: Sequence[Diagnosis]) -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_row("", "")
    for one in wrong:
        table.add_row("[bold yellow]diagnosis[/]", Text(one.sentence, style="bold yellow", overflow="fold"))
        table.add_row("", Text(f"{one.evidence}. {one.remedy}", style="yellow", overflow="fold"))
    return table
