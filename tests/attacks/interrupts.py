"""Ctrl-C at random moments of a study with two workers, beside a process that keeps a core busy."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from optuna.trial import TrialState

from fpg_bench import cli
from fpg_bench.training.tuning import tune  # loaded before a process is forked
from fpg_bench.training.tuning.study import DATABASE, open_storage
from tests.training.tuning.test_tune import ENV_ID, HYPERPARAMS, SPACE

TUNE = (
    f"tune run ppo {ENV_ID} --space space.yml --hyperparams mine.yml --rounds 1 --n-seeds 1 --steps 960 "
    "--n-trials 100000 --n-jobs 2 --out study"
)
LONGEST_S = 12.0  # until the interrupt; the workers have begun trials by then
HANGS_S = 180.0  # no stop takes as long
STOPPED = "fpg-bench: stopped; what was finished is kept"
Started = tuple[Any, Callable[[], int | None]]  # a process, and what waits for its status; None if it hangs
_MARK = "FPG_TEST_INTERRUPTS"  # in the environment of all processes of a case


class InterruptedStudy:
    """A study in a folder that each case goes on with and interrupts.

    Attributes:
        n_trials: number of its trials after the last case.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.n_trials = 0
        (folder / "mine.yml").write_text(HYPERPARAMS)
        (folder / "space.yml").write_text(SPACE)
        assert tune

    def problems(self, seed: int) -> list[str]:
        """Run the command, interrupt it once, and return what was wrong.

        Args:
            seed: of the moment and of the way: half of the cases wait until a trial has begun, each fourth
                one begins with a new interpreter, and half of them interrupt the whole group of processes, as
                a terminal does.
        """
        rng = random.Random(seed)
        mark, waits = f"{os.getpid()}-{seed}", seed % 2 == 1
        moment, kill = rng.uniform(0.0, LONGEST_S / (4 if waits else 1)), rng.choice((os.kill, os.killpg))
        output, errors = self.folder / "stdout", self.folder / "stderr"
        with output.open("w") as out, errors.open("w") as error:
            start = self._start_interpreter if seed % 4 == 0 else self._fork
            process, wait = start(mark, out.fileno(), error.fileno())
            if waits:
                _wait_until(lambda: "trial" in output.read_text())
            time.sleep(moment)
            kill(process.pid, signal.SIGINT)
            status = wait()
        lines = errors.read_text().splitlines()
        problems = [f"{name} is left" for name in _left(mark)]
        if status is None:
            problems.append(f"it hung after {moment:.2f} s")
        elif status not in (130, -signal.SIGINT):
            problems.append(f"status {status}")
        said = [line for line in lines if line.startswith("fpg-bench: ") or "Traceback" in line]
        if status == 130 and said != [STOPPED]:
            problems.append(f"it said {lines}")
        return [f"seed {seed}, {moment:.2f} s: {problem}" for problem in problems + self._not_given_back()]

    def _start_interpreter(self, mark: str, out: int, error: int) -> Started:
        process = subprocess.Popen(
            [sys.executable, "-m", "fpg_bench.cli", *TUNE.split()],
            cwd=self.folder,
            env=os.environ | {_MARK: mark, "PYTHONPATH": os.pathsep.join(sys.path)},
            stdout=out,
            stderr=error,
            start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )

        def wait() -> int | None:
            try:
                return process.wait(HANGS_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                return None

        return process, wait

    def _fork(self, mark: str, out: int, error: int) -> Started:
        context = multiprocessing.get_context("fork")
        ready = context.Event()
        process = context.Process(target=_command, args=(self.folder, mark, out, error, ready))
        process.start()
        ready.wait(HANGS_S)

        def wait() -> int | None:
            process.join(HANGS_S)
            if process.is_alive():
                process.kill()
                process.join()
                return None
            return process.exitcode

        return process, wait

    def _not_given_back(self) -> list[str]:
        """Return the trials that were interrupted and not queued again."""
        if not (self.folder / "study" / DATABASE).exists():
            return []
        storage = open_storage(self.folder / "study")
        (study,) = storage.get_all_studies() or [None]
        trials = [] if study is None else storage.get_all_trials(study._study_id)
        storage.remove_session()
        storage.engine.dispose()
        self.n_trials = len(trials)
        again = {number for trial in trials for number in trial.system_attrs.get("retry_history", ())}
        problems = [f"trial {t.number} is running" for t in trials if t.state == TrialState.RUNNING]
        failed = [t.number for t in trials if t.state == TrialState.FAIL and t.number not in again]
        return problems + [f"trial {number} is not queued again" for number in failed]


def _command(folder: Path, mark: str, out: int, error: int, ready: Any) -> None:
    """Run the command in a forked process, as the leader of its session."""
    os.setsid()
    os.chdir(folder)
    os.environ |= {_MARK: mark, "PYTHONPATH": os.pathsep.join(sys.path)}
    os.dup2(out, 1)
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


@contextlib.contextmanager
def busy() -> Iterator[None]:
    """Keep a core busy."""
    process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        process.kill()
        process.wait()
