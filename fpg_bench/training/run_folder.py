"""Folder of a training run: its files, its lock, and the description in ``run.json``."""
# ruff: noqa: E402

from __future__ import annotations

from fpg_bench.training import require_libraries

require_libraries()

import contextlib
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from fpg_bench.common.errors import UserError, other_content
from fpg_bench.common.locks import own_folder
from fpg_bench.common.rows import RowFile
from fpg_bench.common.starting import COMMAND
from fpg_bench.evaluation.run_description import CURVE, EVALUATIONS, FILE, RunDescription
from fpg_bench.training.checkpoint import MODEL, NORMALIZE, newest_checkpoint

TRANSCRIPT = "transcript.jsonl"  # of a run with a language model


class RunFolder:
    """Folder of one run.

    Args:
        path: the folder, which need not exist yet.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.agent, self.checkpoints = path / "agent", path / "checkpoints"
        self.description, self.curve = path / FILE, path / CURVE
        self.evaluations = RowFile(path / EVALUATIONS, {"side": str, "score": float | int})

    def agent_of(self, side: str, sides: Sequence[str]) -> Path:
        """Return the folder of a side's agent, given the sides that learn."""
        return self.agent if len(sides) == 1 else self.agent / side

    def locked(self) -> contextlib.AbstractContextManager[None]:
        """Lock the folder for this process.

        Raises:
            UserError: another process holds it, or it is neither empty nor the folder of a run.
        """
        return own_folder(self.path, self.description.name, "training run")

    def read(self) -> RunDescription:
        """Return the content of ``run.json``; raises UserError if it is unreadable."""
        return RunDescription.read(self.path)

    def state(self, about: RunDescription, allow_unfinished: bool) -> RunDescription | None:
        """Return the content of ``run.json`` if it describes this run; None if there is no such file.

        Args:
            about: description of this run.
            allow_unfinished: accept the run if it is unfinished.

        Raises:
            UserError: the folder holds another run, or this run unfinished although that is not allowed.
        """
        if not self.description.exists():
            return None
        state = self.read()
        differing = about.differences(state)
        if differing == ["training_steps"] and about.offline is None:  # --start can continue it
            raise UserError(
                f"{self.path}: holds this run with {state.training_steps:,} steps, and its budget cannot "
                "change; to continue, finish it and start a new run with its weights: "
                f"--start {self.path} --out NEW"
            )
        if differing:
            differences = ", ".join(differing).replace("_", " ")
            raise other_content(self.path, f"another run, which differs in {differences}")
        if state.suite not in (None, about.suite):
            content = f"this run scored on {state.suite}, not on {about.suite}"
            raise other_content(self.path, content, f"keep its suite (--suite {state.suite})")
        if not state.finished and not allow_unfinished:
            remedy = "continue it with --resume, start over with --restart"
            raise other_content(self.path, "this run unfinished", remedy)
        return state

    def last_scores(self) -> dict[str, float | None]:
        """Return the last score of each side's policy; empty if none was evaluated."""
        return {row["side"]: row["score"] for row in self.evaluations.read()}

    def has_checkpoint(self) -> bool:
        """Return True if the run can be resumed."""
        return newest_checkpoint(self.checkpoints) is not None

    def is_finished(self) -> bool:
        """Return True if the folder holds a finished run."""
        return self.description.exists() and self.read().finished

    def clear(self) -> None:
        """Remove the files of an earlier start of the run.

        The transcript of a language model may have cost money, so it is kept under the next free name.
        """
        for folder in (self.agent, self.checkpoints):
            shutil.rmtree(folder, ignore_errors=True)
        events = self.path.glob("events.out.tfevents.*")
        files = self.curve, self.evaluations.path, self.path / MODEL, self.path / NORMALIZE
        for file in (*files, *events):
            file.unlink(missing_ok=True)
        transcript, number = self.path / TRANSCRIPT, 1
        while (kept := transcript.with_stem(f"{transcript.stem}-{number}")).exists():
            number += 1
        if transcript.exists():
            transcript.rename(kept)


def command() -> str | None:
    """Return the command that this process works for; None where Python calls."""
    return os.environ.get(COMMAND)


def revision() -> str | None:
    """Return the git revision of this code, with a + if files have changed; None outside a checkout."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return None
    try:
        changed = _git(root, "status", "--porcelain", "--", "fpg_bench", "baselines/hyperparams")
        return _git(root, "rev-parse", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.SubprocessError):
        return None


def _git(root: Path, *arguments: str) -> str:
    result = subprocess.run(
        ["git", "--no-optional-locks", *arguments],
        cwd=root,
        capture_output=True,
        text=True,
        check=True,
        timeout=10,
    )
    return result.stdout.strip()
