"""Several training seeds of one algorithm as a list of jobs, each in a run folder of its own."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.jobs.folders import folder_job
from fpg_bench.jobs.job import check_all_done
from fpg_bench.jobs.run import run_jobs
from fpg_bench.planning import LLM_CONTROLS
from fpg_bench.training.spec import RunSpec
from fpg_bench.training.train import LOOKS, is_finished, train_run

_HOW = ("workers", "backend", "address", "evaluations", "restart", "say")


def train_seeds(
    algorithm: str,
    view_id: str,
    out: str | Path,
    seeds: Iterable[int],
    **words: Any,
) -> None:
    """Train several seeds of an algorithm on an id; see :func:`train_runs`.

    Args:
        algorithm: as for :class:`fpg_bench.training.spec.RunSpec`.
        view_id: as there.
        out, seeds: as for :func:`train_runs`.
        **words: the others of ``train_runs``, of ``RunSpec``, and the games' options, by their names.
    """
    how = {name: words.pop(name) for name in _HOW if name in words}
    train_runs(RunSpec.of(algorithm, view_id, **words), out, seeds, **how)


def train_runs(
    spec: RunSpec,
    out: str | Path,
    seeds: Iterable[int],
    *,
    evaluations: int = LOOKS,
    restart: bool = False,
    say: Callable[[str], None] = print,
    **workers: Any,
) -> None:
    """Train several seeds, some of them at once; what was finished before is not repeated.

    Args:
        spec: the run of each seed, but for that.
        out: seed k is trained into its folder ``seed_k``.
        seeds: the training seeds.
        evaluations: how many times each is scored on the way.
        restart: begin unfinished runs again, from the start; otherwise they go on.
        say: told a line per run that begins or ends.
        **workers: ``workers``, ``backend``, ``address``: how many are trained at once, one thread each, and
            where; see :func:`fpg_bench.jobs.run.run_jobs`.

    Raises:
        UserError: something unknown or out of range, folders that hold other runs, a planner that is a
            language model, or a run that failed (the others are not held up by it).
        KeyboardInterrupt: stopped by the user; the runs have saved where they were.
    """
    if spec.options.get("planner") in LLM_CONTROLS:
        raise UserError("seeds: a language model plans for one run at a time; train each seed by itself")
    how: Any = {"evaluations": evaluations, "restart": restart, "resume": not restart, "progress": False}
    jobs = []
    for seed in seeds:
        run, folder = dataclasses.replace(spec, seed=seed), Path(out) / f"seed_{seed}"
        done = partial(is_finished, run, folder)
        jobs.append(folder_job(folder.name, folder, partial(train_run, run, **how), done))
    check_all_done(run_jobs(jobs, say=say, **workers))


def parse_seeds(text: str) -> list[int]:
    """The seeds of ``0-4`` or ``0,2,5``.

    Raises:
        UserError: neither.
    """
    seeds: list[int] = []
    for part in text.split(","):
        found = re.fullmatch(r"(\d+)(?:-(\d+))?", part)
        if not found:
            raise UserError(f"seeds: expected 0-4 or 0,2,5, got {text!r}")
        seeds += range(int(found[1]), int(found[2] or found[1]) + 1)
    if not seeds or len(set(seeds)) < len(seeds):
        raise UserError(f"seeds: each has to be named once, got {text!r}")
    return seeds
