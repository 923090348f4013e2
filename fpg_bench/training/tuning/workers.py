"""Several workers of one study as a list of jobs, on this machine or on many."""

from __future__ import annotations

import socket
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.jobs.folders import mark, sees
from fpg_bench.jobs.job import Job, check_all_done
from fpg_bench.jobs.run import run_jobs
from fpg_bench.training.tuning import claim
from fpg_bench.training.tuning.storage import open_storage
from fpg_bench.training.tuning.tune import tune


def say_line(line: str) -> None:
    """Print a line at once; can be pickled, as ``print`` cannot be once Ray has put its own in its place."""
    print(line, flush=True)


def tune_together(
    algorithm: str,
    view_id: str,
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
        algorithm: as for :func:`fpg_bench.training.tuning.tune.tune`.
        view_id: as there.
        out: the study's folder.
        workers: how many; one whose process or machine is lost is begun again, and its trial is, too.
        backend: ``loky`` or ``ray``; see :func:`fpg_bench.jobs.run.run_jobs`.
        address: of a Ray cluster.
        storage: a database's URL, which workers need who do not see the folder.
        say: prints a line, here and in the workers; can be pickled.
        **words: the others of ``tune``.

    Raises:
        UserError: what ``tune`` raises, or no cluster.
        KeyboardInterrupt: stopped by the user; the trials are tried again next time.
    """
    open_storage(Path(out), storage, stale=claim.try_again, say=say)  # made once, before many want to
    folder = Path(out).absolute()
    work = partial(_work, algorithm, view_id, folder, mark(folder), storage, words | {"say": say})
    jobs = [Job(f"worker {k}", work) for k in range(workers)]
    check_all_done(run_jobs(jobs, workers, backend, address, say))


def _work(
    algorithm: str, view_id: str, out: Path, marked: str, storage: str | None, words: dict[str, Any]
) -> None:
    if storage is None and not sees(out, marked):
        raise UserError(
            f"{socket.gethostname()} does not see {out}, where the study lies; name a database by --storage"
        )
    tune(algorithm, view_id, out, storage=storage, **words)
