"""The board's results as a data set: all scores and responses as CSV."""

from __future__ import annotations

import math

from fpg_bench.common.output import csv_text
from fpg_bench.products.leaderboard.board import Board

_COLUMNS = (
    *("track", "entry", "name", "algorithm", "training_seeds", "best_rank", "worst_rank"),
    *("suite", "score", "low", "high", "interval_over"),
)
_ATTACK_COLUMNS = (
    *("track", "entry", "name", "authors", "response"),
    *("return_per_step", "low", "high", "training_seed", "seconds"),
)


def dataset_files(board: Board) -> dict[str, str]:
    """Return a board's ``scores.csv`` and ``unbroken.csv``."""
    return {"scores.csv": scores_csv(board), "unbroken.csv": unbroken_csv(board)}


def scores_csv(board: Board) -> str:
    """Return the scores of all verified entries as CSV, a line for each suite."""
    lines: list[list[object]] = [[*_COLUMNS]]
    for track in board.tracks:
        for entry, figures in track.verified():
            about = [track.key, entry.slug, entry.name, entry.about.algorithm, figures.training_seeds]
            for role, score in figures.scores.items():
                ends = (score.low, score.high) if math.isfinite(score.half) else (None, None)
                numbers = [score.value, *ends, score.over]
                lines.append([*about, *(figures.rank or (None, None)), role, *numbers])
    return csv_text(lines)


def unbroken_csv(board: Board) -> str:
    """Return the responses to entries as CSV; first those to the entry that keeps most."""
    lines: list[list[object]] = [[*_ATTACK_COLUMNS]]
    for track in board.tracks:
        known = [(e.slug, f.exploited) for e, f in track.verified() if f.exploited and f.exploited.attacks]
        for slug, exploited in sorted(known, key=lambda each: -each[1].lowest.return_per_step.value):
            for attack in exploited.attacks:
                kept = attack.return_per_step
                about = [track.key, slug, attack.name, ", ".join(attack.authors), attack.rival]
                lines.append([*about, kept.value, kept.low, kept.high, attack.training_seed, attack.seconds])
    return csv_text(lines)
