"""Results tables: columns, Markdown, CSV, LaTeX, and a pandas DataFrame."""

from __future__ import annotations

import html
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fpg_bench.common.extras import require_extra
from fpg_bench.common.files import write_whole
from fpg_bench.common.output import csv_text, number, wrapped
from fpg_bench.common.products import load, offered
from fpg_bench.evaluation.statistics import (
    ENOUGH_SEEDS,
    MATCHES,
    Interval,
    difference,
    may_be_best,
    mean_interval,
    pair_error,
    rank_ranges,
)
from fpg_bench.evaluation.suite import PLANNER, Scale, Suite
from fpg_bench.evaluation.summary import Summary

if TYPE_CHECKING:
    from rich.table import Table

MOST_RANKED = 1000  # entries of a table whose pairs are compared
INTERVAL = "95 % interval"
_PAGE_WIDTH = 92  # of a LaTeX table, in characters
_LATEX = {character: f"\\{character}" for character in "&%$#_{}"} | {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "\N{MINUS SIGN}": "$-$",
    "\N{EN DASH}": "--",
}
_COSTS = "Steps and minutes: played in training, per seed. "
Line = dict[str, str | float | None]  # of a flat table; the names stand for columns


def lines_of_table(summaries: Sequence[Summary], suite: Suite, width: int | None = None) -> list[list[str]]:
    """Return the headings, and a line of cells per summary.

    Args:
        summaries: in the order of the lines.
        suite: their suite.
        width: the greatest width in characters, as far as columns can be left out; None: all columns.
    """
    known = columns(suite, standings(summaries))
    cells = [[column.heading, *map(column.cell, summaries)] for column in known]
    kept = list(range(len(known)))
    if width is not None:  # first the columns that are empty for all
        kept = [k for k in kept if not summaries or set(cells[k][1:]) != {"-"}]
    while width is not None and _width(cells[k] for k in kept) > width:
        spared = max(kept, key=lambda k: (known[k].spare, k))
        if not known[spared].spare:
            break
        kept.remove(spared)
    return [list(line) for line in zip(*(cells[k] for k in kept), strict=True)]


def _width(columns: Iterable[list[str]]) -> int:
    """Return the width of the columns with wrapped headings: a blank before the first, and two after each."""
    widths = (max(map(len, [*wrapped(heading, cells).split("\n"), *cells])) for heading, *cells in columns)
    return 1 + sum(2 + width for width in widths)


def caption(summaries: Sequence[Summary], suite: Suite) -> str:
    """Return the caption that explains the table's numbers."""
    met = f"{len(suite.rivals)} rivals, {suite.matches} matches each"
    if suite.rounds_per_match > 1:
        met += f" of {suite.rounds_per_match} rounds"
    whose = "ally's" if suite.side == "ally" else "opponent's"
    elsewhere = [summary.entry for summary in summaries if summary.training.elsewhere]
    note = f" Trained in another scenario than the suite's: {', '.join(elsewhere)}." if elsewhere else ""
    code = ", ".join(f"{summary.entry} ({summary.played})" for summary in summaries if summary.played)
    what = f"Rows against code ({', '.join(suite.code)})" if suite.code else "Code"
    note += f" {what}, as it was when it was played: {code}." if code else ""
    return (
        f"Suite {suite.name} ({suite.hash[:12]}): {met}. Return: the {whose}, per step, mean over "
        f"rivals; {suite.scale.description}; worst: the lowest return per step, against one of them. "
        "Rank 1-3: no better than first, no worse than third; these policies, over all pairs of the table. "
        f"{'' if suite.side == PLANNER else _COSTS}"
        "Intervals: 95 %, over matches; those from the first of the ranked are on the same matches and hold "
        f"for all pairs at once. No rank: fewer than {ENOUGH_SEEDS} training seeds, or an oracle.{note}"
    )


