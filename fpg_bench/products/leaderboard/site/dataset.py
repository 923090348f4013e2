"""The board's results as a data set: all scores as CSV, and Croissant metadata of the site's data files."""

from __future__ import annotations

import json
import math

import yaml

from fpg_bench.common.output import csv_text
from fpg_bench.evaluation.suite import suite_names
from fpg_bench.products.croissant.description import file_object, metadata, record_set
from fpg_bench.products.leaderboard.board import Board
from fpg_bench.products.leaderboard.tracks import task_id

_COLUMNS = {
    "track": ("sc:Text", "track of the leaderboard"),
    "entry": ("sc:Text", "address of the entry in its track"),
    "name": ("sc:Text", "name of the entry"),
    "algorithm": ("sc:Text", "algorithm of the entry, in its authors' words"),
    "training_seeds": ("sc:Integer", "number of training seeds; 0 for scripts and planners"),
    "best_rank": ("sc:Integer", "best rank; empty where the entry is not ranked"),
    "worst_rank": ("sc:Integer", "worst rank; empty where the entry is not ranked"),
    "suite": ("sc:Text", "public, unseen, shifted, responses or public-seeds"),
    "score": ("sc:Float", "mean over the suite's rivals; 0 is random play, 100 a bound"),
    "low": ("sc:Float", "lower end of the 95 % interval; empty where there is a single unit"),
    "high": ("sc:Float", "upper end of the 95 % interval; empty where there is a single unit"),
    "interval_over": ("sc:Text", "what the interval is over: training seeds or matches"),
}


_ATTACK_COLUMNS = {
    **{name: _COLUMNS[name] for name in ("track", "entry")},
    "name": ("sc:Text", "name of the attacker"),
    "authors": ("sc:Text", "authors of the response"),
    "response": ("sc:Text", "address of the response among those to the entry"),
    "return_per_step": ("sc:Float", "of the entry's training seed that keeps least"),
    "low": ("sc:Float", "lower end of its 95 % interval over matches"),
    "high": ("sc:Float", "upper end of its 95 % interval over matches"),
    "training_seed": ("sc:Integer", "that training seed; empty for scripts"),
    "seconds": ("sc:Float", "CPU seconds of the search, as its authors say"),
}


def dataset_files(board: Board, board_json: str) -> dict[str, str]:
    """Return a board's ``scores.csv``, ``unbroken.csv``, ``croissant.json``, and ``eval.yaml`` for the Hub.

    Args:
        board: the board.
        board_json: content of the site's ``board.json``, which the metadata describe, too.
    """
    tables = {"scores.csv": scores_csv(board), "unbroken.csv": unbroken_csv(board)}
    files = {**tables, "board.json": board_json}
    about = metadata(
        "fpg-bench-leaderboard",
        "Verified results of the fpg-bench leaderboard: scores of agents, scripts and planners against "
        "public, held-out and shifted rivals in a game of communication and jamming between two UAVs.",
        board.version,
        f"The fpg-bench authors. fpg-bench {board.version}, leaderboard of {board.built}.",
        ["reinforcement learning", "benchmark results"],
        [file_object(name, content.encode()) for name, content in files.items()],
        rai={
            "dataCollection": (
                "The verifier played every entry against every rival of its suites, on evaluation seeds that "
                f"training does not use (protocol {board.protocol}). Submitted numbers are never taken over."
            ),
            "dataUseCases": ["Comparison of entries of one track; meta-analysis of benchmark results."],
            "dataBiases": [
                "Rivals are fixed, and intervals do not describe their variation.",
                "What an entry says of its own training cannot be verified.",
            ],
            "personalSensitiveInformation": ["Names of authors, as they have submitted them."],
            "dataReleaseMaintenancePlan": (
                "Made anew with each entry; a new season plays all entries again."
            ),
        },
        datePublished=board.built,
        recordSet=[
            record_set("scores", "scores.csv", _COLUMNS),
            record_set("unbroken", "unbroken.csv", _ATTACK_COLUMNS),
        ],
    )
    croissant = json.dumps(about, indent=2) + "\n"
    return {**tables, "croissant.json": croissant, "eval.yaml": benchmark_yaml(board)}


def benchmark_yaml(board: Board) -> str:
    """Return what makes a data set of the Hub a benchmark: a task for each suite, those of a season included.

    The Hub's form: https://huggingface.co/docs/hub/eval-results. The data set is ``scores.csv``.
    """
    names = {*suite_names(), *(suite.name for track in board.tracks for suite in track.suites)}
    content = {
        "name": "fpg-bench",
        "description": "Anti-jamming communication of UAVs: agents that keep a radio link by hopping and "
        "spreading, and agents that jam it. The score of a suite is 0 for random play and 100 for a bound.",
        "evaluation_framework": "fpg-bench",
        "tasks": [
            {"id": task, "config": "default", "split": "train"} for task in sorted(map(task_id, names))
        ],
    }
    return yaml.safe_dump(content, sort_keys=False)


def scores_csv(board: Board) -> str:
    """Return the scores of all verified entries as CSV, a line for each suite."""
    lines: list[list[object]] = [[*_COLUMNS]]
    for track in board.tracks:
        for entry, figures in track.verified():
            about = [track.key, entry.slug, entry.name, entry.algorithm, figures.training_seeds]
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
