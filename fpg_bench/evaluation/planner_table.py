"""The table of planners: in the terminal, as Markdown and CSV, and as a picture of how they learn."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fpg_bench.evaluation.canvas import blank_figure
from fpg_bench.evaluation.planner_panel import PlannerPanel
from fpg_bench.evaluation.planner_summary import NEAR_BOUND, PlannerSummary
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.evaluation.table import as_markdown, number
from fpg_bench.files import write_whole

# Okabe and Ito's colours, told apart by the colour-blind too; each round of them has its marker, each tier
# its line.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c8c8c")
_MARKERS = "os^"
_LINES = {"none": ":", "history": "-", "ally": "--"}
_TIERS = "none: knows nothing; history: own past positions and rewards; ally: sees the ally's path"


def planner_headings(panel: PlannerPanel) -> list[str]:
    """The table's columns."""
    last = f"last {panel.last_rounds}"
    scores = [f"score {last}", "95 % interval", "score all", "95 % interval", f"return {last}", "return all"]
    near = f"within {panel.scenario.distance_reward_m:g} m %"
    rest = ["rounds to 90 %", near, "jammed %", "valid %", "tokens", "s per plan"]
    return ["planner", "tier", *scores, *rest]


def planner_cells(s: PlannerSummary) -> list[str]:
    """One line of the table."""
    scores = [text for score in (s.last, s.all) for text in (number(score.value), _interval(score))]
    returns = [number(s.in_last.reward, digits=2), number(s.in_all.reward, digits=2)]
    shares = [number(s.in_last.near, 100), number(s.in_last.jammed, 100), number(s.valid, 100)]
    costs = [number(s.tokens, digits=0), f"{s.seconds:.2g}"]
    return [s.planner, s.tier, *scores, *returns, str(s.rounds_to_bound or "never"), *shares, *costs]


def _interval(score: Interval) -> str:
    if score.low == score.high:
        return "-"
    return f"[{number(score.low)}, {number(score.high)}]"


def planner_caption(panel: PlannerPanel) -> str:
    """What the table's numbers are."""
    return (
        f"Panel {panel.name} ({panel.hash[:12]}): {panel.matches} matches of {panel.rounds} rounds against "
        f"each of {', '.join(panel.allies)}; {panel.opponent} jams. "
        f"Score: mean over allies of the normalised return, 0 = {panel.zero}, 100 = {panel.bound}, over the "
        f"last {panel.last_rounds} rounds of a match and over all. Intervals: 95 %, over match seeds. "
        "Return: the opponent's, per step. "
        f"Rounds to 90 %: the first round whose score is {NEAR_BOUND:g} or more. "
        f"Within {panel.scenario.distance_reward_m:g} m and jammed: shares of the last rounds' steps. "
        "Valid: share of a language model's plans that were its own and no fallback; tokens: per plan. "
        f"Tiers ({_TIERS}) are not to be compared with each other without saying so."
    )


def planner_markdown(summaries: Sequence[PlannerSummary], panel: PlannerPanel) -> str:
    """The table as Markdown."""
    lines = [[cell.replace("|", "\\|") for cell in planner_cells(s)] for s in summaries]
    return as_markdown(planner_headings(panel), lines, planner_caption(panel))


