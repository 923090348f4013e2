"""A tiny board, and a closing over it."""

from __future__ import annotations

import shutil
from pathlib import Path
from unittest.mock import patch

from fpg_bench.leaderboard.close_season import close_season, make_closing

REPOSITORY = Path(__file__).parents[2]
ENTRIES = (
    "ally/ally-scripted-td3",
    "ally/expert",
    "opponent/opponent-pursuit-td3",
    "opponent/tone",
    "planner/circle",
)
TINY = {"candidates": 2, "size": 2, "rounds": 2, "scale": 0.0005}


def make_board(folder: Path) -> Path:
    """A leaderboard of a few shipped entries."""
    for name in ENTRIES:
        shutil.copytree(REPOSITORY / "leaderboard/submissions" / name, folder / "submissions" / name)
    return folder


def in_this_process(jobs, workers=1, backend=None, address=None, say=print):
    """Run jobs as workers do, one after the other; workers are tested elsewhere."""
    for job in jobs:
        if not job.done():
            say(f"{job.name}: begins")
            job.keep(job.run())
    return {}


def close_tiny(board: Path, work: Path, out: Path, name: str = "1", **words):
    """Close a season of two candidates a side; gives it and what was said."""
    said: list[str] = []
    with patch("fpg_bench.leaderboard.close_season.run_jobs", in_this_process):
        season = close_season(make_closing(name, board, work, **TINY), out, say=said.append, **words)
    return season, said
