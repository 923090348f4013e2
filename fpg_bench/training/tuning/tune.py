"""``fpg-bench tune``: search hyper-parameters of an algorithm on an id, in one worker of a study."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import optuna

from fpg_bench.checks import whole
from fpg_bench.training.tuning import claim
from fpg_bench.training.tuning.storage import HEARTBEAT_S, PATIENCE_S, open_storage
from fpg_bench.training.tuning.study import finished, open_study
from fpg_bench.training.tuning.task import ROUNDS, make_task
from fpg_bench.training.tuning.trial import PARTS, Objective
from fpg_bench.training.tuning.worker import Worker

TRIALS = 20
SEEDS = 2
# Half of the first seed's budget: sooner, what learns fast would beat what learns well.
FIRST_RUNG = PARTS // 2


def tune(
    algorithm: str,
    view_id: str,
    out: str | Path,
    *,
    trials: int = TRIALS,
    seeds: int = SEEDS,
    steps: int | None = None,
    space: str | Path | None = None,
    hyperparams: str | Path | None = None,
    field: str | None = None,
    rounds: int = ROUNDS,
    storage: str | None = None,
    name: str | None = None,
    lost: Collection[str] = (),
    patience_s: float = PATIENCE_S,
    heartbeat_s: int = HEARTBEAT_S,
    say: Callable[[str], None] = print,
    **options: Any,
) -> optuna.Study:
    """Run trials of a study in this process until enough are finished; any number may run beside it.

    A trial trains over several seeds and is pruned by asynchronous halving, along the way and between seeds.
    The first one tries the present values, as far as they lie in the search space.

    Args:
        algorithm: ``ppo``, ``sac``, ``td3``, stacked and recurrent ones, or ``package.module:Class``.
        view_id: ``FPG/AllyVsScripted-v0`` and the like.
        out: the study's folder; holds its journal where no other storage is named.
        trials: how many are to be finished, by all workers together.
        seeds: training seeds of a trial.
        steps: the budget of one training seed; None: half of the hyper-parameter file's.
        space: a search space of one's own, a YAML file; None: the shipped one.
        hyperparams: where the other values come from, a YAML file; None: the shipped one.
        field: what a policy is scored on; None: the id's.
        rounds: per counterpart.
        storage: a database's URL; None: the journal.
        name: of the study; None: the algorithm and the id.
        lost: machines that are gone: their trials are tried again.
        patience_s: how long to wait for a storage that has gone down.
        heartbeat_s: how often a database is told that the worker lives.
        say: prints a line.
        **options: those of :class:`fpg_bench.envs.one_sided.OneSided`.

    Returns:
        The study, as Optuna knows it.

    Raises:
        UserError: something unknown or out of range, a study that tunes something else, or a storage that is
            down at the start or does not come up again.
        KeyboardInterrupt: stopped by the user; the trial is tried again by the next worker.
    """
    whole(trials, "trials")
    task = make_task(
        algorithm,
        view_id,
        seeds=seeds,
        steps=steps,
        space=Path(space) if space else None,
        hyperparams=Path(hyperparams) if hyperparams else None,
        field=field,
        rounds=rounds,
        options=options,
    )
    objective, ranges = Objective(task), task.ranges()
    objective.check(ranges.first())
    opened = open_storage(
        Path(out), storage, stale=claim.try_again, say=say, patience_s=patience_s, heartbeat_s=heartbeat_s
    )
    halving = optuna.pruners.SuccessiveHalvingPruner(min_resource=FIRST_RUNG, reduction_factor=2)
    study = open_study(opened, name or f"{algorithm} {task.view_id}", task, halving)
    training_seeds = [task.first_seed + index for index in range(task.seeds)]
    Worker(
        study,
        opened,
        ranges.suggest,
        lambda values, trial, report: objective(values, training_seeds, report),
        done=finished,
        say=say,
        lost=lost,
    ).run(trials)
    return study