def markdown(summaries: Sequence[Summary], suite: Suite) -> str:
    """Return the table as Markdown, with all columns."""
    lines = [[cell.replace("|", "\\|") for cell in line] for line in lines_of_table(summaries, suite)]
    return f"{markdown_table(lines)}\n\n{caption(summaries, suite)}\n"


def markdown_table(lines: Sequence[Sequence[str]]) -> str:
    """Return lines of cells as a Markdown table; the first one has the headings."""
    head, *rest = lines
    rows = [head, ["---"] * len(head), *rest]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def latex(summaries: Sequence[Summary], suite: Suite) -> str:
    """Return the table as LaTeX for the package booktabs: the columns that a page's width takes.

    It is a ``tabular`` alone, to be put into a ``table`` by ``\\input``; its caption stands in a comment.
    """
    head, *lines = lines_of_table(summaries, suite, _PAGE_WIDTH)
    cells = [head, *([name, *map(_dashed, numbers)] for name, *numbers in lines)]
    # At the beginning of a line * and [ would belong to the end of the one before
    rows = [
        "{}" * line[0].startswith(("*", "[")) + " & ".join(map(_escaped, line)) + r" \\" for line in cells
    ]
    body = [r"\toprule", rows[0], r"\midrule", *rows[1:], r"\bottomrule"]
    columns = "l" + "r" * (len(head) - 1)
    comment = textwrap.wrap(caption(summaries, suite), 100, initial_indent="% ", subsequent_indent="% ")
    return "\n".join([*comment, rf"\begin{{tabular}}{{{columns}}}", *body, r"\end{tabular}"]) + "\n"


def _escaped(text: str) -> str:
    """Return text whose characters LaTeX prints as they are."""
    return "".join(_LATEX.get(character, character) for character in text)


def _dashed(number: str) -> str:
    """Return a number with a minus sign, or a range of ranks with an en dash, instead of a hyphen."""
    return re.sub(r"(?<![\w.-])-(?=\d)", "\N{MINUS SIGN}", re.sub(r"(?<=\d)-(?=\d)", "\N{EN DASH}", number))


def as_csv(summaries: Sequence[Summary]) -> str:
    """Return CSV, unrounded: the score with its interval, the reward per step by rival, all measures."""
    lines = flat_lines(summaries)
    names = list(lines[0]) if lines else []
    return csv_text([names, *([line[name] for name in names] for line in lines)])


def flat_lines(summaries: Sequence[Summary]) -> list[Line]:
    """Return each summary as one flat mapping, with its rank and its difference from the first."""
    lines = []
    for summary, standing in zip(summaries, standings(summaries).values(), strict=True):
        (low, high), is_best = standing.rank or (None, None), standing.may_be_best
        ranks: Line = {"rank_low": low, "rank_high": high, "may_be_best": is_best}
        lines.append(flat(summary) | ranks | _ends("from_first", standing.behind))
    return lines


@dataclass(frozen=True)
class Standing:
    """The place of an entry in its table.

    Attributes:
        rank: best and worst rank; None for an oracle, for fewer than five training seeds of an algorithm, and
            in a table of a single match or of more than ``MOST_RANKED`` entries.
        may_be_best: see :func:`fpg_bench.evaluation.statistics.may_be_best`; None as for the rank.
        behind: its score minus that of the first of the ranked, with an interval that agrees with the ranks.
    """

    rank: tuple[int, int] | None
    may_be_best: bool | None
    behind: Interval


def standings(summaries: Sequence[Summary]) -> dict[str, Standing]:
    """Return the standing of each entry of a table by its name.

    Args:
        summaries: best first, oracles last.
    """
    ranked = [summary for summary in summaries if summary.has_rank]
    samples, error = [summary.samples for summary in ranked], pair_error(len(ranked))
    placed: dict[str, tuple[tuple[int, int], bool]] = {}
    if len(ranked) <= MOST_RANKED and all(sample.shape[1] > 1 for sample in samples):
        floor = -math.inf if not ranked or ranked[0].suite.scale == Scale() else 0.0
        places = zip(rank_ranges(samples), may_be_best(samples, floor), strict=True)
        placed = dict(zip((summary.entry for summary in ranked), places, strict=True))
    found = {}
    for summary in summaries:
        rank, best = placed.get(summary.entry, (None, None))
        first = (ranked or summaries)[0]
        behind = difference(summary.samples, first.samples, error)
        found[summary.entry] = Standing(rank, best, behind)
    return found


