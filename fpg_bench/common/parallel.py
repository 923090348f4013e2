"""Lists of jobs, run by joblib on the processes of this machine or by Ray on a cluster."""

from __future__ import annotations

import concurrent.futures
import contextlib
import functools
import logging
import multiprocessing
import multiprocessing.forkserver
import multiprocessing.resource_tracker
import os
import signal
import socket
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any
from unittest import mock

from fpg_bench.common.checks import integer
from fpg_bench.common.errors import UserError, nearest, one_line
from fpg_bench.common.extras import require_extra
from fpg_bench.common.imports import described

_logger = logging.getLogger(__name__)

BACKENDS = ("loky", "ray")
TRIES = 3  # attempts at a job whose worker process is lost
GRACE_S = 30.0  # for interrupted jobs to save their state
_CONNECT_S = 5.0
_LOOK_EVERY_S = 0.1  # for worker processes that are yet to be interrupted
_AGAIN_S = 0.05  # from an interrupt that could not be raised to the next
# Elsewhere libraries of the system do not survive a fork
_FORKS = sys.platform == "linux" and hasattr(os, "setpgrp")
_ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMBA")}


def _never() -> bool:
    return False


def _drop(result: object) -> None:
    """Discard the result: the job has written its own files."""


@dataclass(frozen=True)
class Job:
    """One entry of a list of jobs.

    Attributes:
        name: unique in its list; used in messages.
        run: called in a worker without arguments; both it and its result must be picklable.
        keep: called in this process with the result, as soon as the job has finished.
        done: called in this process before the job starts; true if its result exists already.
    """

    name: str
    run: Callable[[], Any]
    keep: Callable[[Any], None] = _drop
    done: Callable[[], bool] = _never


@dataclass(frozen=True)
class Outcome:
    """Result of a call and the time it took, or one line that says why it failed."""

    result: Any = None
    error: str | None = None
    seconds: float = 0.0


def folder_job(name: str, folder: Path, run: Callable[[Path], Any], done: Callable[[], bool]) -> Job:
    """Return a job that fills a folder, which its worker must see under the same path.

    Args:
        name: see :class:`Job`.
        folder: the folder; its parent is created here.
        run: called in a worker with the folder; its result is dropped.
        done: true if all files are there.
    """
    folder = folder.absolute()
    folder.parent.mkdir(parents=True, exist_ok=True)
    return Job(name, functools.partial(_fill, run, folder), done=done)


@dataclass(frozen=True)
class Workers:
    """Processes that run jobs in parallel, on this machine or a cluster.

    Functions that take workers also take a number, of processes of this machine.

    Attributes:
        n_jobs: number of parallel processes, one core each. A single local one is this process.
        backend: where they run, ``loky`` (processes on this machine) or ``ray`` (a cluster).
        address: address of the Ray cluster, ``host:port``; None: RAY_ADDRESS, else this machine. There, Ray
            is started for the duration of the jobs.

    Raises:
        UserError: not a positive number, an unknown backend, or an address without ``ray``.
    """

    n_jobs: int = 1
    backend: str = "loky"
    address: str | None = None

    def __post_init__(self) -> None:
        integer(self.n_jobs, "n_jobs")
        if self.backend not in BACKENDS:
            raise UserError(f"backend: unknown {self.backend!r}{nearest(self.backend, BACKENDS)}")
        if self.address is not None and self.backend != "ray":
            raise UserError("address: names a Ray cluster; add --backend ray")

    @classmethod
    def of(cls, workers: Workers | int) -> Workers:
        """Return workers as they are, or a number of local ones."""
        return workers if isinstance(workers, Workers) else cls(workers)

    @property
    def is_alone(self) -> bool:
        """True if the jobs run in this process, one after the other."""
        return self.n_jobs == 1 and self.backend != "ray"


