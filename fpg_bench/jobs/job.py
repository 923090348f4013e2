"""A job: something to run in a worker, what becomes of its result, and how to tell that it is there."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from fpg_bench.common.errors import UserError
from fpg_bench.common.imports import reason


def _never() -> bool:
    return False


def _drop(result: Any) -> None:
    """Do nothing: what the job wrote itself is its result."""


@dataclass(frozen=True)
class Job:
    """One entry of a list of jobs.

    Attributes:
        name: what lines about it call it.
        run: called in a worker, without arguments; it and what it returns can be pickled.
        keep: told in this process what ``run`` returned.
        done: asked in this process before the job begins: whether its result is there already.
    """

    name: str
    run: Callable[[], Any]
    keep: Callable[[Any], None] = _drop
    done: Callable[[], bool] = _never


@dataclass(frozen=True)
class Outcome:
    """How a job ended in its worker: what it returned, or one line that says why it failed."""

    result: Any = None
    error: str | None = None


class Pool(Protocol):
    """Workers, wherever they are, each of which runs one job at a time."""

    def submit(self, call: Callable[[], Outcome]) -> Any:
        """Begin a call; gives its :class:`concurrent.futures.Future`, which fails if the worker is lost."""

    def check(self) -> None:
        """Raise UserError where nothing can run any more."""

    def release(self, future: Any) -> None:
        """Be told that a call has ended and its outcome was read."""

    def interrupt(self) -> None:
        """Send Ctrl-C to all calls that are running."""

    def close(self) -> None:
        """Let the workers go, at once."""


def attempt(run: Callable[[], Any], folder: str) -> Outcome:
    """Run a job in a worker.

    Args:
        run: the job.
        folder: the driver's present folder, which becomes the worker's where it has it, too.
    """
    if os.path.isdir(folder):
        os.chdir(folder)
    return outcome_of(run)


def outcome_of(run: Callable[[], Any]) -> Outcome:
    """What a call returned, or one line on why it failed, whatever it raised: the failure stays its own."""
    try:
        return Outcome(result=run())
    except UserError as error:
        return Outcome(error=str(error))
    except OSError as error:  # a disk that is full, most of all
        return Outcome(error=": ".join(filter(None, [error.filename, error.strerror or str(error)])))
    except Exception as error:
        return Outcome(error=f"a bug: {reason(error)}")


def check_all_done(failed: Mapping[str, str]) -> None:
    """Raise UserError where jobs failed, with the line of the first.

    Args:
        failed: what :func:`fpg_bench.jobs.run.run_jobs` returned.
    """
    if failed:
        name, why = next(iter(failed.items()))
        more = f" (and {len(failed) - 1} more failed)" if len(failed) > 1 else ""
        raise UserError(f"{name}: {why}{more}")
