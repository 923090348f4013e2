"""Learning curves: an agent's score on its field while it trained, against steps and against wall time."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fpg_bench.files import write_whole
from fpg_bench.rows import Row, RowFile
from fpg_bench.zoo.zoo import Zoo, ZooAgent, ZooView

EVALUATIONS = "evaluations.jsonl"  # what a run's folder calls them
CURVES = "curves.jsonl"
_POINTS = 200


@dataclass(frozen=True)
class Curve:
    """One algorithm's score over training: ``x`` (p,), the mean over seeds and its range at each x, (p,)."""

    x: np.ndarray
    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray


def keep_curve(zoo: Zoo, member: ZooAgent, run: Path) -> None:
    """Keep the scores that a run's folder has seen while it trained, in place of what was kept before."""
    file, who = curve_file(zoo, member.view), {"algorithm": member.algorithm, "training_seed": member.seed}
    kept = [row for row in file.read() if not who.items() <= row.items()]
    for row in RowFile(run / EVALUATIONS).read():
        if row["side"] == member.view.side:
            score = round(row["score"], 2)
            kept.append({**who, "steps": row["steps"], "seconds": row["seconds"], "score": score})
    write_whole(file.path, "".join(json.dumps(row) + "\n" for row in kept))


def curve_file(zoo: Zoo, view: ZooView) -> RowFile:
    """The file of a view's curves."""
    return RowFile(zoo.scores(view) / CURVES)


def curves(rows: Iterable[Row], over: str) -> dict[str, Curve]:
    """Per algorithm the curve over its training seeds, as far as all of them have come.

    Args:
        rows: those of a view's curve file.
        over: what x is: ``steps``, or ``seconds``, at the speed of the fastest seed, because the others were
            held up by what else the machine did.
    """
    found: dict[str, dict[int, list[tuple[float, float]]]] = {}
    seconds: dict[str, float] = {}  # that a step takes
    for row in rows:
        name, steps = row["algorithm"], row["steps"]
        if steps > 0:  # what was not trained at all has no place on a logarithmic axis
            found.setdefault(name, {}).setdefault(row["training_seed"], []).append((steps, row["score"]))
            seconds[name] = min(seconds.get(name, np.inf), row["seconds"] / steps)
    units = dict.fromkeys(found, 1.0) if over == "steps" else seconds
    return {
        name: _curve([np.array(sorted(points)).T * [[units[name]], [1]] for points in seeds.values()])
        for name, seeds in found.items()
    }


def _curve(seeds: list[np.ndarray]) -> Curve:
    """The seeds' ``(2, n)`` points on one grid, linear between the points."""
    start, end = max(x[0] for x, _ in seeds), min(x[-1] for x, _ in seeds)
    grid = np.geomspace(start, end, _POINTS)
    scores = np.array([np.interp(grid, x, y) for x, y in seeds])
    return Curve(grid, scores.mean(axis=0), scores.min(axis=0), scores.max(axis=0))
