"""Several training seeds of one algorithm as a list of jobs, each in a run folder of its own."""

from __future__ import annotations

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
from fpg_bench.training.train import LOOKS, is_finished, train


def train_seeds(
    algorithm: str,
    view_id: str,
    out: str | Path,
    seeds: Iterable[int],
    *,
    workers: int = 2,
    backend: str = "loky",
    address: str | None = None,
    evaluations: int = LOOKS,
    restart: bool = False,
    say: Callable[[str], None] = print,
    **words: Any,
) -> None:
    """Train several seeds, some of them at once; what was finished before is not repeated.

    Args:
        algorithm: as for :func:`fpg_bench.training.train.train`.
        view_id: as there.
        out: seed k is trained into its folder ``seed_k``.
        seeds: the training seeds.
        workers: how many are trained at once, one thread each.
        backend: ``loky`` or ``ray``; see :func:`fpg_bench.jobs.run.run_jobs`.
        address: of a Ray cluster.
        evaluations: how many times each is scored on the way.
        restart: begin unfinished runs again, from the start; otherwise they go on.
        say: told a line per run that begins or ends.
        **words: the others of ``train``.

    Raises:
        UserError: something unknown or out of range, folders that hold other runs, a planner that is a
            language model, or a run that failed (the others are not held up by it).
        KeyboardInterrupt: stopped by the user; the runs have saved where they were.
    """
    if words.get("planner") in LLM_CONTROLS:
        raise UserError("seeds: a language model plans for one run at a time; train each seed by itself")
    how = {"evaluations": evaluations, "restart": restart, "resume": not restart, "progress": False}
    jobs = []
    for seed in seeds:
        run, folder = words | {"seed": seed}, Path(out) / f"seed_{seed}"
        jobs.append(
            folder_job(
                folder.name,
                folder,
                partial(_train, algorithm, view_id, run | how),
                partial(is_finished, algorithm, view_id, folder, **run),
            )
        )
    check_all_done(run_jobs(jobs, workers, backend, address, say))


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


def _train(algorithm: str, view_id: str, words: dict[str, Any], folder: Path) -> None:
    train(algorithm, view_id, folder, **words)
