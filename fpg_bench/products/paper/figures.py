"""The paper's figures, as PNG and SVG."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from fpg_bench.common.canvas import SIDE_COLOURS, blank_figure, image_of
from fpg_bench.common.files import write_whole
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import preset as scenario_of
from fpg_bench.products.paper.conditions import BASE, FIXED_PATHS, LLM, NO_KNOWLEDGE, NO_PLANNER, PLANNERS
from fpg_bench.products.paper.runs import FIFTH, STAGES, WINDOWS, Runs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_OVERLAP, _SUCCESS = "#009e73", "#cc79a7"  # measures of both sides, in neither side's colour
_TITLES = {
    BASE: "planned path",
    NO_PLANNER: "learned path",
    NO_KNOWLEDGE: "no knowledge base",
}


def draw(results: Runs, preset: str, folder: Path) -> dict[str, list[Path]]:
    """Draw each figure whose runs exist, and return its files by its name.

    Args:
        results: the runs.
        preset: name of the scenario.
        folder: folder of the files.
    """
    written = {}
    for name, painter in FIGURES.items():
        figure = painter(results, preset)
        if figure is not None:
            written[name] = save_figure(figure, folder / f"{name}-{preset}")
    return written


def rewards(
    conditions: Sequence[str], columns: int, width: float, height: float, base: str = _TITLES[BASE]
) -> Callable[[Runs, str], Any]:
    """Return a function that draws both sides' rewards over training, with a panel per condition."""

    def paint(results: Runs, preset: str) -> Any:
        present = [condition for condition in conditions if condition in results.runs]
        if not present or present == [BASE] != list(conditions):
            return None
        lines = -(-len(present) // columns)
        figure = blank_figure(width, 0.4 + height * lines)
        panels = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False)
        for axes, condition in zip(panels.flat, present, strict=False):
            for side, colour in SIDE_COLOURS.items():
                _draw_reward(axes, results, condition, side, colour)
            title = base if condition == BASE else _TITLES.get(condition, condition)
            axes.set_title(f"{title} (n = {len(results.seeds(condition))})", fontsize=10)
            axes.set_xticks((0, 0.5, 1))
        for axes in panels.flat[len(present) :]:
            axes.set_visible(False)
        panels[0][0].legend(frameon=False, fontsize=8)
        for axes in panels[:, 0]:
            axes.set_ylabel("reward per step")
        for axes in panels.flat[max(0, len(present) - columns) : len(present)]:  # the lowest of each column
            axes.set_xlabel("share of training")
            axes.tick_params(labelbottom=True)
        return figure

    return paint


def _draw_reward(axes: Axes, results: Runs, condition: str, side: str, colour: str) -> None:
    """Draw the mean over seeds and its moving average (dashed), with 2 sigma over rounds and seeds."""
    each, within = (results.series(condition, f"{side}_{kind}") for kind in ("reward", "sd"))
    time = (np.arange(WINDOWS) + 0.5) / WINDOWS
    mean = np.nanmean(each, axis=0)
    sigma = np.sqrt(np.nanmean(within**2, axis=0) + np.nanvar(each, axis=0))
    smooth, spread = _smoothed(mean), _smoothed(sigma)
    axes.plot(time, mean, color=colour, lw=1.1, alpha=0.6, label=side)
    axes.plot(time, smooth, "--", color=colour, lw=1.8)
    axes.fill_between(time, smooth - 2 * spread, smooth + 2 * spread, color=colour, alpha=0.15, lw=0)


def _smoothed(values: np.ndarray) -> np.ndarray:
    """Return the centred moving average over a fifth of training; over less at the ends."""
    kernel = np.convolve(np.ones(FIFTH), (0.5, 0.5))
    return np.convolve(values, kernel, "same") / np.convolve(np.ones(len(values)), kernel, "same")


def frequencies(results: Runs, preset: str) -> Any:
    """Draw Fig. 4: centre frequencies of both sides early, midway and late in training, all seeds pooled."""
    seeds = results.seeds(BASE)
    if not seeds:
        return None
    scenario = scenario_of(preset)
    points = np.linspace(scenario.band_low_mhz, scenario.band_high_mhz, scenario.frequency_points)
    figure = blank_figure(11, 3.6)
    panels = figure.subplots(1, len(STAGES), sharey=True)
    counts = [np.sum([results.histogram(BASE, stage, seed) for seed in seeds], axis=0) for stage in STAGES]
    shares = [each / each.sum(axis=1, keepdims=True) for each in counts]
    top = np.max(shares)
    for axes, stage, share in zip(panels, STAGES, shares, strict=True):
        for side, (name, colour) in enumerate(SIDE_COLOURS.items()):
            shift = 2.8 * (side - 0.5)
            axes.bar(points + shift, share[side], 2.8, color=colour, alpha=0.75, label=name)
            _mark(axes, points, share[side], shift, top * (1.06 + 0.08 * side), colour)
        overlap = results.overlap(BASE, stage, seeds)
        axes.set_title(f"{stage}: spectrum overlap {overlap.mean():.1%} (mean of runs)", fontsize=10)
        axes.set_xlabel("centre frequency (MHz)")
        axes.set_ylim(0, 1.35 * top)
    panels[0].set_ylabel("share of steps")
    panels[0].legend(frameon=False, fontsize=8, loc="upper right", ncols=2)
    return figure


