"""Pictures of results tables: the scores with their intervals, and a planner's score by round."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fpg_bench.common import canvas
from fpg_bench.evaluation.suite import PLANNER, Suite
from fpg_bench.evaluation.summary import Summary
from fpg_bench.evaluation.table import learning_curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_DRAWN = 100  # entries
_KINDS: canvas.Styles = {  # of players that are no planners
    "trained": {"color": canvas.ALLY, "marker": "o"},
    "not trained": {"color": canvas.GREY, "marker": "s"},
}


@canvas.styled
def draw_scores(summaries: Sequence[Summary], suite: Suite, path: Path) -> None:
    """Draw the best scores with their intervals, best on top, and a small mark for each rival.

    For planners, the score by round is drawn beside it.
    """
    planned, count = suite.side == PLANNER, len(summaries)
    summaries = summaries[:MOST_DRAWN]
    height = max(2.0, 1.1 + 0.19 * len(summaries))
    figure = canvas.blank_figure(canvas.PAGE if planned else canvas.COLUMN, height)
    styles = [_KINDS["trained" if s.trained else "not trained"] for s in summaries]
    if planned:
        styles = list(canvas.styles_of(s.entry for s in summaries).values())
        by_round, axes = figure.subplots(1, 2, width_ratios=(4, 3))
        _draw_curves(by_round, summaries, styles)
    else:
        axes = figure.subplots()
    for line, (s, style) in enumerate(zip(reversed(summaries), reversed(styles), strict=True)):
        each = [suite.scale.score(reward.value) for reward in s.by_rival.values()]
        axes.plot(each, [line] * len(each), "|", color=style["color"], alpha=0.5, ms=6)
        axes.errorbar(s.score.value, line, xerr=s.score.half, **style)
    axes.set_yticks(range(len(summaries)), [canvas.literal(s.entry) for s in reversed(summaries)])
    label = "score" if planned else textwrap.fill(suite.scale.description, 48)
    axes.set(ylim=(-0.6, len(summaries) - 0.4), xlabel=label)
    first = "" if count == len(summaries) else f", the first {len(summaries)} of {count:,}"
    title = f"{suite.name}, {suite.matches} matches per rival{first}; 95 % intervals"
    figure.suptitle(canvas.literal(textwrap.fill(title, 54)))
    marks = {"mean": {"color": canvas.GREY, "marker": "o"}} if planned else _KINDS
    for label, style in marks.items():
        axes.errorbar([], [], xerr=[], label=label, ls="", **style)
    axes.plot([], [], "|", color=canvas.GREY, ms=6, label="one rival")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    canvas.write_figure(figure, path)


def _draw_curves(axes: Axes, summaries: Sequence[Summary], styles: Iterable[canvas.Style]) -> None:
    rounds = range(1, summaries[0].suite.rounds_per_match + 1)
    for s, style in zip(summaries, styles, strict=True):
        curve = learning_curve(s)
        axes.plot(rounds, [score.value for score in curve], **style)
        low, high = ([getattr(score, end) for score in curve] for end in ("low", "high"))
        axes.fill_between(rounds, low, high, color=style["color"], alpha=0.15, lw=0)
    scale = textwrap.fill(summaries[0].suite.scale.description, 36)
    axes.set(xlabel="round of the match; marks as on the right", ylabel=scale, xticks=rounds)