def run_jobs(
    jobs: Iterable[Job],
    workers: Workers | int = 2,
    level: int = logging.INFO,
    loads: str = "fpg_bench.evaluation.play",
) -> dict[str, str]:
    """Run all jobs that are not done yet, several at once.

    A job that fails does not hold up the others. If a worker process is lost (killed, out of memory, its
    machine gone), the unfinished jobs are run again, up to three times in all.

    Args:
        jobs: started in this order.
        workers: the processes that run them, or the number of local ones.
        level: logging level of the line for each job that ends.
        loads: module that the first local workers of this process load once for all.

    Returns:
        The errors of failed jobs by name, in the order of the jobs; empty on success.

    Raises:
        UserError: an unknown backend, or no cluster at the address.
        KeyboardInterrupt: stopped by the user. Finished results are kept, and running jobs were given time
            to save their state.
    """
    workers = Workers.of(workers)
    if workers.backend == "ray":
        require_extra("ray", "ray")
    elif workers.n_jobs > 1 and not hasattr(os, "setpgrp"):  # Windows
        _logger.warning("n_jobs: several processes need Linux or macOS; the jobs run one after the other")
        workers = Workers()
    failed: dict[str, str] = {}
    jobs = list(jobs)
    waiting = {index: job for index, job in enumerate(jobs) if not job.done()}
    if len(waiting) > 1:
        _logger.log(level, f"{len(waiting)} jobs, {min(workers.n_jobs, len(waiting))} at a time")
    if waiting:
        load_ahead(workers, loads)

    def calls() -> _Calls:
        for index, job in list(waiting.items()):
            yield index, functools.partial(_attempt, job.run, os.getcwd())

    for _ in range(TRIES):
        if not waiting:
            break
        try:
            with contextlib.closing(_start(calls(), workers)) as outcomes:
                for index, outcome in outcomes:
                    job = waiting.pop(index)
                    if outcome.error is None:
                        job.keep(outcome.result)
                    error = outcome.error or _missing(job, workers)
                    if error is None:
                        _logger.log(
                            level, f"{job.name}: done after {outcome.seconds:.0f} s, {len(waiting)} to come"
                        )
                    else:
                        failed[job.name] = error
                        _logger.log(level, f"{job.name}: failed: {error}")
        except concurrent.futures.BrokenExecutor:
            _logger.warning("a worker process was lost (killed, or out of memory?)")
            waiting = {index: job for index, job in waiting.items() if not job.done()}
    failed |= {job.name: f"a worker process was lost {TRIES} times" for job in waiting.values()}
    return {job.name: failed[job.name] for job in jobs if job.name in failed}


def check_all_done(failed: Mapping[str, str]) -> None:
    """Raise UserError with the first error, if :func:`run_jobs` returned any."""
    if failed:
        name, error = next(iter(failed.items()))
        others = f" (and {len(failed) - 1} more failed)" if len(failed) > 1 else ""
        raise UserError(f"{name}: {error}{others}")


def outcome_of(run: Callable[[], Any]) -> Outcome:
    """Call a function and return its result, or one line on the exception that it raised."""
    start = time.perf_counter()
    try:
        return Outcome(run(), seconds=time.perf_counter() - start)
    except Exception as error:
        return Outcome(error=line_on(error))


def line_on(error: Exception) -> str:
    """Return one line on an exception."""
    if isinstance(error, UserError):
        return str(error)
    if isinstance(error, OSError):  # a full disk, most often
        return ": ".join(filter(None, [error.filename, error.strerror or str(error)]))
    return described(error)


_Call = Callable[[], Outcome]
_Calls = Iterator[tuple[int, _Call]]
_Outcomes = Generator[tuple[int, Outcome], None, None]


def _start(calls: _Calls, workers: Workers) -> _Outcomes:
    """Return a generator of the outcomes of calls, in the order in which they finish."""
    if workers.backend == "ray":
        return _on_ray(calls, workers)
    if workers.is_alone:
        return ((index, call()) for index, call in calls)
    return _in_processes(calls, workers.n_jobs)


def _attempt(run: Callable[[], Any], folder: str) -> Outcome:
    """Run a job in a worker, in the driver's working directory if the machine has it."""
    if os.path.isdir(folder):
        os.chdir(folder)
    return outcome_of(run)


def _fill(run: Callable[[Path], Any], folder: Path) -> None:
    if not folder.parent.is_dir():
        raise UserError(
            f"{socket.gethostname()} does not see {folder.parent}; the machines of a cluster have to share "
            "the folder that results go to"
        )
    run(folder)


def _missing(job: Job, workers: Workers) -> str | None:
    """Return an error if the files of a job are missing here: the cluster's machines share no folder."""
    if workers.backend == "ray" and job.done is not _never and not job.done():
        return "its files are not here; the machines of a cluster have to share their folder"
    return None


