"""The paper's figures, as SVG for pages and PDF for papers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from fpg_bench.common.canvas import (
    COLUMN,
    GREY,
    PAGE,
    SIDE_COLOURS,
    SIDE_STYLES,
    blank_figure,
    styled,
    write_figure,
)
from fpg_bench.evaluation.statistics import student_half
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import preset as scenario_of
from fpg_bench.products.papers.yang_2026.conditions import (
    BASE,
    FIXED_PATHS,
    LLM,
    NO_KNOWLEDGE,
    NO_PLANNER,
    PLANNERS,
)
from fpg_bench.products.papers.yang_2026.runs import FIFTH, STAGES, WINDOWS, Runs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INK = "black"  # measures of both sides, in neither side's colour
_HATCHES = {"ally": "", "opponent": "//////"}
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
            written[name] = [folder / f"{name}-{preset}{suffix}" for suffix in (".svg", ".pdf")]
            for path in written[name]:
                write_figure(figure, path)
    return written


def rewards(
    conditions: Sequence[str], columns: int, base: str = _TITLES[BASE]
) -> Callable[[Runs, str], Figure | None]:
    """Return a function that draws both sides' rewards over training, with a panel per condition.

    A last panel has the conditions' differences from the base, if that is there.
    """

    def paint(results: Runs, preset: str) -> Figure | None:
        present = [condition for condition in conditions if condition in results.runs]
        if not present or present == [BASE] != list(conditions):
            return None
        others = [condition for condition in present if condition != BASE]
        n_panels = len(present) + (others != present)
        across = min(columns, n_panels)
        lines = -(-n_panels // across)
        figure = blank_figure(PAGE, 0.8 + 1.65 * lines)
        panels = figure.subplots(lines, across, sharex=True, sharey=True, squeeze=False)
        for axes, condition in zip(panels.flat, present, strict=False):
            for side in SIDE_STYLES:
                _draw_reward(axes, results, condition, side)
            title = base if condition == BASE else _TITLES.get(condition, condition)
            axes.set_title(f"{title}\nn = {len(results.seeds(condition))}")
            axes.set_xticks((0, 0.5, 1))
        for axes in panels.flat[len(present) :]:
            axes.remove()
        if others != present:
            last = figure.add_subplot(panels.flat[len(present)].get_subplotspec())
            _draw_differences(last, results, others, base)
        for axes in panels[:, 0]:
            axes.set_ylabel("reward per step")
        for axes in panels.flat[max(0, len(present) - across) : len(present)]:  # the lowest of each column
            axes.set_xlabel("share of training")
            axes.tick_params(labelbottom=True)
        first = panels[0][0]
        first.plot([], [], color=GREY, lw=0.5, label="not averaged")
        first.fill_between([], [], color=GREY, alpha=0.2, lw=0, label="± 2 σ, rounds and runs")
        figure.legend(*first.get_legend_handles_labels(), loc="outside lower center", ncols=4)
        return figure

    return styled(paint)


def _draw_differences(axes: Axes, results: Runs, conditions: Sequence[str], base: str) -> None:
    """Draw what each side earns more after training than under the base, with a 95 % interval over seeds."""
    for line, condition in enumerate(conditions):
        seeds = results.seeds(condition, BASE)
        for shift, (side, style) in zip((-0.15, 0.15), SIDE_STYLES.items(), strict=True):
            one, other = (results.final(name, f"{side}_reward", seeds) for name in (condition, BASE))
            half, mark = student_half(one - other), {"color": style["color"], "fmt": style["marker"]}
            axes.errorbar(np.mean(one - other), line + shift, xerr=half, **mark)
    axes.axvline(0, color=GREY, lw=0.8)
    axes.set_yticks(range(len(conditions)), [_TITLES.get(name, name) for name in conditions])
    axes.set(title=f"minus {base}", xlabel="reward per step", ylim=(len(conditions) - 0.5, -0.5))


def _draw_reward(axes: Axes, results: Runs, condition: str, side: str) -> None:
    """Draw the moving average of the mean over seeds, the mean itself, and 2 sigma over rounds and seeds."""
    each, within = (results.series(condition, f"{side}_{kind}") for kind in ("reward", "sd"))
    time, colour = (np.arange(WINDOWS) + 0.5) / WINDOWS, SIDE_COLOURS[side]
    mean = np.nanmean(each, axis=0)
    sigma = np.sqrt(np.nanmean(within**2, axis=0) + np.nanvar(each, axis=0))
    smooth, spread = _smoothed(mean), _smoothed(sigma)
    axes.plot(time, mean, color=colour, lw=0.5)
    axes.plot(time, smooth, label=f"{side}, moving average", markevery=WINDOWS // 4, **SIDE_STYLES[side])
    axes.fill_between(time, smooth - 2 * spread, smooth + 2 * spread, color=colour, alpha=0.15, lw=0)


def _smoothed(values: np.ndarray) -> np.ndarray:
    """Return the centred moving average over a fifth of training; over less at the ends."""
    kernel = np.convolve(np.ones(FIFTH), (0.5, 0.5))
    return np.convolve(values, kernel, "same") / np.convolve(np.ones(len(values)), kernel, "same")


@styled
def frequencies(results: Runs, preset: str) -> Figure | None:
    """Draw Fig. 4: centre frequencies of both sides early, midway and late in training, all seeds pooled."""
    seeds = results.seeds(BASE)
    if not seeds:
        return None
    scenario = scenario_of(preset)
    points = np.linspace(scenario.band_low_mhz, scenario.band_high_mhz, scenario.frequency_points)
    figure = blank_figure(PAGE, 2.6)
    panels = figure.subplots(1, len(STAGES), sharey=True)
    counts = [np.sum([results.histogram(BASE, stage, seed) for seed in seeds], axis=0) for stage in STAGES]
    shares = [each / each.sum(axis=1, keepdims=True) for each in counts]
    top = np.max(shares)
    for axes, stage, share in zip(panels, STAGES, shares, strict=True):
        for side, name in enumerate(SIDE_COLOURS):
            _draw_shares(axes, name, points, share[side], 2.8 * (side - 0.5), top * (1.06 + 0.08 * side))
        overlap = results.overlap(BASE, stage, seeds)
        axes.set_title(f"{stage}: overlap {overlap.mean():.1%}")
        axes.set_xlabel("centre frequency (MHz)")
        axes.set_ylim(0, 1.25 * top)
    panels[0].set_ylabel("share of steps")
    panels[0].errorbar([], [], xerr=[], fmt="o", color=GREY, label="mean ± standard deviation")
    panels[0].plot([], [], color=GREY, ls=":", label="quartiles")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _draw_shares(
    axes: Axes, side: str, points: np.ndarray, share: np.ndarray, shift: float, height: float
) -> None:
    """Draw bars of a side, its quartiles (lines), and its mean and standard deviation at a height."""
    colour, marker = SIDE_COLOURS[side], SIDE_STYLES[side]["marker"]
    axes.bar(points + shift, share, 2.8, fc=colour, ec="white", lw=0, hatch=_HATCHES[side], label=side)
    below = np.cumsum(share)
    for quarter in (0.25, 0.75):
        at = points[min(int(np.searchsorted(below, quarter)), len(points) - 1)] + shift
        axes.axvline(at, color=colour, lw=0.9, ls=":", ymax=0.8)
    mean = float(share @ points)
    sd = float(np.sqrt(share @ (points - mean) ** 2))
    axes.errorbar(mean, height, xerr=sd, color=colour, fmt=marker)


@styled
def overlap_and_success(results: Runs, preset: str) -> Figure | None:
    """Draw Fig. 5: overlap ratio and jamming success rate over training, with their standard deviation."""
    if BASE not in results.runs:
        return None
    figure = blank_figure(COLUMN, 3)
    panels = figure.subplots(2, 1, sharex=True)
    time = (np.arange(WINDOWS) + 0.5) / WINDOWS
    middles = time.reshape(-1, FIFTH).mean(axis=1)
    for axes, name in zip(panels, ("overlap_ratio", "jamming_success_rate"), strict=True):
        each = 100 * results.series(BASE, name)
        axes.plot(time, np.nanmean(each, axis=0), color=_INK, lw=0.5, label="mean of runs")
        fifths = np.nanmean(each.reshape(len(each), -1, FIFTH), axis=2)
        mean, sd = fifths.mean(axis=0), fifths.std(axis=0, ddof=min(1, len(fifths) - 1))
        axes.errorbar(middles, mean, sd, color=_INK, fmt="o-", label="fifth of training ± sd of runs")
        axes.set_ylabel(f"{name.replace('_', ' ')} (%)".replace(" rate", "\nrate"))
        axes.set_ylim(bottom=0)
    axes.set_xlabel("share of training")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2, handlelength=2)
    return figure


@styled
def paths(results: Runs, preset: str) -> Figure | None:
    """Draw both sides' paths in a round after training (Algorithm 1, line 18), from above."""
    if not results.runs.get(BASE):
        return None
    seed = min(results.runs[BASE])
    present = [name for name in (*FIXED_PATHS, BASE, NO_PLANNER) if seed in results.runs.get(name, {})]
    scenario = scenario_of(preset)
    figure = blank_figure(PAGE, 2.1)
    panels = figure.subplots(1, len(present), squeeze=False, sharey=True)[0]
    for axes, condition in zip(panels, present, strict=True):
        row = results.runs[condition][seed].rows[-1]
        for side, style in SIDE_STYLES.items():
            x, y, _ = np.reshape(row[f"{side}_path"], (-1, 3)).T
            axes.plot(x, y, label=f"{side}, marked at its start", markevery=[0], **style)
        axes.plot(*scenario.base_station_m[:2], "^", color="black", ms=5, label="base station")
        axes.set(xlim=(0, scenario.box_m[0]), ylim=(0, scenario.box_m[1]), aspect="equal", xlabel="x (m)")
        axes.set_title(_TITLES.get(condition, condition))
    panels[0].set_ylabel("y (m)")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


FIGURES: Mapping[str, Callable[[Runs, str], Figure | None]] = MappingProxyType(
    {
        "fig3": rewards((BASE, *FIXED_PATHS, *PLANNERS, LLM), 4),
        "fig4": frequencies,
        "fig5": overlap_and_success,
        "fig6": rewards((*JAMMING_TYPES, BASE), 3, "all four types"),
        "fig7": rewards((BASE, NO_PLANNER, NO_KNOWLEDGE, LLM), 4),
        "paths": paths,
    }
)
