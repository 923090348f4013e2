"""The results table: in the terminal, as Markdown and CSV, and as a picture with intervals."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fpg_bench.evaluation.canvas import blank_figure
from fpg_bench.evaluation.panel import Panel
from fpg_bench.evaluation.statistics import FEW_SEEDS
from fpg_bench.evaluation.summary import Summary
from fpg_bench.files import write_whole

# Heading, measure, factor, decimals.
_MEASURES = (
    ("overlap %", "overlap_ratio", 100, 1),
    ("jammed %", "jamming_success_rate", 100, 1),
    ("hops %", "hop_rate", 100, 1),
    ("spread %", "spread_ratio", 100, 1),
    ("within 30 m %", "near_ratio", 100, 1),
    ("SNR dB", "snr_db", 1, 1),
    ("Mbit/s", "capacity_mbit_s", 1, 1),
)


def headings(side: str) -> list[str]:
    """The table's columns for a panel of one side."""
    return ["player", "seeds", "score", "95 % interval", "mean", "worst entry", f"{side} return"] + [
        heading for heading, *_ in _MEASURES
    ]


def cells(summary: Summary, side: str) -> list[str]:
    """One line of the table."""
    s, score = summary, summary.score
    marked = " †" if 0 < s.training_seeds < FEW_SEEDS else ""
    worst = min(s.entries, key=lambda name: s.entries[name])
    return [
        s.player,
        str(s.training_seeds or "-"),
        number(score.value),
        f"[{number(score.low)}, {number(score.high)}]{marked}",
        number(s.mean),
        f"{number(s.entries[worst])} {worst}",
        number(s.measures[f"{side}_return"], digits=0),
    ] + [number(s.measures[name], factor, digits) for _, name, factor, digits in _MEASURES]


def number(value: float | None, factor: float = 1, digits: int = 1) -> str:
    """A number of a table; a dash where there is none."""
    return "-" if value is None else f"{round(value * factor, digits) + 0.0:.{digits}f}"  # never -0.0


def caption(panel: Panel) -> str:
    """What the table's numbers are."""
    return (
        f"Panel {panel.name} ({panel.hash[:12]}), {panel.rounds} rounds per entry and training seed. "
        f"Score: interquartile mean (IQM) over the {len(panel.entries)} entries of the normalised "
        f"return, 0 = random, 100 = {panel.reference}. "
        "Intervals: 95 %, over training seeds; for scripts over evaluation seeds; "
        "† fewer than three training seeds (one: over rounds)."
    )


def markdown(summaries: Sequence[Summary], panel: Panel) -> str:
    """The table as Markdown."""
    lines = [cells(summary, panel.side) for summary in summaries]
    return as_markdown(headings(panel.side), lines, caption(panel))


def as_markdown(names: list[str], lines: Sequence[list[str]], below: str) -> str:
    """A table of Markdown with these columns and lines, and a caption below."""
    whole = [names, ["---"] * len(names), *lines]
    return "\n".join("| " + " | ".join(line) + " |" for line in whole) + f"\n\n{below}\n"


def as_csv(summaries: Sequence[Summary], panel: Panel) -> str:
    """Unrounded: the score with its interval, every entry's score and every measure."""
    text = io.StringIO()
    lines = [_flat(summary) for summary in summaries]
    writer = csv.DictWriter(text, list(lines[0]) if lines else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return text.getvalue()


def _flat(s: Summary) -> dict[str, Any]:
    head = {"player": s.player, "training_seeds": s.training_seeds, "rounds": s.rounds}
    head |= {
        "score_iqm": s.score.value,
        "low": s.score.low,
        "high": s.score.high,
        "interval_over": s.score.over,
    }
    return head | {"score_mean": s.mean} | {f"score {n}": x for n, x in s.entries.items()} | s.measures


def picture(summaries: Sequence[Summary], panel: Panel, path: Path) -> None:
    """Draw the scores with their intervals, best on top, and each entry's score as a small mark."""
    figure = blank_figure(8, 1.2 + 0.45 * len(summaries), dpi=120)
    axes = figure.subplots()
    for line, s in enumerate(reversed(summaries)):
        colour = "#0072b2" if s.training_seeds else "#7f7f7f"
        axes.plot(list(s.entries.values()), [line] * len(s.entries), "|", color=colour, alpha=0.4, ms=9)
        around = [[s.score.value - s.score.low], [s.score.high - s.score.value]]
        axes.errorbar(
            s.score.value, line, xerr=around, fmt="o", color=colour, ms=4, lw=2, capsize=5, capthick=2
        )
    axes.set_yticks(range(len(summaries)), [s.player for s in reversed(summaries)])
    axes.set_ylim(-0.6, len(summaries) - 0.4)
    for value in (0, 100):
        axes.axvline(value, color="0.6", lw=0.8, ls=":")
    axes.set_xlabel(
        f"normalised score (0 = random, 100 = {panel.reference}); IQM with 95 % interval, | per entry"
    )
    axes.set_title(f"{panel.name}, {panel.rounds} rounds per entry", fontsize=11)
    axes.spines[["top", "right"]].set_visible(False)
    image = io.BytesIO()
    figure.savefig(image, format="png")
    write_whole(path, image.getvalue())


def write_table(summaries: Sequence[Summary], panel: Panel, folder: Path) -> None:
    """Write ``table.md``, ``table.csv`` and ``table.png`` into a folder."""
    write_whole(folder / "table.md", markdown(summaries, panel))
    write_whole(folder / "table.csv", as_csv(summaries, panel))
    picture(summaries, panel, folder / "table.png")
