"""Pictures of a match: one figure with a panel per round, and an HTML replay."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from fpg_bench.common.canvas import (
    ALLY,
    OPPONENT,
    PAGE,
    SIDE_STYLES,
    blank_figure,
    literal,
    styled,
    write_figure,
)
from fpg_bench.products.planning.match import Round
from fpg_bench.products.rendering.picture import GREY, INK, PALE, bezier_curve
from fpg_bench.products.rendering.replay import write_replay

MOST = 40  # panels; of a longer match evenly spaced rounds are drawn
_ACROSS = 5
_MARGIN = 0.02  # around the box, for waypoints on its walls


@styled
def draw_match(rounds: Sequence[Round], path: Path, title: str) -> None:
    """Draw a panel per round into a PNG, SVG or PDF file.

    From above: the ally's curve (dotted) and what it flew of it, the opponent's path and its waypoints.
    Below: both heights over the round. Above both: the opponent's reward per step.

    Raises:
        OSError: the file cannot be written.
    """
    shown = [rounds[i] for i in np.unique(np.linspace(0, len(rounds) - 1, MOST).round().astype(int))]
    across = min(_ACROSS, len(shown))
    down = -(-len(shown) // across)
    figure = blank_figure(PAGE, 2.25 * down + 0.7)
    axes = figure.subplots(2 * down, across, squeeze=False, height_ratios=[3, 1] * down)
    for panel in axes.flat:
        panel.set_axis_off()
    for index, played in enumerate(shown):
        row, column = divmod(index, across)
        _draw_above(axes[2 * row, column], played)
        _draw_heights(axes[2 * row + 1, column], played, labelled=column == 0)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.suptitle(literal(title))
    write_figure(figure, path)


def _draw_above(axes: Axes, played: Round) -> None:
    recording, s = played.recording, played.recording.scenario
    _frame(axes, s.box_m[0], s.box_m[1])
    axes.set_aspect("equal")
    axes.set_title(_heading(played), color=INK)
    axes.plot(
        *bezier_curve(recording.control_points)[:, :2].T, color=ALLY, lw=1, ls=":", label="ally's curve"
    )
    waypoints = played.recording.waypoints
    if waypoints is not None:
        axes.plot(*waypoints[:, :2].T, "+-", color=OPPONENT, ms=5, lw=0.4, alpha=0.8, label="waypoints")
    axes.plot(*s.base_station_m[:2], "^", color=GREY, ms=5, label="base station")
    for side, style in SIDE_STYLES.items():
        track = recording.frames[f"{side}_position"]
        axes.plot(*track[:, :2].T, label=f"{side}, marked at its end", markevery=[-1], **style)


def _draw_heights(axes: Axes, played: Round, labelled: bool) -> None:
    frames, s = played.recording.frames, played.recording.scenario
    _frame(axes, s.steps_per_round, s.box_m[2])
    for side, style in SIDE_STYLES.items():
        axes.plot(frames["step"], frames[f"{side}_position"][:, 2], **style | {"marker": ""})
    if labelled:
        axes.set_ylabel(f"height,\n{s.box_m[2]:g} m", color=GREY)
        axes.set_xlabel(f"{s.steps_per_round} s", color=GREY)


def _frame(axes: Axes, width: float, height: float) -> None:
    """Draw bare axes of this size."""
    axes.set_axis_on()
    axes.set_xlim(-_MARGIN * width, (1 + _MARGIN) * width)
    axes.set_ylim(-_MARGIN * height, (1 + _MARGIN) * height)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color(PALE)


def _heading(played: Round) -> str:
    row = played.row
    status = "" if row["status"] == "ok" else f"\n{row['status']}, {row['source']}"
    return f"round {row['round']}: {played.reward_per_step:+.1f}{status}"


def write_match_replay(rounds: Sequence[Round], path: Path, title: str, ally: str, opponent: str) -> None:
    """Write the replay of a match as one HTML file.

    Args:
        rounds: at least one.
        path: the file; it is replaced.
        title: the page's heading.
        ally, opponent: names of the players.
    """
    talks = [
        {
            "status": played.row["status"],
            "talk": [{"who": who, "text": text} for each in played.talk for who, text in each.messages()],
        }
        for played in rounds
    ]
    write_replay([played.recording for played in rounds], path, title, ally, opponent, talks)