def planner_csv(summaries: Sequence[PlannerSummary]) -> str:
    """Unrounded: scores with their intervals, by ally and by round, shares, returns and costs."""
    text = io.StringIO()
    lines = [_flat(summary) for summary in summaries]
    writer = csv.DictWriter(text, list(lines[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return text.getvalue()


def _flat(s: PlannerSummary) -> dict[str, Any]:
    line: dict[str, Any] = {"planner": s.planner, "tier": s.tier, "plans": s.plans}
    for window, score, shares, allies in (
        ("last", s.last, s.in_last, s.allies_last),
        ("all", s.all, s.in_all, s.allies_all),
    ):
        line |= _scored(f"score_{window}", score)
        line |= {f"return_{window}": shares.reward, f"near_{window}": shares.near}
        line |= {f"jammed_{window}": shares.jammed}
        line |= {f"score_{window} {ally}": score for ally, score in allies.items()}
    line["rounds_to_bound"] = s.rounds_to_bound
    line |= {"valid": s.valid, "tokens_per_plan": s.tokens, "seconds_per_plan": s.seconds}
    for k, score in enumerate(s.curve, 1):
        line |= _scored(f"round_{k}", score)
    return line


def _scored(name: str, score: Interval) -> dict[str, float]:
    return {name: score.value, f"{name}_low": score.low, f"{name}_high": score.high}


def planner_picture(summaries: Sequence[PlannerSummary], panel: PlannerPanel, path: Path) -> None:
    """Draw the scores by round, and beside them those of the last rounds, which name the planners."""
    height = max(4.0, 1.5 + 0.32 * len(summaries))
    figure = blank_figure(11, height, dpi=120)
    by_round, last = figure.subplots(1, 2, width_ratios=(3, 2))
    for index, s in enumerate(summaries):
        again, colour = divmod(index, len(_COLOURS))
        style = {"color": _COLOURS[colour], "marker": _MARKERS[again % len(_MARKERS)], "ms": 4}
        _draw_curve(by_round, s, style)
        _draw_score(last, s, len(summaries) - 1 - index, style)
    _describe(by_round, last, summaries, panel)
    image = io.BytesIO()
    figure.savefig(image, format="png")
    write_whole(path, image.getvalue())


def _draw_curve(axes: Any, s: PlannerSummary, style: dict[str, Any]) -> None:
    rounds = range(1, len(s.curve) + 1)
    axes.plot(rounds, [score.value for score in s.curve], _LINES[s.tier], lw=1.6, **style)
    low, high = ([getattr(score, end) for score in s.curve] for end in ("low", "high"))
    axes.fill_between(rounds, low, high, color=style["color"], alpha=0.15, lw=0)


def _draw_score(axes: Any, s: PlannerSummary, line: int, style: dict[str, Any]) -> None:
    colour = style["color"]
    axes.plot(list(s.allies_last.values()), [line] * len(s.allies_last), "|", color=colour, alpha=0.5, ms=8)
    axes.plot([s.last.low, s.last.high], [line, line], _LINES[s.tier], color=colour, lw=2)
    axes.plot(s.last.value, line, **style)


def _describe(by_round: Any, last: Any, summaries: Sequence[PlannerSummary], panel: PlannerPanel) -> None:
    from matplotlib.lines import Line2D

    by_round.set_xlabel("round of the match")
    by_round.set_ylabel(f"score (0 = {panel.zero}, 100 = {panel.bound})")
    by_round.set_xticks(range(1, panel.rounds + 1))
    by_round.set_title(f"{panel.name}, {panel.matches} matches per ally, bands: 95 %", fontsize=11)
    tiers = [Line2D([], [], color="0.3", ls=style, label=f"tier {tier}") for tier, style in _LINES.items()]
    by_round.legend(handles=tiers, fontsize=8, loc="best")
    last.set_yticks(range(len(summaries)), [s.planner for s in reversed(summaries)])
    last.set_xlabel("score with 95 % interval, | per ally")
    last.set_title(f"last {panel.last_rounds} rounds", fontsize=11)
    for axes, mark in ((by_round, by_round.axhline), (last, last.axvline)):
        for value in (0, 100):
            mark(value, color="0.7", lw=0.8, zorder=0)
        axes.spines[["top", "right"]].set_visible(False)


def write_planner_table(summaries: Sequence[PlannerSummary], panel: PlannerPanel, folder: Path) -> None:
    """Write ``table.md``, ``table.csv`` and ``table.png`` into a folder."""
    write_whole(folder / "table.md", planner_markdown(summaries, panel))
    write_whole(folder / "table.csv", planner_csv(summaries))
    planner_picture(summaries, panel, folder / "table.png")
