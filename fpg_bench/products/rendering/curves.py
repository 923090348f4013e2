"""Learning curves of several runs: the score over training steps and over training time, with bands."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fpg_bench.common import canvas
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_json
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.evaluation.entry import distinct_names
from fpg_bench.evaluation.run_description import EVALUATIONS, MADE_BY, RunDescription
from fpg_bench.evaluation.statistics import student_t
from fpg_bench.evaluation.suite import Scale, read_suite
from fpg_bench.game.scenario import Scenario
from fpg_bench.players.agent import baselines_folder, seed_folders

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_POINTS = 200
_LOWEST = -100.0  # of the axis; early policies may score far below
_MARGIN = 0.15  # of the axis beyond the means, on either side; a band over two seeds is cut there


@dataclass(frozen=True)
class Curve:
    """Score over training: ``x`` (p,), the mean over training seeds and its band at each x, (p,)."""

    x: np.ndarray
    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray


def curves(rows: Iterable[Row], over: str, band: str = "interval") -> dict[str, Curve]:
    """Return the curve of each algorithm, up to the last step that all of its training seeds have reached.

    Args:
        rows: evaluations with ``algorithm``, ``training_seed``, ``steps``, ``seconds`` and ``score``.
        over: unit of x: ``steps``, or ``seconds`` at the speed of the fastest seed, because other work slowed
            down the others.
        band: ``interval``, the pointwise 95 % interval of the mean over training seeds by Student's t; or
            ``range``, from the lowest to the highest seed.

    Raises:
        UserError: training seeds without a step in common.
    """
    points: dict[str, dict[int, list[tuple[float, float]]]] = {}
    seconds_per_step: dict[str, float] = {}
    for row in rows:
        name, steps = row["algorithm"], row["steps"]
        if steps > 0:  # a logarithmic axis has no zero
            points.setdefault(name, {}).setdefault(row["training_seed"], []).append((steps, row["score"]))
            seconds_per_step[name] = min(seconds_per_step.get(name, np.inf), row["seconds"] / steps)
    for name, seeds in points.items():
        if max(min(each)[0] for each in seeds.values()) > min(max(each)[0] for each in seeds.values()):
            raise UserError(f"curves: the training seeds of {name} have no steps in common; draw them apart")
    units = dict.fromkeys(points, 1.0) if over == "steps" else seconds_per_step
    return {
        name: _mean_curve([np.array(sorted(each)).T * [[units[name]], [1]] for each in seeds.values()], band)
        for name, seeds in points.items()
    }


def _mean_curve(seeds: Sequence[np.ndarray], band: str) -> Curve:
    """Interpolate the seeds' ``(2, n)`` points on one grid."""
    start, end = max(x[0] for x, _ in seeds), min(x[-1] for x, _ in seeds)
    grid = np.geomspace(start, end, _POINTS)
    scores = np.array([np.interp(grid, x, y) for x, y in seeds])
    mean = scores.mean(axis=0)
    if band == "range":
        return Curve(grid, mean, scores.min(axis=0), scores.max(axis=0))
    half = np.zeros(_POINTS)
    if len(seeds) > 1:
        half = student_t(len(seeds)) * scores.std(axis=0, ddof=1) / np.sqrt(len(seeds))
    return Curve(grid, mean, mean - half, mean + half)


def read_runs(runs: Sequence[str | Path]) -> list[Row]:
    """Return the evaluations of runs, as :func:`curves` takes them.

    Args:
        runs: folders of a run, or of the runs of several training seeds, ``seed_0``, ``seed_1``, ... Runs
            that differ by their training seed alone become a curve, as agents become an entry: by the name
            of the algorithm, or of their folders where algorithms are the same.

    Raises:
        UserError: a folder without evaluations, or runs that were evaluated on several suites.
    """
    folders = {folder: run for run in map(Path, runs) for folder in seed_folders(run) or [run]}
    abouts = _descriptions(folders)
    suites = {about.suite: folder for folder, about in abouts.items()}
    if len(suites) > 1:
        (one, first), (other, second), *_ = suites.items()
        raise UserError(f"curves: {first} was evaluated on {one}, {second} on {other}; draw them apart")
    groups = _groups(abouts, folders)
    algorithms = [abouts[group[0]].algorithm for group in groups]
    names = distinct_names(algorithms, [list(map(str, group)) for group in groups])
    rows = []
    for name, group in zip(names, groups, strict=True):
        for folder in group:
            own, seed = _evaluations(folder), abouts[folder].training_seed
            has_sides = len({row["side"] for row in own}) > 1
            rows += [
                row | {"algorithm": f"{name}, {row['side']}" if has_sides else name, "training_seed": seed}
                for row in own
            ]
    return rows


def _descriptions(folders: Iterable[Path]) -> dict[Path, RunDescription]:
    """Return the descriptions of runs, by their folders."""
    folders = list(folders)
    for folder in folders:
        if not (folder / EVALUATIONS).exists():
            raise UserError(
                f"curves: {folder} holds no {EVALUATIONS}; name the folder of a run, or of its seeds"
            )
    return {folder: RunDescription.read(folder) for folder in folders}


