"""Tuning: search the hyper-parameters of an algorithm on an environment, with one worker or many."""

from __future__ import annotations

import logging
import socket
from collections.abc import Collection
from functools import partial
from pathlib import Path

import optuna

from fpg_bench.common.checks import integer
from fpg_bench.common.errors import UserError, other_content
from fpg_bench.common.output import print_messages
from fpg_bench.common.parallel import Job, Workers, check_all_done, run_jobs
from fpg_bench.game.spec import GameSpec
from fpg_bench.products.tuning.objective import Objective
from fpg_bench.products.tuning.space import format_values, from_params
from fpg_bench.products.tuning.study import (
    DATABASE,
    Task,
    best_trials,
    count_finished,
    finished_text,
    make_task,
    open_storage,
    open_study,
)
from fpg_bench.products.tuning.worker import run_worker

N_TRIALS = 20
N_SEEDS = 2

_logger = logging.getLogger(__name__)


def tune(
    algorithm: str,
    game: GameSpec | str,
    out: str | Path,
    *,
    n_trials: int = N_TRIALS,
    workers: Workers | int = 1,
    timeout: float | None = None,
    study_name: str | None = None,
    storage: str | None = None,
    n_seeds: int = N_SEEDS,
    steps: int | None = None,
    space: str | Path | None = None,
    hyperparams: str | Path | None = None,
    suite: str | None = None,
    rounds: int = 100,
    allow: Collection[str] = (),
) -> optuna.Study:
    """Run trials of a study until enough of them are finished; resume an existing study.

    A trial trains over several seeds. Its score is the mean over a suite's rivals and the seeds. The first
    trial has the present hyper-parameters, as far as they lie in the search space.

    Args:
        algorithm: ``ppo``, ``sac``, ``td3``, their variants, or ``package.module:Class``; ``maddpg`` in the
            duel.
        game: the game, or an environment id such as ``FPG/AllyVsScripted-v0`` or ``FPG/duel_v0``. A study
            stores it, so its players and planner are names.
        out: the study's folder.
        n_trials: number of finished trials (complete, pruned or failed) of the study, over all workers.
        workers: number of processes, or :class:`fpg_bench.common.parallel.Workers`. Each finishes its current
            trial, so that a study may have as many more trials than requested, less one.
        timeout: seconds after which no worker begins a new trial.
        study_name: name of the study; None for the algorithm and the id.
        storage: SQLAlchemy URL of a database; None for SQLite in the folder.
        n_seeds: number of training seeds of a trial.
        steps: training budget of a seed; None for half of that in the hyper-parameter file.
        space: YAML file of a search space; None for the shipped one.
        hyperparams: YAML file of the values that are not tuned; None for the shipped one.
        suite: the suite on which a policy is scored; None for that of the environment. In the duel it decides
            which side is scored; None for the ally's.
        rounds: number of rounds per rival.
        allow: the ``package.module:object`` and agents of the Hub that the files (hyper-parameters, search
            space, suite) may name; neither is run on a file's word.

    Returns:
        The study.

    Raises:
        UserError: an argument is unknown or out of range, the study has another task, or the database
            fails.
        KeyboardInterrupt: stopped by the user. The running trial has been queued again.
    """
    integer(n_trials, "n_trials")
    workers = Workers.of(workers)
    task = make_task(
        algorithm,
        game,
        n_seeds=n_seeds,
        steps=steps,
        space=space,
        hyperparams=hyperparams,
        suite=suite,
        rounds=rounds,
        allow=allow,
    )
    Objective(task, allow=allow)  # refuses an unsuitable search space
    opened = open_storage(Path(out), storage)
    name = study_name or f"{algorithm} {task.game.id}"
    with opened.errors():
        others = sorted(optuna.get_all_study_names(opened))
    if others and name not in others and study_name is None and storage is None:
        remedy = "name this one with --study-name"
        raise other_content(out, f"another study ({', '.join(others)})", remedy)
    study = open_study(opened, name, task)
    with opened.errors():
        left = n_trials - count_finished(study)
    if left <= 0:
        _logger.info("this study was already finished; nothing was trained")
    elif workers.is_alone:
        run_worker(study, opened, partial(Objective, task, allow=allow), n_trials, timeout)
    else:
        folder = Path(out).absolute()
        work = partial(_work, task, folder, storage, name, n_trials, timeout, allow)
        jobs = [Job(f"worker {index}", work) for index in range(min(workers.n_jobs, left))]
        check_all_done(run_jobs(jobs, workers))
    with opened.errors():
        _log_result(study, task)
    return study


def _log_result(study: optuna.Study, task: Task) -> None:
    """Log the score and the values of the best trial."""
    trials = finished_text(study)
    if best := best_trials(study, 1):
        values = format_values(from_params(task.space, best[0].params))
        _logger.info("%s, best: %.1f (trial %d): %s", trials, best[0].value, best[0].number, values)
    else:
        _logger.info("%s, none of them complete", trials)


def _work(
    task: Task,
    out: Path,
    storage: str | None,
    study_name: str,
    n_trials: int,
    timeout: float | None,
    allow: Collection[str],
) -> None:
    """Run a worker in a separate process."""
    print_messages()
    if storage is None and not (out / DATABASE).is_file():
        raise UserError(
            f"{socket.gethostname()} does not see {out / DATABASE}; set a database with --storage"
        )
    opened = open_storage(out, storage)
    study = open_study(opened, study_name, task)
    run_worker(study, opened, partial(Objective, task, allow=allow), n_trials, timeout)
