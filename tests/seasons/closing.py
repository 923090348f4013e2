"""A tiny board, and a closing over it."""

from __future__ import annotations

import shutil
from pathlib import Path

from fpg_bench.seasons.close import close, closing_of

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


def close_tiny(board: Path, work: Path, out: Path, name: str = "1", **words):
    """Close a season of two candidates a side."""
    said: list[str] = []
    season = close(closing_of(name, board, work, **TINY), out, workers=1, say=said.append, **words)
    return season, said