def _groups(abouts: Mapping[Path, RunDescription], named: Mapping[Path, Path]) -> list[list[Path]]:
    """Return the folders of runs that differ by their training seed alone.

    Runs of other programs say too little of themselves, and those of equal seeds must differ in something:
    they share a curve only within a folder that was ``named``.
    """
    by_made: dict[str, list[Path]] = {}
    for folder, about in abouts.items():
        content = about.to_dict()
        made = json.dumps([content.get(key) for key in MADE_BY], sort_keys=True)
        by_made.setdefault(made, []).append(folder)
    groups = []
    for group in by_made.values():
        seeds = {abouts[folder].training_seed for folder in group}
        if abouts[group[0]].game is not None and len(seeds) == len(group):
            groups.append(group)
        else:
            apart = dict.fromkeys(named[folder] for folder in group)
            groups += [[folder for folder in group if named[folder] == run] for run in apart]
    return groups


def _evaluations(run: Path) -> list[Row]:
    """Return the evaluations of a single run."""
    needs = {"side": str, "score": float | int, "steps": int, "seconds": float | int}
    rows = RowFile(run / EVALUATIONS, needs).read()
    if not any(row["steps"] > 0 for row in rows):
        raise UserError(f"curves: {run} was not evaluated during its training; see --n-evals of train")
    return rows


def levels_of(runs: Iterable[str | Path]) -> dict[str, float]:
    """Return the levels of the runs' suite, see :func:`score_levels`, as far as they hold for all runs."""
    folders = [folder for run in map(Path, runs) for folder in seed_folders(run) or [run]]
    abouts = {about.scenario: about for about in _descriptions(folders).values()}
    levels = []
    for about in abouts.values():
        played = None if about.scenario is None else about.played
        levels.append(score_levels((about.suite or "").split(", "), played))
    return {name: score for name, score in levels[0].items() if all(name in each for each in levels)}


def score_levels(suites: Iterable[str], scenario: Scenario | None = None) -> dict[str, float]:
    """Return the scores of random play and of the best script with shipped records, by name.

    Args:
        suites: names or files of suites; one that cannot be read has no levels.
        scenario: what was played on them; where it changes their game, they have no levels. None: their own.
    """
    levels: dict[str, float] = {}
    for name in suites:
        try:
            suite = read_suite(name)
        except UserError:
            continue
        if scenario is not None and not suite.is_of(scenario):
            continue
        if suite.scale != Scale():
            levels["random"] = 0.0
        best = read_json(baselines_folder() / "scores" / "summary.json", "scores")["best_scripts"]
        levels |= best.get(suite.hash[:16], {})
    return levels


def limit_scores(axes: Axes, means: Iterable[np.ndarray], levels: Mapping[str, float]) -> None:
    """Draw level lines, and let the axis of scores end near the means and levels, wherever bands reach."""
    for name, score in levels.items():
        axes.axhline(score, color=canvas.GREY, lw=0.8, zorder=0)
        axes.annotate(name, (0.01, score), xycoords=("axes fraction", "data"), va="bottom", color=canvas.GREY)
    scores = np.concatenate([*means, [*levels.values()]])
    scores = scores[np.isfinite(scores)]
    low, high = np.maximum((scores.min(), scores.max()), _LOWEST) if scores.size else (0.0, 1.0)
    margin = _MARGIN * (high - low) or 1.0
    axes.set_ylim(max(low - margin, _LOWEST), high + margin)


@canvas.styled
def draw_curves(rows: Sequence[Row], *, levels: Mapping[str, float], band: str = "interval") -> Figure:
    """Draw scores against steps and against training time.

    Args:
        rows, band: see :func:`curves`.
        levels: scores that are drawn as level lines, by name.
    """
    from matplotlib.ticker import EngFormatter, LogLocator

    styles = canvas.styles_of(dict.fromkeys(row["algorithm"] for row in rows))
    figure = canvas.blank_figure(canvas.PAGE, 2.6)
    both = figure.subplots(1, 2, sharey=True)
    kinds = (("steps", "steps", 1, EngFormatter(sep="")), ("seconds", "training time (minutes)", 60, "{x:g}"))
    for axes, (over, label, unit, form) in zip(both, kinds, strict=True):
        drawn = curves(rows, over, band)
        for name, curve in drawn.items():
            style = styles[name]
            axes.plot(curve.x / unit, curve.mean, label=canvas.literal(name), markevery=_POINTS // 5, **style)
            axes.fill_between(curve.x / unit, curve.low, curve.high, color=style["color"], alpha=0.2, lw=0)
        limit_scores(axes, [curve.mean for curve in drawn.values()], levels)
        axes.set(xscale="log", xlabel=label)
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(form)
        axes.xaxis.set_minor_formatter("")
    if any((curve.low < curve.high).any() for curve in drawn.values()):
        shown = "95 % interval of the mean" if band == "interval" else "lowest to highest seed"
        both[0].fill_between([], [], color=canvas.GREY, alpha=0.2, lw=0, label=shown)
    both[0].set_ylabel("score")
    figure.legend(*both[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def draw_training(folder: Path) -> Figure | None:
    """Draw a run, or the mean of those in ``seed_0``, ``seed_1``, ...; None if never evaluated."""
    rows = [row for run in seed_folders(folder) or [folder] for row in RowFile(run / EVALUATIONS).read()]
    if not any(row["steps"] > 0 for row in rows):
        return None
    return draw_curves(read_runs([folder]), levels=levels_of([folder]))
