"""A study: made once with what it tunes, found again by its name, refused where it tunes something else."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Sequence
from typing import Any

import optuna
from optuna.distributions import BaseDistribution
from optuna.trial import FrozenTrial, TrialState

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.training.tuning import claim
from fpg_bench.training.tuning.storage import Storage, reason
from fpg_bench.training.tuning.task import Task

TASK = "task"
AGAIN = " again"  # ends the name of the study in which the best are trained again


class SeededSampler(optuna.samplers.BaseSampler):
    """TPE, seeded by how many trials count before: a study that was stopped goes on as one that was not.

    A trial whose worker died and that is tried again takes no place of its own, so that those after it draw
    what they would have drawn.

    Args:
        first: the parameters of the first trial, as far as they are given.
    """

    def __init__(self, first: dict[str, Any]) -> None:
        self._first, self._place = first, 0
        self._tpe = optuna.samplers.TPESampler(seed=0)

    def before_trial(self, study: optuna.Study, trial: FrozenTrial) -> None:
        """Begin a trial with a sampler of its own."""
        self._place = _place(study, trial)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # experimental arguments
            self._tpe = optuna.samplers.TPESampler(seed=self._place)
        self._tpe.before_trial(study, trial)

    def infer_relative_search_space(
        self, study: optuna.Study, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        """As TPE does; nothing in the first trial."""
        return {} if self._place == 0 else self._tpe.infer_relative_search_space(study, trial)

    def sample_relative(
        self, study: optuna.Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """As TPE does."""
        return self._tpe.sample_relative(study, trial, search_space)

    def sample_independent(
        self, study: optuna.Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """As TPE does; in the first trial what was given."""
        if self._place == 0 and param_name in self._first:
            return self._first[param_name]
        return self._tpe.sample_independent(study, trial, param_name, param_distribution)

    def after_trial(
        self, study: optuna.Study, trial: FrozenTrial, state: TrialState, values: Sequence[float] | None
    ) -> None:
        """As TPE does."""
        self._tpe.after_trial(study, trial, state, values)


def _place(study: optuna.Study, trial: FrozenTrial) -> int:
    """How many trials before this one were not tried again."""
    before = [other for other in study.get_trials(deepcopy=False) if other.number < trial.number]
    return sum(other.state != TrialState.FAIL or claim.is_finished(other) for other in before)


def open_study(storage: Storage, name: str, task: Task, pruner: optuna.pruners.BasePruner) -> optuna.Study:
    """The study of a name, made where it is not there.

    Raises:
        UserError: it tunes something else, or the storage cannot be read.
    """
    study = storage.patient(
        optuna.create_study,
        storage=storage.optuna,
        study_name=name,
        direction="maximize",
        sampler=SeededSampler(task.ranges().params_of(task.hyperparameters)),
        pruner=pruner,
        load_if_exists=True,
    )
    held = storage.patient(lambda: study.user_attrs)
    if TASK in held or storage.patient(study.get_trials, deepcopy=False):
        task.check_same(held.get(TASK), f"study {name!r} in {storage.where}")
    else:
        storage.patient(study.set_user_attr, TASK, dataclasses.asdict(task))
    return study


def find_study(storage: Storage, name: str | None) -> tuple[optuna.Study, Task]:
    """A study that is there, and what it tunes; without a name the only one.

    Raises:
        UserError: none of this name, several to choose from, or one that ``fpg-bench tune`` did not make.
    """
    names = storage.patient(optuna.get_all_study_names, storage.optuna)
    known = [found for found in names if not found.endswith(AGAIN)]
    if name is None and len(known) != 1:
        what = f"holds several, choose one with --name: {', '.join(known)}" if known else "holds no study"
        raise UserError(f"{storage.where}: {what}")
    if name is not None and name not in known:
        raise UserError(f"{storage.where}: no study {name!r}{nearest(name, known)}")
    study = storage.patient(optuna.load_study, study_name=name or known[0], storage=storage.optuna)
    held = storage.patient(lambda: study.user_attrs)
    try:
        return study, Task(**held[TASK])
    except (KeyError, TypeError) as error:
        raise UserError(
            f"study {study.study_name!r} in {storage.where}: was not made by this version of fpg-bench tune "
            f"({reason(error)})"
        ) from error


def finished(trials: list[FrozenTrial]) -> int:
    """How many trials of a study count."""
    return sum(claim.is_finished(trial) for trial in trials)


def best_trials(study: optuna.Study, count: int) -> list[FrozenTrial]:
    """The best complete trials, best first; of equal parameters one."""
    complete = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    found: dict[str, FrozenTrial] = {}
    for trial in sorted(complete, key=lambda trial: (-(trial.value or 0.0), trial.number)):
        found.setdefault(repr(sorted(trial.params.items())), trial)
    return list(found.values())[:count]
