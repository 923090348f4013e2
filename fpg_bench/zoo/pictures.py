"""The zoo's pictures: learning curves, performance profiles and probabilities of improvement of a view."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.evaluation.statistics import performance_profile, probability_of_improvement
from fpg_bench.files import write_whole
from fpg_bench.pictures.canvas import blank_figure
from fpg_bench.rows import Row
from fpg_bench.zoo.curves import Curve, curves

PICTURES = ("curves", "profiles", "improvement")
# Okabe and Ito's colours, which everybody can tell apart.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
_DASHES = ("-", "--", "-.", ":", (0, (8, 2)), (0, (3, 1, 1, 1, 1, 1)))  # and without colours
_GREY = "#7f7f7f"
_LOWEST = -100.0  # what is shown of learning curves; early policies may score far below


Styles = Mapping[str, Mapping[str, Any]]


def styles(algorithms: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Each algorithm's colour and dashes, the same in all pictures of a view; scripts have none."""
    looks = zip(_COLOURS, _DASHES, strict=True)
    return {name: {"color": colour, "ls": ls} for name, (colour, ls) in zip(algorithms, looks, strict=False)}


def draw_curves(rows: Sequence[Row], yardsticks: Mapping[str, float], styled: Styles, path: Path) -> None:
    """Draw the scores against steps and against wall time; scripts are level lines.

    Args:
        rows: those of a view's curve file.
        yardsticks: the scores of the scripts to be drawn.
        styled: each algorithm's, by :func:`styles`.
        path: the SVG file.
    """
    from matplotlib.ticker import EngFormatter, LogLocator

    figure = blank_figure(9.5, 3.6)
    both = figure.subplots(1, 2, sharey=True)
    kinds = (("steps", "steps", 1, EngFormatter(sep="")), ("seconds", "training time (minutes)", 60, "{x:g}"))
    for axes, (over, label, unit, form) in zip(both, kinds, strict=True):
        for name, curve in curves(rows, over).items():
            _draw_curve(axes, curve, unit, styled.get(name, {"color": _GREY}), name)
        for name, score in yardsticks.items():
            axes.axhline(score, color=_GREY, lw=0.9)
            axes.annotate(
                name, (0.01, score), xycoords=("axes fraction", "data"), va="bottom", color=_GREY, fontsize=8
            )
        axes.set(xscale="log", xlabel=label)
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(form)
        axes.xaxis.set_minor_formatter("")
    both[0].set_ylabel("score")
    if rows:
        both[1].legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1, 1), handlelength=4)
    low, _ = both[0].get_ylim()
    both[0].set_ylim(bottom=max(low, _LOWEST))
    _save(figure, path)


def draw_profiles(scores: Mapping[str, np.ndarray], styled: Styles, path: Path) -> None:
    """Draw the share of runs above each return a step; a thin line is one training seed.

    Args:
        scores: per algorithm or script ``(training seeds, counterparts)``.
        styled: each algorithm's, by :func:`styles`.
        path: the SVG file.
    """
    figure = blank_figure(6, 3.8)
    axes = figure.subplots()
    values = np.concatenate([found.ravel() for found in scores.values()])
    thresholds = np.linspace(values.min() - 1, values.max() + 1, 400)
    for name, found in scores.items():
        style = styled.get(name, {"color": _GREY})
        if len(found) > 1:
            for seed in performance_profile(found[:, None], thresholds):
                axes.step(thresholds, seed, color=style["color"], lw=0.5, alpha=0.45)
        axes.step(thresholds, performance_profile(found, thresholds), lw=1.8, label=name, **style)
    axes.set(xlabel="return a step τ", ylabel="share of runs above τ", ylim=(-0.02, 1.02))
    axes.legend(frameon=False, fontsize=8, handlelength=4)
    _save(figure, path)


def draw_improvement(scores: Mapping[str, np.ndarray], styled: Styles, path: Path) -> None:
    """Draw for each pair, the better one first, how likely it scores more; arguments as above."""
    pairs = [pair for pair in combinations(scores, 2) if set(pair) & set(styled)]
    figure = blank_figure(6, 1.1 + 0.3 * len(pairs))
    axes = figure.subplots()
    labels = []
    for line, (one, other) in enumerate(reversed(pairs)):
        found = probability_of_improvement(scores[one], scores[other])
        if found.value < 0.5:
            one, other = other, one
            found = probability_of_improvement(scores[one], scores[other])
        labels.append(f"{one} > {other}")
        around = [[found.value - found.low], [found.high - found.value]]
        axes.errorbar(found.value, line, xerr=around, fmt="o", color=_COLOURS[0], ms=4, lw=1.6, capsize=4)
    axes.axvline(0.5, color="0.6", lw=0.8, ls=":")
    axes.set_yticks(range(len(labels)), labels, fontsize=8)
    axes.set(xlim=(-0.02, 1.02), ylim=(-0.6, max(len(labels), 1) - 0.4))
    axes.set_xlabel("probability of improvement, with its 95 % interval")
    _save(figure, path)


def _draw_curve(axes: Any, curve: Curve, unit: float, style: Mapping[str, Any], name: str) -> None:
    axes.plot(curve.x / unit, curve.mean, lw=1.8, label=name, **style)
    axes.fill_between(curve.x / unit, curve.low, curve.high, color=style["color"], alpha=0.2, lw=0)


def _save(figure: Any, path: Path) -> None:
    from matplotlib import rc_context

    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
    image = io.BytesIO()
    with rc_context({"svg.hashsalt": f"{path.parent.name}-{path.stem}", "svg.fonttype": "none"}):
        figure.savefig(image, format="svg", metadata={"Date": None})
    write_whole(path, image.getvalue())
