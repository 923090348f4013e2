"""A study that is interrupted at any moment ends at once, and gives back each trial that it had begun."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import random
import signal
import sqlite3
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from optuna.trial import TrialState

from fpg_bench.cli import main as cli
from fpg_bench.products.tuning import tune
from fpg_bench.products.tuning.study import DATABASE, open_storage
from tests.attacks import SCALE, SEED
from tests.products.tuning.test_tune import ENV_ID, HYPERPARAMS, SPACE

TUNE = (
    f"tune run ppo {ENV_ID} --space space.yml --hyperparams mine.yml --rounds 1 --n-seeds 1 --steps 960 "
    "--n-trials 100000 --n-jobs 2 --out study"
)
LONGEST_S = 12.0  # until the interrupt; the workers have begun trials by then
HANGS_S = 180.0  # no stop takes as long
STOPPED = "fpg-bench: stopped; what was finished is kept"
_MARK = "FPG_TEST_INTERRUPTS"  # in the environment of all processes of a case


class InterruptedStudy:
    """A study in a folder that each case resumes and interrupts."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "mine.yml").write_text(HYPERPARAMS)
        (folder / "space.yml").write_text(SPACE)
        assert tune

    def problems(self, seed: int) -> list[str]:
        """Run the command, interrupt it once, and return what was wrong.

        Args:
            seed: of the moment and of the way: an even one waits until a trial has begun, and half of all
                interrupt the whole group of processes, as a terminal does.
        """
        rng = random.Random(seed)
        mark, waits = f"{os.getpid()}-{seed}", seed % 2 == 0
        moment, kill = 0.0 if waits else rng.uniform(0.0, LONGEST_S), rng.choice((os.kill, os.killpg))
        errors = self.folder / "stderr"
        context = multiprocessing.get_context("fork")
        with errors.open("w") as error:
            ready = context.Event()
            process = context.Process(target=_command, args=(self.folder, mark, error.fileno(), ready))
            process.start()
            ready.wait(HANGS_S)
            if waits:
                _wait_until(self._has_begun)
            time.sleep(moment)
            kill(process.pid, signal.SIGINT)
            process.join(HANGS_S)
            status = process.exitcode
            process.kill()
        lines = errors.read_text().splitlines()
        problems = [f"{name} is left" for name in _left(mark)]
        if status not in (130, -signal.SIGINT):
            problems.append("it hung" if status is None else f"status {status}")
        said = [line for line in lines if line.startswith("fpg-bench: ") or "Traceback" in line]
        if status == 130 and said != [STOPPED]:
            problems.append(f"it printed {lines}")
        return [f"seed {seed}, {moment:.2f} s: {problem}" for problem in problems + self._not_given_back()]

    def _has_begun(self) -> bool:
        """Return whether a trial is under way."""
        address = f"file:{self.folder / 'study' / DATABASE}?mode=ro"
        with (
            contextlib.suppress(sqlite3.Error),
            contextlib.closing(sqlite3.connect(address, uri=True)) as data,
        ):
            return bool(data.execute("SELECT 1 FROM trials WHERE state = 'RUNNING'").fetchone())
        return False

    def _not_given_back(self) -> list[str]:
        """Return the trials that were interrupted and not queued again."""
        if not (self.folder / "study" / DATABASE).exists():
            return []
        storage = open_storage(self.folder / "study")
        (study,) = storage.get_all_studies() or [None]
        trials = [] if study is None else storage.get_all_trials(study._study_id)
        storage.remove_session()
        storage.engine.dispose()
        again = {number for trial in trials for number in trial.system_attrs.get("retry_history", ())}
        problems = [f"trial {t.number} is running" for t in trials if t.state == TrialState.RUNNING]
        failed = [t.number for t in trials if t.state == TrialState.FAIL and t.number not in again]
        return problems + [f"trial {number} is not queued again" for number in failed]


def _command(folder: Path, mark: str, error: int, ready: Any) -> None:
    """Run the command in a forked process, as the leader of its session."""
    os.setsid()
    os.chdir(folder)
    os.environ |= {_MARK: mark, "PYTHONPATH": os.pathsep.join(sys.path)}
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(error, 2)
    sys.stderr = open(2, "w", closefd=False)  # noqa: SIM115  pytest has captured the old one
    sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    sys.argv = ["fpg-bench", *TUNE.split()]
    signal.signal(signal.SIGINT, signal.default_int_handler)
    ready.set()
    cli.main()


def _left(mark: str) -> list[str]:
    """Return the processes of a case that do not end."""
    left: list[Path] = []

    def are_gone() -> bool:
        left[:] = [process for process in _processes() if _is_of(process, mark)]
        return not left

    _wait_until(are_gone)
    for process in left:
        os.kill(int(process.name), signal.SIGKILL)
    return [process.name for process in left]


def _wait_until(condition: Callable[[], bool]) -> None:
    """Wait for a condition, for some minutes at most."""
    end = time.monotonic() + HANGS_S
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)


def _processes() -> Iterator[Path]:
    return (path for path in Path("/proc").iterdir() if path.name.isdecimal())


def _is_of(process: Path, mark: str) -> bool:
    with contextlib.suppress(OSError):
        return f"{_MARK}={mark}\0".encode() in (process / "environ").read_bytes()
    return False


@pytest.mark.full
@pytest.mark.slow
@pytest.mark.process
def test_an_interrupted_study_gives_back_its_trials(tmp_path):
    study = InterruptedStudy(tmp_path)
    assert not [problem for seed in range(SEED, SEED + SCALE) for problem in study.problems(seed)]
