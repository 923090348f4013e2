"""``fpg-bench tune``: search hyper-parameters of an algorithm on an id, in one worker or in many."""

from __future__ import annotations

import socket
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import Any

import optuna

from fpg_bench.common.checks import whole
from fpg_bench.common.errors import UserError
from fpg_bench.common.parallel import Job, check_all_done, run_jobs
from fpg_bench.training.tuning.storage import open_storage
from fpg_bench.training.tuning.study import finished, open_study
from fpg_bench.training.tuning.task import make_task
from fpg_bench.training.tuning.trial import PARTS, Objective
from fpg_bench.training.tuning.worker import Worker

TRIALS = 20
SEEDS = 2
# Half of the first seed's budget: sooner, what learns fast would beat what learns well.
FIRST_RUNG = PARTS // 2


def tune(
    algorithm: str,
    env_id: str,
    out: str | Path,
    *,
    trials: int = TRIALS,
    storage: str | None = None,
    name: str | None = None,
    lost: Collection[str] = (),
    say: Callable[[str], None] = print,
    **words: Any,
) -> optuna.Study:
    """Run trials of a study in this process until enough are finished; any number may run beside it.

    A trial trains over several seeds and is pruned by asynchronous halving, along the way and between seeds.
    The first one tries the present values, as far as they lie in the search space.

    Args:
        algorithm: ``ppo``, ``sac``, ``td3``, stacked and recurrent ones, or ``package.module:Class``.
        env_id: ``FPG/AllyVsScripted-v0`` and the like.
        out: the study's folder; holds its journal where no other storage is named.
        trials: how many are to be finished, by all workers together.
        storage: a database's URL; None: the journal.
        name: of the study; None: the algorithm and the id.
        lost: machines that are gone: their trials are tried again.
        say: prints a line.
        **words: what is tuned, ``seeds`` (training seeds of a trial), ``steps`` (the budget of one of them;
            None: half of the hyper-parameter file's), ``space`` and ``hyperparams`` (a search space and where
            the other values come from, YAML files; None: the shipped ones), ``suite`` (what a policy is
            scored on; None: the id's) and ``rounds`` (per rival); of the storage ``patience_s`` (how
            long to wait for one that has gone down) and ``heartbeat_s`` (how often a database is told that
            the worker lives); and the options of :class:`fpg_bench.envs.core.SingleAgentGame`.

    Returns:
        The study, as Optuna knows it.

    Raises:
        UserError: something unknown or out of range, a study that tunes something else, or a storage that is
            down at the start or does not come up again.
        KeyboardInterrupt: stopped by the user; the trial is tried again by the next worker.
    """
    whole(trials, "trials")
    of_storage = {key: words.pop(key) for key in ("patience_s", "heartbeat_s") if key in words}
    task = make_task(algorithm, env_id, **{"seeds": SEEDS, **words})
    objective, ranges = Objective(task), task.ranges()
    objective.check(ranges.first())
    opened = open_storage(Path(out), storage, say=say, **of_storage)
    halving = optuna.pruners.SuccessiveHalvingPruner(min_resource=FIRST_RUNG, reduction_factor=2)
    study = open_study(opened, name or f"{algorithm} {task.env_id}", task, halving)
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


def say_line(line: str) -> None:
    """Print a line at once; can be pickled, as ``print`` cannot be once Ray has put its own in its place."""
    print(line, flush=True)


def tune_together(
    algorithm: str,
    env_id: str,
    out: str | Path,
    *,
    workers: int,
    backend: str = "loky",
    address: str | None = None,
    storage: str | None = None,
    say: Callable[[str], None] = say_line,
    **words: Any,
) -> None:
    """Run several workers of a study until enough trials are finished.

    Args:
        algorithm: as for :func:`tune`.
        env_id: as there.
        out: the study's folder.
        workers: how many; one whose process or machine is lost is begun again, and its trial is, too.
        backend: ``loky`` or ``ray``; see :func:`fpg_bench.common.parallel.run_jobs`.
        address: of a Ray cluster.
        storage: a database's URL, which workers need who do not see the folder.
        say: prints a line, here and in the workers; can be pickled.
        **words: the others of ``tune``.

    Raises:
        UserError: what ``tune`` raises, or no cluster.
        KeyboardInterrupt: stopped by the user; the trials are tried again next time.
    """
    open_storage(Path(out), storage, say=say)  # made once, before many want to
    folder = Path(out).absolute()
    work = partial(_work, algorithm, env_id, folder, storage, words | {"say": say})
    jobs = [Job(f"worker {k}", work) for k in range(workers)]
    check_all_done(run_jobs(jobs, workers, backend, address, say))


def _work(algorithm: str, env_id: str, out: Path, storage: str | None, words: dict[str, Any]) -> None:
    if storage is None and not out.is_dir():
        raise UserError(
            f"{socket.gethostname()} does not see {out}, where the study lies; name a database by --storage"
        )
    tune(algorithm, env_id, out, storage=storage, **words)