def flat(s: Summary) -> Line:
    """Return a summary as one flat mapping of names to numbers."""
    line: Line = {"entry": s.entry, "training_seeds": s.training_seeds, "rounds": s.pooled.rounds}
    line |= _ends("score", s.score) | _ends("return_per_step", s.reward)
    line |= {"worst_rival": s.worst, "lost": s.pooled.lost}
    line |= {f"return_per_step {name}": reward.value for name, reward in s.by_rival.items()}
    if s.suite.side != PLANNER:
        line |= {"training_steps": s.training.steps, "training_seconds": s.training.seconds}
    else:
        for k, score in enumerate(learning_curve(s), 1):
            line |= _ends(f"round_{k}", score)
        plans = s.pooled.plans
        names = ("valid", "valid_but_useless", "tokens", "seconds")
        line |= {} if plans is None else {name: getattr(plans, name) for name in names}
    return line | s.measures


def _ends(name: str, interval: Interval) -> Line:
    return {name: interval.value, f"{name}_low": interval.low, f"{name}_high": interval.high}


def write_table(summaries: Sequence[Summary], suite: Suite, folder: Path) -> None:
    """Write ``table.md``, ``table.csv``, ``table.tex`` and, with pictures, ``table.png`` into a folder."""
    write_whole(folder / "table.md", markdown(summaries, suite))
    write_whole(folder / "table.csv", as_csv(summaries))
    write_whole(folder / "table.tex", latex(summaries, suite))
    if "table" in offered("rendering"):
        load("rendering", "table")(summaries, suite, folder / "table.png")


def text_table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> Table:
    """Return a table for a terminal, whose headings are wrapped."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    headings = map(wrapped, head, zip(*lines, strict=True) if lines else [()] * len(head))
    drawn = Table(*headings, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for line in lines:
        drawn.add_row(*map(Text, line))
    return drawn


class Results(list[Summary]):
    """The summaries of all entries that met a suite, best first."""

    def table(self) -> str:
        """Return a Markdown table with all columns and a caption."""
        return markdown(self, self[0].suite) if self else ""

    def __repr__(self) -> str:
        from rich.console import Console

        if not self:
            return "Results([])"
        suite, console = self[0].suite, Console(no_color=True, force_terminal=False)
        head, *lines = lines_of_table(self, suite, console.width)
        with console.capture() as drawn:
            console.print(text_table(head, lines))
        below = textwrap.wrap(caption(self, suite), console.width)
        return "\n".join([*map(str.rstrip, drawn.get().splitlines()), *below])

    def _repr_html_(self) -> str:
        """Return the table with all columns for a notebook."""
        if not self:
            return "Results([])"
        kinds, lines = ["th", *("td" for _ in self)], lines_of_table(self, self[0].suite)
        rows = [
            "".join(f"<{kind}>{html.escape(cell)}</{kind}>" for cell in line)
            for kind, line in zip(kinds, lines, strict=True)
        ]
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        return f"<table>{body}</table><p>{html.escape(caption(self, self[0].suite))}</p>"

    def dataframe(self) -> Any:
        """Return a ``pandas.DataFrame`` with one row per entry, unrounded, the columns of ``table.csv``.

        Raises:
            UserError: pandas is not installed.
        """
        require_extra("dataframe", "pandas")
        import pandas

        return pandas.DataFrame(flat_lines(self))


_JAMMING = (("overlap ratio %", "overlap_ratio"), ("jamming success rate %", "jamming_success_rate"))
_MEASURES = (
    ("delivered %", "delivered_share", 100),
    ("hops %", "hop_rate", 100),
    ("spread %", "spread_ratio", 100),
    ("within 30 m %", "near_ratio", 100),
    ("SNR dB", "snr_db", 1),
    ("Mbit/s", "capacity_mbit_s", 1),
    ("longest outage s", "outage_longest_s", 1),
)


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        heading: its heading.
        cell: returns the text of a summary's cell.
        spare: 0 for a column that is always shown; a narrow table leaves out the largest number first.
    """

    heading: str
    cell: Callable[[Summary], str]
    spare: int = 0


