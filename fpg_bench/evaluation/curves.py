"""Learning curves of several runs: the score over training steps and over training time, with bands."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fpg_bench.common.canvas import SIDE_COLOURS, blank_figure
from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.evaluation.run_description import RunDescription
from fpg_bench.evaluation.statistics import student_t
from fpg_bench.players.agent import seed_folders

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EVALUATIONS = "evaluations.jsonl"  # scores during training, in a run's folder
CURVE = "curve.png"  # their picture
GREY = "#7f7f7f"
_POINTS = 200
# Colours of Okabe and Ito, for all kinds of colour vision.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
_DASHES = ("-", "--", "-.", ":", (0, (8, 2)), (0, (3, 1, 1, 1, 1, 1)))  # for print without colours
_LOWEST = -100.0  # of the axis; early policies may score far below

Styles = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Curve:
    """Score over training: ``x`` (p,), the mean over training seeds and its band at each x, (p,)."""

    x: np.ndarray
    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray


def styles_of(names: Iterable[str]) -> Styles:
    """Return the colour and dashes of each curve."""
    count = len(_COLOURS)  # after so many curves, colours come back with other dashes
    return {
        name: {"color": _COLOURS[k % count], "ls": _DASHES[(k + k // count) % count]}
        for k, name in enumerate(names)
    }


def curves(rows: Iterable[Row], over: str, band: str = "interval") -> dict[str, Curve]:
    """Return the curve of each algorithm, up to the last step that all of its training seeds have reached.

    Args:
        rows: evaluations with ``algorithm``, ``training_seed``, ``steps``, ``seconds`` and ``score``.
        over: unit of x: ``steps``, or ``seconds`` at the speed of the fastest seed, because other work slowed
            down the others.
        band: ``interval``, the pointwise 95 % interval of the mean over training seeds by Student's t; or
            ``range``, from the lowest to the highest seed.
    """
    points: dict[str, dict[int, list[tuple[float, float]]]] = {}
    seconds_per_step: dict[str, float] = {}
    for row in rows:
        name, steps = row["algorithm"], row["steps"]
        if steps > 0:  # a logarithmic axis has no zero
            points.setdefault(name, {}).setdefault(row["training_seed"], []).append((steps, row["score"]))
            seconds_per_step[name] = min(seconds_per_step.get(name, np.inf), row["seconds"] / steps)
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
        runs: folders of a run, or of the runs of several training seeds, ``seed_0``, ``seed_1``, ... Each
            becomes a curve by the name of its algorithm, or of its folder where algorithms are the same.

    Raises:
        UserError: a folder without evaluations, or runs that were evaluated on several suites.
    """
    by_run = {str(run).rstrip("/"): _evaluations(Path(run)) for run in runs}
    suites = {row["suite"]: run for run, rows in by_run.items() for row in rows}
    if len(suites) > 1:
        (one, first), (other, second), *_ = suites.items()
        raise UserError(f"curves: {first} was evaluated on {one}, {second} on {other}; draw them apart")
    algorithms = {run: sorted({row["algorithm"] for row in rows}) for run, rows in by_run.items()}
    counts = Counter(name for names in algorithms.values() for name in names)
    labelled = []
    for run, rows in by_run.items():
        is_clear = len(algorithms[run]) == 1 and counts[algorithms[run][0]] == 1
        sides = {row["side"] for row in rows}
        for row in rows:
            name = algorithms[run][0] if is_clear else run
            labelled.append(row | {"algorithm": name if len(sides) == 1 else f"{name}, {row['side']}"})
    return labelled


def _evaluations(run: Path) -> list[Row]:
    rows = []
    for folder in seed_folders(run) or [run]:
        if not (folder / EVALUATIONS).exists():
            raise UserError(
                f"curves: {folder} holds no {EVALUATIONS}; name the folder of a run, or of its seeds"
            )
        about = RunDescription.read(folder)
        head = {key: getattr(about, key) for key in ("algorithm", "training_seed", "suite")}
        needs = {"side": str, "score": float | int, "steps": int, "seconds": float | int}
        own = RowFile(folder / EVALUATIONS, needs).read()
        if not any(row["steps"] > 0 for row in own):
            raise UserError(f"curves: {folder} was not evaluated during its training; see --n-evals of train")
        rows += [head | row for row in own]
    return rows


def draw_curves(
    rows: Sequence[Row],
    *,
    levels: Mapping[str, float] | None = None,
    styles: Styles | None = None,
    band: str = "interval",
) -> Figure:
    """Draw scores against steps and against training time.

    Args:
        rows, band: see :func:`curves`.
        levels: scores that are drawn as level lines, by name.
        styles: colour and dashes of each curve; None for those of :func:`styles_of`.
    """
    from matplotlib.ticker import EngFormatter, LogLocator

    if styles is None:
        styles = styles_of(dict.fromkeys(row["algorithm"] for row in rows))
    figure = blank_figure(9.5, 3.6)
    both = figure.subplots(1, 2, sharey=True)
    kinds = (("steps", "steps", 1, EngFormatter(sep="")), ("seconds", "training time (minutes)", 60, "{x:g}"))
    for axes, (over, label, unit, form) in zip(both, kinds, strict=True):
        drawn = curves(rows, over, band)
        for name, curve in drawn.items():
            style = styles.get(name, {"color": GREY})
            axes.plot(curve.x / unit, curve.mean, lw=1.8, label=name, **style)
            axes.fill_between(curve.x / unit, curve.low, curve.high, color=style["color"], alpha=0.2, lw=0)
        for name, score in (levels or {}).items():
            axes.axhline(score, color=GREY, lw=0.9)
            axes.annotate(
                name, (0.01, score), xycoords=("axes fraction", "data"), va="bottom", color=GREY, fontsize=8
            )
        axes.set(xscale="log", xlabel=label)
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(form)
        axes.xaxis.set_minor_formatter("")
        axes.spines[["top", "right"]].set_visible(False)
    both[0].set_ylabel("score")
    both[1].legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1, 1), handlelength=4)
    low, _ = both[0].get_ylim()
    both[0].set_ylim(bottom=max(low, _LOWEST))
    return figure


def draw_run(run: Path) -> Figure | None:
    """Draw the score of each side over the steps of one run; return None if it was never evaluated."""
    rows = RowFile(run / EVALUATIONS, {"side": str, "score": float | int, "steps": int}).read()
    if not rows:
        return None
    about = RunDescription.read(run)
    figure = blank_figure(6, 3.6)
    axes = figure.subplots()
    for side in dict.fromkeys(row["side"] for row in rows):
        points = [(row["steps"], row["score"]) for row in rows if row["side"] == side]
        axes.plot(*zip(*points, strict=True), "o-", ms=3, color=SIDE_COLOURS[side], label=side)
    title = about.algorithm if about.game is None else f"{about.algorithm}, {about.game.id}"
    axes.set(xlabel="steps", ylabel="score (few rounds, tuning seeds)", title=title)
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    return figure
