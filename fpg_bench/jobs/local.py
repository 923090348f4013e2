"""Processes of this machine, by joblib's loky: what they run needs no importable main module."""

from __future__ import annotations

import atexit
import contextlib
import gc
import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

# A private door, opened here alone: joblib's own pool tells nobody whose worker died.
from joblib.externals.loky import ProcessPoolExecutor
from joblib.externals.loky.process_executor import BrokenProcessPool

from fpg_bench.jobs.job import Outcome

_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
_ORPHAN_S = 30.0
_FEEDER_S = 5.0


class LocalPool:
    """Worker processes, each in a pool of its own: one that is killed takes nothing but its own job along."""

    def __init__(self) -> None:
        self._idle: list[Any] = []
        self._busy: dict[Any, tuple[Any, int]] = {}

    def submit(self, call: Callable[[], Outcome]) -> Future[Outcome]:
        """Begin a call in an idle worker, else in a new one."""
        process, number = self._ready()
        future: Future[Outcome] = process.submit(call)
        self._busy[future] = process, number
        return future

    def check(self) -> None:
        """There is always another process to be had."""

    def release(self, future: Future[Outcome]) -> None:
        """Take the worker of a call back; one that was lost is let go."""
        process, _ = self._busy.pop(future)
        if future.exception() is None:
            self._idle.append(process)
        else:
            process.shutdown(kill_workers=True)

    def interrupt(self) -> None:
        """Send SIGINT to all that work."""
        for future, (_, number) in self._busy.items():
            if not future.done():
                with contextlib.suppress(ProcessLookupError):
                    os.kill(number, signal.SIGINT)

    def close(self) -> None:
        """Let the idle workers end, and kill the others.

        The last to hold a pool's semaphore may be the thread that feeds its queue. An interpreter that ends
        does not wait for it, and loky's tracker would warn below the command's last line.
        """
        for process, _ in self._busy.values():
            process.shutdown(kill_workers=True)
        for process in self._idle:
            process.shutdown()
        for thread in threading.enumerate():
            if thread.name == "QueueFeederThread":
                thread.join(_FEEDER_S)

    def _ready(self) -> tuple[Any, int]:
        """A worker that waits for a call, and its process id."""
        while self._idle:
            process = self._idle.pop()
            with contextlib.suppress(BrokenProcessPool):  # killed while it waited
                return process, process.submit(_begin, os.getpid()).result()
        process = ProcessPoolExecutor(1, env=_ONE_THREAD)
        return process, process.submit(_begin, os.getpid()).result()


def _begin(driver: int) -> int:
    """Prepare the worker for a job; gives its process id.

    It leaves the terminal's process group, so that Ctrl-C comes to it once, from the driver, and hears Ctrl-C
    also where a shell in the background has it ignored.
    """
    if os.getpgrp() != os.getpid():
        atexit.register(gc.freeze)  # as commands do
        os.setpgrp()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        threading.Thread(target=_end_with, args=(driver,), daemon=True).start()
    return os.getpid()


def _end_with(driver: int) -> None:
    """Stop where the driver was killed outright: what can save itself does, and nothing stays locked."""
    while os.getppid() == driver:
        time.sleep(1)
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(_ORPHAN_S)
    os._exit(1)
