"""A Ray cluster: of many machines by its address, else of this one."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from fpg_bench.common.errors import UserError
from fpg_bench.common.extras import need
from fpg_bench.jobs.job import Outcome

_ANSWER_S = 5.0
_NO_CPU_S = 60.0


class RayPool:
    """The machines of a Ray cluster; each call takes one of their CPUs.

    Args:
        address: ``host:port``; None: that in the environment's ``RAY_ADDRESS``, else one is started here.
        workers: how many CPUs a cluster has that is started here.

    Raises:
        UserError: Ray is not installed, or no cluster answers.
    """

    def __init__(self, address: str | None, workers: int) -> None:
        need("ray", "ray", "grpc")
        import ray

        self._ray = ray
        self._joined = not ray.is_initialized()
        if self._joined:
            _join(ray, address or os.environ.get("RAY_ADDRESS"), workers)
        # Ray's own retries would neither be counted nor told of.
        self._call = ray.remote(num_cpus=1, max_retries=0)(_run)
        self._busy: dict[Any, Any] = {}
        self._alive_s = time.monotonic()

    def submit(self, call: Callable[[], Outcome]) -> Future[Outcome]:
        """Queue a call for the next CPU that is free."""
        found = self._call.remote(call)
        future: Future[Outcome] = found.future()
        self._busy[future] = found
        return future

    def check(self) -> None:
        """Raise UserError where no machine with a CPU has been left for a while."""
        if self._ray.cluster_resources().get("CPU"):
            self._alive_s = time.monotonic()
        elif time.monotonic() - self._alive_s > _NO_CPU_S:
            raise UserError(
                "the Ray cluster has no machine with a CPU left; what was finished is kept, run this again"
            )

    def release(self, future: Future[Outcome]) -> None:
        """Let the cluster forget what a call returned."""
        del self._busy[future]

    def interrupt(self) -> None:
        """Raise KeyboardInterrupt in all calls that run; those that wait are dropped."""
        for found in self._busy.values():
            self._ray.cancel(found)

    def close(self) -> None:
        """End what still runs, and leave the cluster; one that was started here goes down."""
        for found in self._busy.values():
            self._ray.cancel(found, force=True)
        if self._joined:
            self._ray.shutdown()


def _run(call: Callable[[], Outcome]) -> Outcome:
    return call()


def _join(ray: Any, address: str | None, workers: int) -> None:
    """Join a cluster, or start one."""
    quiet = {"logging_level": "ERROR"}
    if address is None:
        ray.init(address="local", num_cpus=workers, include_dashboard=False, **quiet)
        return
    _check_answers(address)
    try:
        ray.init(address=address, **quiet)
    except (ConnectionError, RuntimeError, ValueError) as error:  # another version of Ray, most of all
        raise UserError(f"Ray cluster {address}: {' '.join(str(error).split())}") from error


def _check_answers(address: str) -> None:
    """Raise UserError unless a server of Ray's kind is there; Ray itself would wait for minutes and exit."""
    import grpc

    host, _, port = address.rpartition(":")
    if not host or not port.isdigit():
        raise UserError(f"address: expected host:port of a Ray cluster, got {address!r}")
    with grpc.insecure_channel(address, options=[("grpc.enable_http_proxy", 0)]) as channel:
        try:
            grpc.channel_ready_future(channel).result(timeout=_ANSWER_S)
        except grpc.FutureTimeoutError as error:
            raise UserError(
                f"address: no Ray cluster answers at {address}; is it started there (ray start --head)?"
            ) from error