def _in_processes(calls: _Calls, n_jobs: int) -> _Outcomes:
    """Run calls in processes of this machine."""
    require_extra("evaluate", "joblib")
    from joblib import Parallel, delayed, parallel_config
    from joblib.externals.loky import reusable_executor
    from joblib.externals.loky.backend import resource_tracker

    for tracker in (multiprocessing.resource_tracker, resource_tracker):
        tracker.ensure_running()  # now: it lets Ctrl-C through when it has started, and workers inherit that
    with parallel_config(backend="loky", n_jobs=n_jobs, inner_max_num_threads=1):
        parallel = Parallel(
            return_as="generator_unordered", pre_dispatch="n_jobs", batch_size=1, max_nbytes=None
        )
    with _interrupts_passed_on() as is_stopped:
        results = None
        try:
            with _interrupts_held(), _forked() if _FORKS else contextlib.nullcontext():
                results = parallel(delayed(_in_worker)(*call, os.environ | _ONE_THREAD) for call in calls)
            yield from ((index, outcome) for index, outcome in results if outcome is not None)
        except concurrent.futures.BrokenExecutor:
            if not is_stopped():
                raise
        finally:
            # Not get_reusable_executor(): it would hold a lock that a thread needs which it waits for
            if (executor := reusable_executor._executor) is not None:
                executor.shutdown(kill_workers=True)
            if results is not None:
                with warnings.catch_warnings(action="ignore"):  # of tasks that it gives up
                    results.close()


def load_ahead(workers: Workers, module: str) -> None:
    """Start, on Linux, the process that local workers are forked from, which loads a module meanwhile.

    Does nothing if this process has one already, or needs none.
    """
    if _FORKS and not workers.is_alone and workers.backend == "loky":
        multiprocessing.set_forkserver_preload([module])
        with mock.patch.dict(os.environ, _ONE_THREAD):
            multiprocessing.forkserver.ensure_running()


def _forget_server() -> None:
    """Forget, in a process that was forked, its parent's process that workers are forked from."""
    server: Any = multiprocessing.forkserver._forkserver
    server._forkserver_pid = server._forkserver_address = server._forkserver_alive_fd = None


if _FORKS:
    os.register_at_fork(after_in_child=_forget_server)


@contextlib.contextmanager
def _forked() -> Iterator[None]:
    """Have joblib's workers forked from the process of :func:`load_ahead`."""
    from joblib.externals.loky.backend import context

    context.set_start_method("forkserver", force=True)
    # No worker imports this program's script: jobs are pickled whole, and not each script has a guard
    with mock.patch.multiple(sys.modules["__main__"], create=True, __spec__=None, __file__=None):
        yield


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold back Ctrl-C, also in processes started meanwhile: until their first job, for those of joblib."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _interrupts_passed_on() -> Iterator[Callable[[], bool]]:
    """Pass the first Ctrl-C or SIGTERM on to the worker processes, which save their state.

    The second one is raised. Handlers of this program alone are replaced: what the system does stays.

    Yields:
        Function that returns True once a signal has been passed on.
    """
    received: list[int] = []
    handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
    ended = threading.Event()

    def pass_on(number: int, frame: FrameType | None) -> None:
        if received:
            handlers[number](number, frame)
        received.append(number)
        threading.Thread(target=_interrupt_workers, args=(ended,), daemon=True).start()

    if threading.current_thread() is threading.main_thread():
        for number in map(int, (signal.SIGINT, signal.SIGTERM)):
            if callable(handler := signal.getsignal(number)):
                handlers[number] = handler
                signal.signal(number, pass_on)
    try:
        yield lambda: bool(received)
    finally:
        ended.set()
        for number, handler in handlers.items():
            signal.signal(number, handler)
    if received:
        handlers[received[0]](received[0], None)
        raise KeyboardInterrupt


def _interrupt_workers(ended: threading.Event) -> None:
    """Interrupt each worker process once, also those that are only just being started."""
    interrupted = set()
    while not ended.is_set():
        for process in multiprocessing.active_children():
            if process.pid is not None and process.pid not in interrupted:
                interrupted.add(process.pid)
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process.pid, signal.SIGINT)
        ended.wait(_LOOK_EVERY_S)


_interrupted = threading.Event()  # in a worker: joblib has taken jobs ahead, which are not to start any more


def _in_worker(index: int, call: _Call, environment: Mapping[str, str]) -> tuple[int, Outcome | None]:
    """Run a call in a worker process, in the driver's environment; its outcome is None if interrupted.

    The worker leaves the terminal's process group, so that Ctrl-C reaches it once, through the driver.
    """
    if os.getpgrp() != os.getpid():  # its first job
        os.setpgrp()
        threading.Thread(target=_stop_with_driver, daemon=True).start()
    os.environ.update(environment)

    def interrupt(number: int, frame: object) -> None:
        _interrupted.set()
        raise KeyboardInterrupt

    sys.unraisablehook = _interrupt_again
    try:
        signal.signal(signal.SIGINT, interrupt)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        outcome = None if _interrupted.is_set() else call()
        # Modules in C that are interrupted while they are imported raise an ImportError instead
        failed = outcome is not None and outcome.error is not None
        return index, None if failed and _interrupted.is_set() else outcome
    except KeyboardInterrupt:
        _interrupted.set()
        return index, None
    finally:
        signal.signal(signal.SIGINT, lambda number, frame: _interrupted.set())


