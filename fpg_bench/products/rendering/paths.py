"""Picture of the paths that both sides fly in some rounds: a panel per round."""

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
from fpg_bench.products.rendering.picture import GREY, INK, PALE, bezier_curve
from fpg_bench.products.rendering.recording import Recording

MOST = 40  # panels; of a longer match evenly spaced rounds are drawn
_ACROSS = 5
_MARGIN = 0.02  # around the box, for waypoints on its walls


@styled
def write_paths(recordings: Sequence[Recording], path: Path, title: str) -> None:
    """Draw a panel per round into a PNG, SVG or PDF file.

    From above: the ally's curve (dotted) and what it flew of it, the opponent's path and its waypoints.
    Below: both heights over the round. Above both: the opponent's reward per step.

    Raises:
        OSError: the file cannot be written.
    """
    shown = [recordings[i] for i in np.unique(np.linspace(0, len(recordings) - 1, MOST).round().astype(int))]
    across = min(_ACROSS, len(shown))
    down = -(-len(shown) // across)
    figure = blank_figure(PAGE, 2.25 * down + 0.7)
    axes = figure.subplots(2 * down, across, squeeze=False, height_ratios=[3, 1] * down)
    for panel in axes.flat:
        panel.set_axis_off()
    for index, recording in enumerate(shown):
        row, column = divmod(index, across)
        _draw_above(axes[2 * row, column], recording)
        _draw_heights(axes[2 * row + 1, column], recording, labelled=column == 0)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.suptitle(literal(title))
    write_figure(figure, path)


def _draw_above(axes: Axes, recording: Recording) -> None:
    s, frames = recording.scenario, recording.frames
    _frame(axes, s.box_m[0], s.box_m[1])
    axes.set_aspect("equal")
    reward = frames["opponent_reward"].sum() / frames["step"][-1]
    axes.set_title(f"round {recording.round}: {reward:+.1f}", color=INK)
    axes.plot(
        *bezier_curve(recording.control_points)[:, :2].T, color=ALLY, lw=1, ls=":", label="ally's curve"
    )
    if (waypoints := recording.waypoints) is not None:
        axes.plot(*waypoints[:, :2].T, "+-", color=OPPONENT, ms=5, lw=0.4, alpha=0.8, label="waypoints")
    axes.plot(*s.base_station_m[:2], "^", color=GREY, ms=5, label="base station")
    for side, style in SIDE_STYLES.items():
        track = frames[f"{side}_position"]
        axes.plot(*track[:, :2].T, label=f"{side}, marked at its end", markevery=[-1], **style)


def _draw_heights(axes: Axes, recording: Recording, labelled: bool) -> None:
    frames, s = recording.frames, recording.scenario
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
