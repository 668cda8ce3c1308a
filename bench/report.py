"""Tables and plots of comparisons: in the terminal, and as SVG and Markdown in docs/peers, which the README shows."""

from __future__ import annotations

from dataclasses import dataclass, field

from rich.console import Console
from rich.table import Table

from bench.figures import ROOT

try:
    import matplotlib as mpl
    from matplotlib.figure import Figure
except ImportError:
    mpl = None

FOLDER = ROOT / "docs" / "peers"
OURS = "Wirebond"


@dataclass(frozen=True)
class Comparison:
    """One number for each of several ways to do the same work; Wirebond is one of them."""

    key: str  # the files' name
    title: str
    unit: str
    rows: dict[str, float]
    notes: dict[str, str] = field(default_factory=dict)  # version and licence
    more_is_better: bool = True

    def ordered(self) -> list[tuple[str, float]]:
        return sorted(self.rows.items(), key=lambda row: row[1], reverse=self.more_is_better)

    def factor(self, value: float) -> float:
        """Return how many times worse than Wirebond it is."""
        return self.rows[OURS] / value if self.more_is_better else value / self.rows[OURS]


def write_comparison(comparison: Comparison) -> None:
    """Print the table; write it as Markdown, and its plot where matplotlib is installed."""
    table = Table(title=comparison.title, title_justify="left", title_style="bold")
    for name in ("", comparison.unit, f"{OURS} : it", "version, licence"):
        table.add_column(name, justify="right" if name not in ("", "version, licence") else "left")
    for name, value in comparison.ordered():
        table.add_row(name, number(value), f"{comparison.factor(value):.1f}", comparison.notes.get(name, ""))
    Console().print(table)
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / f"{comparison.key}.md").write_text(markdown(comparison), encoding="utf-8")
    plot(comparison)


def number(value: float) -> str:
    """Three digits that count, thousands set apart."""
    digits = max(0, len(str(int(value))) - 3)
    return f"{round(value, -digits):,.0f}".replace(",", " ")


def markdown(comparison: Comparison) -> str:
    lines = [
        f"{comparison.title}. Written by `make bench`; the rules are in [bench/README.md](../../bench/README.md).",
        "",
        f"| | {comparison.unit} | {OURS} : it | version, licence |",
        "| --- | --: | --: | --- |",
    ]
    for name, value in comparison.ordered():
        note = comparison.notes.get(name, "")
        lines.append(f"| {name} | {number(value)} | {comparison.factor(value):.1f} | {note} |")
    return "\n".join([*lines, ""])


def plot(comparison: Comparison) -> None:
    if mpl is None:
        print("no plot: matplotlib is not installed (bench/requirements.txt)")
        return
    rows = comparison.ordered()[::-1]
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "wirebond", "font.family": "sans-serif"}):
        figure = Figure(figsize=(7.5, 0.5 + 0.42 * len(rows)), layout="constrained")
        axes = figure.add_subplot()
        colours = ["#0b6e99" if name == OURS else "#b8c4cc" for name, _ in rows]
        bars = axes.barh([name for name, _ in rows], [value for _, value in rows], color=colours)
        axes.bar_label(bars, [number(value) for _, value in rows], padding=4, fontsize=9)
        axes.set_xscale("log")
        axes.margins(x=0.2)
        axes.set_title(f"{comparison.title} (log scale)", fontsize=10, loc="left")
        axes.spines[["top", "right", "bottom"]].set_visible(False)
        axes.tick_params(axis="x", which="both", bottom=False, labelbottom=False)
        figure.patch.set_facecolor("white")  # so that it can be read on a dark page
        figure.savefig(FOLDER / f"{comparison.key}.svg", metadata={"Date": None, "Creator": None})
