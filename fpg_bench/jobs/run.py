"""Running a list of jobs to its end, whatever happens to the workers."""

from __future__ import annotations

import concurrent.futures
import functools
import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from fpg_bench.common.checks import whole
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.extras import need
from fpg_bench.jobs.job import Job, Outcome, Pool, attempt

BACKENDS = ("loky", "ray")
MOST_TRIES = 3  # a job that takes its worker with it so often is at fault itself
GRACE_S = 60.0  # for what is interrupted to save where it is
LINE_EVERY_S = 30.0  # at most, of silence
_CHECK_S = 5.0


@dataclass(frozen=True)
class _Try:
    """A job under way: which try it is, and when it began."""

    job: Job
    number: int
    start_s: float


def run_jobs(
    jobs: Iterable[Job],
    workers: int = 2,
    backend: str = "loky",
    address: str | None = None,
    say: Callable[[str], None] = print,
) -> dict[str, str]:
    """Run all jobs that are not done yet, several at once.

    A job whose worker is lost (killed, out of memory, its machine gone) is tried again, elsewhere if need be.
    One that fails by itself is not, and does not hold up the others.

    Args:
        jobs: in the order in which they begin.
        workers: how many run at once, one thread each.
        backend: ``loky`` for processes of this machine, ``ray`` for a Ray cluster.
        address: of the cluster, ``host:port``; None: that in the environment's ``RAY_ADDRESS``, else one is
            started on this machine for as long as the jobs take.
        say: told a line per job that begins or ends, and every half minute how many are under way.

    Returns:
        Why jobs failed, by name, in the order of the jobs; empty where all is well.

    Raises:
        UserError: an unknown backend, or no cluster at the address, or none of its machines is left.
        KeyboardInterrupt: stopped by the user; what was finished is kept, what can save itself has done so.
    """
    _check(workers, backend, address)
    waiting = deque((job, 1) for job in jobs if not job.done())
    failed: dict[str, str] = {}
    if not waiting:
        return failed
    pool = _pool(backend, address, workers)
    running: dict[Any, _Try] = {}
    told = time.monotonic()
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                job, number = waiting.popleft()
                if number == 1 or not job.done():  # the others were asked above
                    future = pool.submit(functools.partial(attempt, job.run, os.getcwd()))
                    running[future] = _Try(job, number, time.monotonic())
                    say(f"{job.name}: begins" + (f", try {number}" if number > 1 else ""))
            for future in _ended(running):
                told = time.monotonic()
                pool.release(future)
                again = _settle(future, running.pop(future), failed, say)
                waiting.extendleft(again)
            if running and time.monotonic() - told >= LINE_EVERY_S:
                told = time.monotonic()
                say(_under_way(running.values(), len(waiting)))
            pool.check()
    except KeyboardInterrupt:
        pool.interrupt()
        for future in concurrent.futures.wait(running, timeout=GRACE_S).done:
            if future.exception() is None:  # it ended by itself meanwhile
                _settle(future, running[future], failed, say)
        raise
    finally:
        pool.close()
    return {job.name: failed[job.name] for job in jobs if job.name in failed}


@dataclass(frozen=True)
class Workers:
    """How many jobs run at once, and where; see :func:`run_jobs`."""

    jobs: int = 1
    backend: str = "loky"
    address: str | None = None

    @property
    def alone(self) -> bool:
        """Whether a single local one is asked for: this process does as well."""
        return self == Workers()


def run_quietly(jobs: Sequence[Job], workers: Workers) -> dict[str, str]:
    """As :func:`run_jobs`, saying nothing; in this process where a single local worker is asked for."""
    if not workers.alone:
        return run_jobs(jobs, workers.jobs, workers.backend, workers.address, say=lambda line: None)
    failed: dict[str, str] = {}
    for job in jobs:
        if not job.done():
            outcome = attempt(job.run, os.getcwd())
            if outcome.error is None:
                job.keep(outcome.result)
            else:
                failed[job.name] = outcome.error
    return failed


def _check(workers: int, backend: str, address: str | None) -> None:
    whole(workers, "jobs")
    if backend not in BACKENDS:
        raise UserError(f"backend: unknown {backend!r}{nearest(backend, BACKENDS)}")
    if address is not None and backend != "ray":
        raise UserError("address: is a Ray cluster's; say --backend ray, too")


def _pool(backend: str, address: str | None, workers: int) -> Pool:
    if backend == "ray":
        from fpg_bench.jobs.cluster import RayPool

        return RayPool(address, workers)
    need("evaluate", "joblib")
    from fpg_bench.jobs.local import LocalPool

    return LocalPool()


def _under_way(running: Iterable[_Try], waiting: int) -> str:
    now = time.monotonic()
    names = ", ".join(f"{tried.job.name} for {now - tried.start_s:.0f} s" for tried in running)
    return f"under way: {names}; {waiting} to come"


def _ended(running: Iterable[Any]) -> Iterable[Any]:
    """The calls that have ended, none if that takes long."""
    return concurrent.futures.wait(
        running, timeout=_CHECK_S, return_when=concurrent.futures.FIRST_COMPLETED
    ).done


def _settle(
    future: Any, tried: _Try, failed: dict[str, str], say: Callable[[str], None]
) -> list[tuple[Job, int]]:
    """Keep what a call returned, or say why it failed; gives the job back where it is to be tried again."""
    job = tried.job
    lost = future.exception()
    if lost is not None and tried.number < MOST_TRIES:
        say(f"{job.name}: its worker was lost ({type(lost).__name__})")
        return [(job, tried.number + 1)]
    found = Outcome(error=f"lost its worker {MOST_TRIES} times") if lost is not None else future.result()
    if found.error is None:
        job.keep(found.result)
        say(f"{job.name}: done after {time.monotonic() - tried.start_s:.0f} s")
    else:
        failed[job.name] = found.error
        say(f"{job.name}: failed: {found.error}")
    return []
