"""A worker: takes trial after trial of a study until enough are finished, whoever finishes them."""

from __future__ import annotations

import contextlib
import time
import warnings
from collections.abc import Callable, Collection
from typing import Any

import optuna
from optuna.trial import FrozenTrial, TrialState

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.training.tuning import claim
from fpg_bench.training.tuning.storage import Storage

POLL_S = 2.0
_MOST_FAILED = 5  # in a row: then the search space is at fault

Report = Callable[[float, int], None]
Objective = Callable[[dict[str, Any], optuna.Trial, Report], Interval]


class Worker:
    """Runs trials of a study in this process; any number of workers may run one study.

    Args:
        study: the study.
        storage: where it lies.
        suggest: gives the values of a trial.
        objective: told the values, the trial and whom to report to; gives the score.
        done: counts the finished trials among all.
        say: prints a line.
        lost: machines that are gone; their trials are tried again.
    """

    def __init__(
        self,
        study: optuna.Study,
        storage: Storage,
        suggest: Callable[[optuna.Trial], dict[str, Any]],
        objective: Objective,
        *,
        done: Callable[[list[FrozenTrial]], int],
        say: Callable[[str], None],
        lost: Collection[str] = (),
    ) -> None:
        self._study, self._storage, self._patient = study, storage, storage.patient
        self._suggest, self._objective = suggest, objective
        self._done, self._say, self._lost = done, say, lost
        self._failed = 0

    def run(self, wanted: int) -> None:
        """Take trials until this many are finished.

        Raises:
            UserError: the storage stays down, or every trial fails.
            KeyboardInterrupt: stopped by the user; the trial is tried again.
        """
        while True:
            self._patient(self._storage.fail_stale, self._study)
            self._patient(claim.recover, self._study, self._lost, self._say)
            trials = self._patient(self._study.get_trials, deepcopy=False)
            running = [trial for trial in trials if trial.state == TrialState.RUNNING]
            done = self._done(trials)
            if done >= wanted:
                return
            if done + len(running) < wanted:
                self._run_one(wanted)
            elif self._storage.journal and all(claim.is_foreign(trial) for trial in running):
                self._say(_left_to_others(running))
                return
            else:
                time.sleep(POLL_S)  # one of them may die

    def _run_one(self, wanted: int) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Optuna's, on heartbeats and experimental features
            trial = self._patient(self._study.ask)
        try:
            with self._storage.beating(trial):
                self._patient(claim.sign, trial)
                start = time.monotonic()
                values = self._patient(self._suggest, trial)
                self._say(f"{_named(trial)}: {shown(values)}")
                ended = self._ended(trial, values)
            self._say(f"{_named(trial)}: {ended}, {time.monotonic() - start:.0f} s; {self._count(wanted)}")
        except optuna.exceptions.UpdateFinishedTrialError:
            self._say(f"{_named(trial)}: was taken for dead by another worker, and is tried again")
            return
        except BaseException as error:
            self._abandon(trial, error)
            raise
        if self._failed >= _MOST_FAILED:
            raise UserError(f"{_MOST_FAILED} trials failed one after the other, the last: {ended}")

    def _ended(self, trial: optuna.Trial, values: dict[str, Any]) -> str:
        """Run a trial, tell the study how it ended, and say so."""

        def report(value: float, step: int) -> None:
            self._patient(trial.report, value, step)
            if self._patient(trial.should_prune):
                raise optuna.TrialPruned(f"pruned at {value:.1f}")

        try:
            score = self._objective(values, trial, report)
        except optuna.TrialPruned as pruned:
            self._tell(trial, state=TrialState.PRUNED)
            self._failed = 0
            return str(pruned)
        except UserError:
            raise
        except (ArithmeticError, RuntimeError, ValueError) as error:
            self._failed += 1
            said = " ".join(f"{type(error).__name__}: {error}".split())[:200]
            self._patient(trial.set_user_attr, "error", said)
            self._tell(trial, state=TrialState.FAIL)
            return f"failed ({said})"
        self._failed = 0
        if score.low != score.high:
            self._patient(trial.set_user_attr, "interval", [score.low, score.high, score.over])
        self._tell(trial, score.value)
        return f"score {score.value:.1f}"

    def _tell(self, trial: optuna.Trial, value: float | None = None, state: Any = None) -> None:
        """Tell the study how a trial ended, unless another worker has given it up meanwhile."""
        with contextlib.suppress(optuna.exceptions.UpdateFinishedTrialError):
            self._patient(self._study.tell, trial, value, state, skip_if_finished=True)

    def _abandon(self, trial: optuna.Trial, error: BaseException) -> None:
        """Fail a trial that cannot go on; one that the user stopped is tried again."""
        with contextlib.suppress(Exception):  # with the storage down, its worker's death tells
            self._study.tell(trial, state=TrialState.FAIL)
            if isinstance(error, KeyboardInterrupt):
                found = self._study.get_trials(deepcopy=False)[trial.number]
                claim.try_again(self._study, found, blamed=False)

    def _count(self, wanted: int) -> str:
        trials = self._patient(self._study.get_trials, deepcopy=False)
        complete = [trial for trial in trials if trial.state == TrialState.COMPLETE]
        best = max(complete, key=lambda trial: (trial.value or 0.0, trial.number), default=None)
        so_far = "" if best is None else f", best {best.value:.1f} ({_named(best)})"
        return f"{self._done(trials)} of {wanted} finished{so_far}"


def _named(trial: optuna.Trial | FrozenTrial) -> str:
    """What lines call a trial; one that is another study's trial trained again, by that one's number."""
    known = trial.user_attrs
    if "candidate" in known:
        return f"trial {known['candidate']} again, seed {known['seed']}"
    return f"trial {trial.number}"


def shown(values: dict[str, Any]) -> str:
    """Values by name, in one line."""
    return ", ".join(
        f"{name} {v:.3g}" if isinstance(v, float) else f"{name} {v}" for name, v in values.items()
    )


def _left_to_others(running: list[FrozenTrial]) -> str:
    hosts = ", ".join(sorted({claim.host_of(trial) for trial in running}))
    return (
        f"{len(running)} trials are left to workers on {hosts}; if that machine is gone, run this again with "
        f"--lost {hosts}"
    )
