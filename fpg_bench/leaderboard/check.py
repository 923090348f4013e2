"""What is wrong with a submission, line by line."""

from __future__ import annotations

from pathlib import Path

from fpg_bench.leaderboard.submission import Submission


def problems(folder: str | Path) -> list[str]:
    """All that is wrong with a submission's folder, one line each; none where it may be run."""
    return examine(Path(folder))[1]


def examine(folder: Path) -> tuple[Submission | None, list[str]]:
    """The submission of a folder, None where it cannot be read, and all that is wrong with it."""
    return None, ["not written yet"]