def _interrupt_again(swallowed: Any) -> None:
    """Interrupt this worker once more where it was in a callback, as one of weakref, which cannot raise."""
    if swallowed.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(swallowed)
        return
    again = threading.Timer(_AGAIN_S, os.kill, (os.getpid(), signal.SIGINT))
    again.daemon = True
    again.start()


def _stop_with_driver() -> None:
    """Interrupt this worker once its driver was killed, so that it saves its state and releases its locks."""
    if (driver := multiprocessing.parent_process()) is not None:
        driver.join()
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(GRACE_S)
    os._exit(1)


def _on_ray(calls: _Calls, workers: Workers) -> _Outcomes:
    """Run calls on a Ray cluster, one CPU each; Ray itself repeats those whose worker is lost."""
    import ray

    is_ours = not ray.is_initialized()
    if is_ours:
        _join_cluster(workers.address or os.environ.get("RAY_ADDRESS"), workers.n_jobs)
    remote = ray.remote(num_cpus=1, max_retries=TRIES - 1)(_run)
    running: dict[ray.ObjectRef[Any], int] = {}
    try:
        while True:
            for index, call in islice(calls, workers.n_jobs - len(running)):
                running[remote.remote(call)] = index
            if not running:
                return
            (ready, *_), _ = ray.wait(list(running))
            index = running.pop(ready)
            try:
                outcome = ray.get(ready)
            except ray.exceptions.RayError as error:
                outcome = Outcome(error=f"its worker was lost {TRIES} times ({type(error).__name__})")
            yield index, outcome
    finally:
        for reference in running:
            ray.cancel(reference)
        if running:
            ray.wait(list(running), num_returns=len(running), timeout=GRACE_S)
        if is_ours:
            ray.shutdown()


def _run(call: _Call) -> Outcome:
    return call()


def _join_cluster(address: str | None, n_jobs: int) -> None:
    """Join a cluster, or start one on this machine."""
    import ray

    if address is None:
        with _ray_errors("Ray on this machine"):
            ray.init(address="local", num_cpus=n_jobs, include_dashboard=False, logging_level=logging.ERROR)
        return
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit():
        raise UserError(f"address: expected host:port of a Ray cluster, got {address!r}")
    try:  # Ray itself would wait for minutes
        socket.create_connection((host, int(port)), timeout=_CONNECT_S).close()
    except OSError as error:
        raise UserError(
            f"address: no Ray cluster answers at {address}; is it started there (ray start --head)?"
        ) from error
    with _ray_errors(f"Ray cluster {address}"):
        ray.init(address=address, logging_level=logging.ERROR)


@contextlib.contextmanager
def _ray_errors(what: str) -> Iterator[None]:
    """Turn what Ray raises where it does not start into a UserError: another version, or a full disk."""
    try:
        yield
    except (OSError, RuntimeError, ValueError) as error:
        raise UserError(f"{what}: {one_line(error)}") from error


class StopRequest:
    """Context manager that turns Ctrl-C and SIGTERM into a request to stop at the next safe point.

    Raised at once, an interrupt could cut off a write to a file or database, or get lost in compiled code.
    The second signal is raised at once nevertheless. Nothing is changed outside the main thread, nor for
    signals that are ignored.

    Args:
        notice: text for standard error when the first signal arrives.
        is_deferred: False raises the first signal at once, too, until this attribute is set.
    """

    def __init__(self, notice: str = "", is_deferred: bool = True) -> None:
        self.is_deferred = is_deferred
        self._notice = notice.encode()
        self._number: int | None = None
        self._handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}

    def __enter__(self) -> StopRequest:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                handler = signal.getsignal(number)
                if callable(handler):
                    self._handlers[number] = handler
                    signal.signal(number, self._receive)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _receive(self, number: int, frame: FrameType | None) -> None:
        is_first, self._number = self._number is None, number
        if is_first and self.is_deferred:
            os.write(2, self._notice)
        else:
            self._handlers[number](number, frame)

    @property
    def is_set(self) -> bool:
        """True once a signal has arrived."""
        return self._number is not None

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal has arrived."""
        if self._number is not None:
            self._handlers[self._number](self._number, None)
            raise KeyboardInterrupt
