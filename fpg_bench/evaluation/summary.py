"""From rows to what a table says: per contestant the normalised score with its interval, and the measures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import Panel
from fpg_bench.evaluation.runner import TALLIES
from fpg_bench.evaluation.statistics import Interval, iqm_interval
from fpg_bench.game.measures import measures, pool
from fpg_bench.game.state import TALLY
from fpg_bench.rows import Row


@dataclass(frozen=True)
class Summary:
    """One contestant under a panel.

    Attributes:
        player: its name.
        training_seeds: how many, 0 for a script.
        score: the IQM over entries of the normalised score (0 random, 100 reference), with its interval.
        mean: the mean over entries of the normalised score.
        entries: the normalised score per entry.
        measures: the pooled measures of :func:`fpg_bench.game.measures.measures`, returns per round.
        rounds: how many rounds were played.
    """

    player: str
    training_seeds: int
    score: Interval
    mean: float
    entries: dict[str, float]
    measures: dict[str, float | None]
    rounds: int


def summarise(rows: list[Row], panel: Panel) -> list[Summary]:
    """One summary per contestant whose rows are complete, best first.

    Raises:
        UserError: the panel has no reference scores.
    """
    check_references(panel)
    groups: dict[str, dict[Any, list[Row]]] = {}
    for row in rows:
        groups.setdefault(row["player"], {}).setdefault(row["training_seed"], []).append(row)
    found = [_summary(name, by_seed, panel) for name, by_seed in groups.items()]
    return sorted((s for s in found if s is not None), key=lambda s: -s.score.value)


def check_references(panel: Panel) -> None:
    """Raise UserError where a panel's scores can't be normalised: not measured, or for fewer rounds."""
    if panel.references is None:
        raise UserError(f"panel {panel.name}: has no reference scores; run fpg-bench measure-panel first")
    measured = min(len(reference.random) for reference in panel.references.values())
    if panel.rounds > measured:
        raise UserError(
            f"rounds: at most {measured} on panel {panel.name} (its reference scores), got {panel.rounds}"
        )


def _summary(name: str, by_seed: dict[Any, list[Row]], panel: Panel) -> Summary | None:
    complete = {
        seed: scores for seed, rows in by_seed.items() if (scores := _scores(rows, panel)) is not None
    }
    if not complete:
        return None
    trained = None not in complete
    # Sums of floats follow their order, which in the file is that in which entries ended.
    order = {entry.name: index for index, entry in enumerate(panel.entries)}
    seeds = sorted(complete, key=str)
    scores = np.stack([complete[seed] for seed in seeds])
    per_entry = scores.mean(axis=(0, 2))
    rows = [row for seed in seeds for row in sorted(by_seed[seed], key=lambda row: order[row["entry"]])]
    return Summary(
        player=name,
        training_seeds=len(complete) if trained else 0,
        score=iqm_interval(scores, trained),
        mean=float(per_entry.mean()),
        entries={entry.name: float(x) for entry, x in zip(panel.entries, per_entry, strict=True)},
        measures=pooled_measures(rows),
        rounds=len(rows),
    )


def _scores(rows: list[Row], panel: Panel) -> np.ndarray | None:
    """``(entries, matches)`` normalised scores, None where rounds are missing."""
    assert panel.references is not None
    found = []
    for entry in panel.entries:
        played = sorted(
            (r["seed"], r["round"], r[f"{panel.side}_return"]) for r in rows if r["entry"] == entry.name
        )
        if len(played) < panel.rounds:
            return None
        scores = panel.references[entry.name].scores(np.array([row[2] for row in played]))
        found.append(scores.reshape(len({row[0] for row in played}), -1).mean(axis=1))
    return np.array(found)


def pooled_measures(rows: list[Row]) -> dict[str, float | None]:
    """The measures over all rows; sums pooled, both returns as means a round."""
    tally = pool(np.array([tuple(row[name] for name in TALLIES) for row in rows], TALLY))
    histogram = np.array([[row["ally_points"], row["jam_points"]] for row in rows]).sum(axis=0)
    found = measures(tally, histogram)
    return found | {f"{side}_return": tally[f"{side}_return"] / len(rows) for side in ("ally", "opponent")}
