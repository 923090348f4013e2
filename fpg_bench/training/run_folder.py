"""A training run's folder: what it says of itself, whose it is, and what lies in it."""

from __future__ import annotations

import contextlib
import os
import shlex
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.files import read_json, write_json
from fpg_bench.rows import RowFile
from fpg_bench.training.checkpoints import MODEL, NORMALIZE, newest_checkpoint
from fpg_bench.training.language_model import set_aside

EVALUATIONS = "evaluations.jsonl"
# What tells two runs apart; the command and the versions may differ where one goes on.
_SAME = (
    "algorithm",
    "id",
    "scenario",
    "training_seed",
    "training_steps",
    "hyperparameters",
    "options",
    "policies",
)


class RunFolder:
    """The folder of one run.

    Args:
        path: where it is or shall be.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.agent, self.checkpoints = path / "agent", path / "checkpoints"
        self.curve = path / "curve.png"
        self.evaluations = RowFile(path / EVALUATIONS, {"side": str, "score": float | int})

    def agent_of(self, side: str, sides: Sequence[str]) -> Path:
        """The folder of a side's agent, where these sides learn."""
        return self.agent if len(sides) == 1 else self.agent / side

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the folder for this process alone.

        Raises:
            UserError: another process holds it, or it is not empty and no run's folder.
        """
        there = os.listdir(self.path) if self.path.exists() else []
        # A run that was killed before its run.json was whole may have left these
        others = [name for name in there if name != EVALUATIONS and not name.startswith(".run.json.")]
        if others and "run.json" not in there:
            raise UserError(f"{self.path}: is not empty and no run's folder; choose another")
        with contextlib.ExitStack() as stack:
            try:
                stack.enter_context(self.evaluations.locked())
            except UserError as error:
                raise UserError(f"{self.path}: another process is training in this folder") from error
            yield

    def found(self, about: dict[str, Any], again: bool) -> dict[str, Any] | None:
        """What the folder says of this very run, None where none was begun.

        Args:
            about: this run.
            again: whether it may be there unfinished.

        Raises:
            UserError: another run, or this one unfinished.
        """
        if not (self.path / "run.json").exists():
            return None
        found = read_json(self.path / "run.json", "run")
        differing = [key for key in _SAME if found.get(key) != about.get(key)]
        if differing == ["training_steps"]:
            raise UserError(
                f"{self.path}: holds this run with {found['training_steps']:,} steps, and its budget stays; "
                f"to train on, finish it, then begin another with its weights: --start {self.path} --out NEW"
            )
        if differing:
            raise UserError(
                f"{self.path}: holds another run ({found.get('command')}), or this one with other "
                "hyper-parameters or agents; choose another folder"
            )
        if not found.get("finished") and not again:
            raise UserError(
                f"{self.path}: holds this run unfinished; go on with --resume, begin it again with "
                "--restart, or choose another folder"
            )
        return found

    def last_scores(self) -> dict[str, float | None]:
        """What the policy of each side scored when it was last looked at; of no side where it never was."""
        return {row["side"]: row["score"] for row in self.evaluations.read()}

    def has_checkpoint(self) -> bool:
        """Whether there is something to go on from."""
        return newest_checkpoint(self.checkpoints) is not None

    def is_finished(self) -> bool:
        """Whether a run lies here that came to its end."""
        about = self.path / "run.json"
        return about.exists() and bool(read_json(about, "run").get("finished"))

    def clear(self) -> None:
        """Forget a run that is to begin again."""
        for folder in (self.agent, self.checkpoints):
            shutil.rmtree(folder, ignore_errors=True)
        events = self.path.glob("events.out.tfevents.*")
        for file in (self.curve, *events, *(self.path / name for name in (MODEL, NORMALIZE))):
            file.unlink(missing_ok=True)
        set_aside(self.path)
        os.truncate(self.evaluations.path, 0)  # it is locked, so it stays

    def write(self, about: dict[str, Any]) -> None:
        """Write ``run.json``."""
        write_json(self.path / "run.json", about)


def command_line(*words: str, **options: Any) -> str:
    """The command of these words and options, as it is typed."""
    for name, value in options.items():
        words += (f"--{name.replace('_', '-')}", words_of(value))
    return shlex.join(("fpg-bench", *words))


def words_of(value: Any) -> str:
    """An option as it is typed, a list separated by commas."""
    return ",".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


def revision() -> str | None:
    """The git revision that this code is at, with a + where it has changed; None outside a checkout."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return None
    try:
        changed = _git(root, "status", "--porcelain", "--", "fpg_bench", "baselines/hyperparams")
        return _git(root, "rev-parse", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.SubprocessError):
        return None


def _git(root: Path, *words: str) -> str:
    done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=True, timeout=10)
    return done.stdout.strip()