def _mark(
    axes: Axes, points: np.ndarray, share: np.ndarray, shift: float, height: float, colour: str
) -> None:
    """Mark the quartiles (lines), mean and standard deviation (at a height), and highest bar (frame)."""
    below = np.cumsum(share)
    for quarter in (0.25, 0.75):
        at = points[min(int(np.searchsorted(below, quarter)), len(points) - 1)] + shift
        axes.axvline(at, color=colour, lw=0.9, ls=":", ymax=0.8)
    mean = float(share @ points)
    sd = float(np.sqrt(share @ (points - mean) ** 2))
    axes.errorbar(mean, height, xerr=sd, color=colour, fmt="o", ms=3, capsize=3, lw=1)
    highest = int(share.argmax())
    axes.bar(points[highest] + shift, share[highest], 2.8, fill=False, ec=colour, lw=1.6)


def overlap_and_success(results: Runs, preset: str) -> Any:
    """Draw Fig. 5: overlap ratio and jamming success rate over training, with their standard deviation."""
    if BASE not in results.runs:
        return None
    figure = blank_figure(7, 3.6)
    left = figure.subplots()
    right = left.twinx()
    time = (np.arange(WINDOWS) + 0.5) / WINDOWS
    middles = time.reshape(-1, FIFTH).mean(axis=1)
    for axes, name, label, colour, shift in (
        (left, "overlap_ratio", "overlap ratio (%)", _OVERLAP, -0.004),
        (right, "jamming_success_rate", "jamming success rate (%)", _SUCCESS, 0.004),
    ):
        each = 100 * results.series(BASE, name)
        axes.plot(time, np.nanmean(each, axis=0), color=colour, lw=0.8, alpha=0.5)
        fifths = np.nanmean(each.reshape(len(each), -1, FIFTH), axis=2)
        mean, sd = fifths.mean(axis=0), fifths.std(axis=0, ddof=min(1, len(fifths) - 1))
        axes.errorbar(middles + shift, mean, sd, color=colour, fmt="o-", ms=4, capsize=3, lw=1.6)
        axes.set_ylabel(label, color=colour)
        axes.set_ylim(bottom=0)
    left.set_xlabel("share of training")
    return figure


def paths(results: Runs, preset: str) -> Any:
    """Draw both sides' paths in a round after training (Algorithm 1, line 18), from above."""
    if not results.runs.get(BASE):
        return None
    seed = min(results.runs[BASE])
    present = [name for name in (*FIXED_PATHS, BASE, NO_PLANNER) if seed in results.runs.get(name, {})]
    scenario = scenario_of(preset)
    figure = blank_figure(2.6 * len(present) + 0.6, 3.2)
    for axes, condition in zip(figure.subplots(1, len(present), squeeze=False)[0], present, strict=True):
        row = results.runs[condition][seed].rows[-1]
        for side, colour in SIDE_COLOURS.items():
            x, y, _ = np.reshape(row[f"{side}_path"], (-1, 3)).T
            axes.plot(x, y, color=colour, lw=1.3, label=side)
            axes.plot(x[0], y[0], "o", color=colour, ms=4)
        axes.plot(*scenario.base_station_m[:2], "^", color="black", ms=5, label="base station")
        axes.set(xlim=(0, scenario.box_m[0]), ylim=(0, scenario.box_m[1]), aspect="equal", xlabel="x (m)")
        axes.set_title(_TITLES.get(condition, condition), fontsize=9)
    figure.axes[0].set_ylabel("y (m)")
    figure.axes[0].legend(frameon=False, fontsize=7)
    return figure


FIGURES: Mapping[str, Callable[[Runs, str], Any]] = MappingProxyType(
    {
        "fig3": rewards((BASE, *FIXED_PATHS, *PLANNERS, LLM), 4, 11, 2.5),
        "fig4": frequencies,
        "fig5": overlap_and_success,
        "fig6": rewards((*JAMMING_TYPES, BASE), 3, 10, 2.6, "all four types"),
        "fig7": rewards((BASE, NO_PLANNER, NO_KNOWLEDGE, LLM), 3, 10, 2.9),
        "paths": paths,
    }
)


def save_figure(figure: Figure, stem: Path) -> list[Path]:
    """Write ``<stem>.png`` and ``<stem>.svg``, reproducibly to the byte, and return both paths."""
    paths = []
    for axes in figure.axes:
        axes.spines["top"].set_visible(False)
    for form, dpi in (("png", "figure"), ("svg", 150)):
        path = stem.with_suffix(f".{form}")
        write_whole(path, image_of(figure, form, stem.name, dpi))
        paths.append(path)
        figure.set_layout_engine("none")  # keeps the first format's layout
    return paths