def columns(suite: Suite, placed: Mapping[str, Standing]) -> list[Column]:
    """Return all columns of a suite's table, given the standings of its entries."""
    measures = [
        Column(heading, _measure(name, factor), spare)
        for spare, (heading, name, factor) in enumerate(_MEASURES, _FIRST_MEASURE)
    ]
    own = load("rendering", "planners")(suite) if suite.side == PLANNER else _OF_PLAYERS
    after = 1 + next(k for k, column in enumerate(own) if column.heading == INTERVAL)
    jamming = [Column(heading, _measure(name, 100)) for heading, name in _JAMMING]
    return [*own[:after], *_of_standings(placed), *jamming, *own[after:], *measures]


def _of_standings(placed: Mapping[str, Standing]) -> list[Column]:
    def rank(s: Summary) -> str:
        ends = placed[s.entry].rank
        return "-" if ends is None else "-".join(map(str, dict.fromkeys(ends)))

    def behind(s: Summary) -> str:
        interval = placed[s.entry].behind
        return "-" if interval.half == 0 == interval.value else f"{number(interval.value)} {bounds(interval)}"

    return [Column("rank", rank, spare=2), Column("from the first", behind, spare=5)]


def bounds(interval: Interval) -> str:
    """Return an interval's ends as text; a dash if there are none."""
    low, high = (number(end) for end in (interval.low, interval.high))
    return "-" if low == "-" else f"[{low}, {high}]"


def over_rounds(summary: Summary, window: slice) -> Interval:
    """Return a planner's score over some rounds of each match, with its interval over matches."""
    returns = np.array([record.returns for record in summary.records])
    by_match = returns.reshape(len(summary.records), -1, summary.suite.rounds_per_match)
    rewards = by_match[:, :, window].mean(axis=(0, 2)) / summary.suite.scenario.steps_per_round
    return mean_interval(summary.suite.scale.score(rewards), MATCHES)


def learning_curve(summary: Summary) -> list[Interval]:
    """Return a planner's score round by round of a match."""
    return [over_rounds(summary, slice(k, k + 1)) for k in range(summary.suite.rounds_per_match)]


def short(count: int | None) -> str:
    """Return a count with three digits, as 2.5M or 400k; a dash if there is none."""
    if count is None:
        return "-"
    factor, unit = next((pair for pair in ((10**6, "M"), (10**3, "k")) if count >= pair[0]), (1, ""))
    return f"{count / factor:.3g}{unit}"


def _measure(name: str, factor: float) -> Callable[[Summary], str]:
    return lambda s: number(s.measures[name], factor)


_FIRST_MEASURE = 4  # what they can be spared for: before the columns of returns
_OF_PLAYERS = (
    Column("player", lambda s: s.label),
    Column("seeds", lambda s: str(s.training_seeds or "-"), spare=2),
    Column("steps", lambda s: short(s.training.steps), spare=3),
    Column("minutes", lambda s: number(s.training.seconds, 1 / 60), spare=4),
    Column("score", lambda s: number(s.score.value)),
    Column(INTERVAL, lambda s: bounds(s.score)),
    Column("return", lambda s: number(s.reward.value, digits=2), spare=2),
    Column("worst", lambda s: number(s.by_rival[s.worst].value, digits=2), spare=1),
    Column("against", lambda s: s.worst, spare=4),
)
