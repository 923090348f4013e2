"""The best trials of a study, trained again on fresh seeds: what was lucky once does not count."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from optuna.trial import FrozenTrial, TrialState

from fpg_bench.common.checks import whole
from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.statistics import TRAINING_SEEDS, Interval, mean_interval
from fpg_bench.training.tuning import claim
from fpg_bench.training.tuning.storage import Storage, open_storage
from fpg_bench.training.tuning.study import AGAIN, best_trials, find_study, finished, open_study
from fpg_bench.training.tuning.task import FRESH_SEED, Task
from fpg_bench.training.tuning.trial import Objective
from fpg_bench.training.tuning.worker import Report, Worker

BEST = 3
SEEDS = 3


@dataclass(frozen=True)
class Confirmed:
    """A trial whose values were trained again.

    Attributes:
        study: the study's name. trials: how many it has finished. trial: the trial's number.
        values: of the hyper-parameters that were searched, by name.
        searched: the trial's own score. score: that on fresh seeds, with its interval.
        seeds: the fresh training seeds. task: how it was trained again.
    """

    study: str
    trials: int
    trial: int
    values: dict[str, Any]
    searched: float
    score: Interval
    seeds: range
    task: Task


def confirm(
    out: str | Path,
    *,
    best: int = BEST,
    seeds: int = SEEDS,
    steps: int | None = None,
    storage: str | None = None,
    name: str | None = None,
    lost: Collection[str] = (),
    say: Callable[[str], None] = print,
    **of_storage: Any,
) -> list[Confirmed]:
    """Train the best trials of a study again, each on the same fresh seeds; what is there is not repeated.

    Args:
        out: the study's folder.
        best: how many trials.
        seeds: fresh training seeds of each.
        steps: the budget of one training seed; None: that of the study's trials.
        storage, name, lost, say: as in :func:`fpg_bench.training.tuning.tune.tune`.
        **of_storage: ``patience_s``, as there.

    Returns:
        The trials, best on fresh seeds first.

    Raises:
        UserError: no study, one without complete trials, or a storage that is down.
    """
    for word, value in (("best", best), ("seeds", seeds), ("steps", steps)):
        if value is not None:
            whole(value, word)
    opened = open_storage(Path(out), storage, say=say, there=True, **of_storage)
    study, searched = find_study(opened, name)
    chosen = opened.patient(best_trials, study, best)
    if not chosen:
        raise UserError(f"study {study.study_name!r} in {opened.where}: no trial is complete yet")
    task = dataclasses.replace(searched, seeds=1, first_seed=FRESH_SEED, steps=steps or searched.steps)
    fresh = range(FRESH_SEED, FRESH_SEED + seeds)
    pairs = {(trial.number, seed): trial.params for trial in chosen for seed in fresh}
    again = _trained_again(opened, study.study_name, task, pairs, say, lost)
    trials = finished(opened.patient(study.get_trials, deepcopy=False))
    found = [
        Confirmed(
            study.study_name,
            trials,
            trial.number,
            task.ranges().values(trial.params),
            float(trial.value or 0.0),
            score,
            fresh,
            task,
        )
        for trial in chosen
        if (score := opened.patient(_score, again, trial.number, fresh)) is not None
    ]
    return sorted(found, key=lambda confirmed: -confirmed.score.value)


def _trained_again(
    storage: Storage,
    name: str,
    task: Task,
    pairs: dict[tuple[int, int], dict[str, Any]],
    say: Callable[[str], None],
    lost: Collection[str],
) -> optuna.Study:
    """The study whose trials are one candidate on one fresh seed each."""
    study = open_study(storage, f"{name}{AGAIN}", task, optuna.pruners.NopPruner())
    held = storage.patient(study.get_trials, deepcopy=False)
    there = {_pair(t) for t in held if t.state != TrialState.FAIL or claim.is_finished(t)}
    for (number, seed), params in pairs.items():
        if (number, seed) not in there:
            attributes = {"candidate": number, "seed": seed}
            storage.patient(study.enqueue_trial, params, user_attrs=attributes)
    objective = Objective(task)

    def train_one(values: dict[str, Any], trial: optuna.Trial, report: Report) -> Interval:
        if "seed" not in trial.user_attrs:  # the queue was empty for a moment: a dead worker's trial
            raise optuna.TrialPruned("nothing to do")
        return objective(values, [trial.user_attrs["seed"]], lambda value, step: None)

    Worker(
        study,
        storage,
        task.ranges().suggest,
        train_one,
        done=lambda trials: len({_pair(t) for t in trials if claim.is_finished(t)} & set(pairs)),
        say=say,
        lost=lost,
    ).run(len(pairs))
    return study


def _pair(trial: FrozenTrial) -> tuple[int, int]:
    return trial.user_attrs.get("candidate", -1), trial.user_attrs.get("seed", -1)


def _score(study: optuna.Study, number: int, seeds: Sequence[int]) -> Interval | None:
    """A candidate's score over the fresh seeds; None where one of them failed."""
    complete = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    by_seed = {_pair(trial)[1]: trial.value for trial in complete if _pair(trial)[0] == number}
    if not set(seeds) <= by_seed.keys():
        return None
    return mean_interval(np.array([by_seed[seed] for seed in seeds]), TRAINING_SEEDS)
