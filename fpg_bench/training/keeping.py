"""What a training run keeps on its way: how good it was when, and checkpoints to go on from."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from fpg_bench.evaluation.yardstick import Yardstick
from fpg_bench.rows import RowFile
from fpg_bench.training.actor import ActorPlayer
from fpg_bench.training.checkpoints import save_checkpoint
from fpg_bench.training.models import by_side

SAVE_EVERY_S = 60.0
_STOPPING = b"stopping as soon as the run can be saved; Ctrl-C again stops at once\n"


class Clock:
    """Seconds of training, over all parts of a run, without those spent on looking how good it is.

    Args:
        before: seconds of the parts before this one.
    """

    def __init__(self, before: float = 0.0) -> None:
        self._start = time.monotonic() - before

    @property
    def seconds(self) -> float:
        """Up to now."""
        return time.monotonic() - self._start

    @contextlib.contextmanager
    def stopped(self) -> Iterator[None]:
        """Count nothing meanwhile."""
        begin = time.monotonic()
        yield
        self._start += time.monotonic() - begin


class EvalCheckpointCallback(BaseCallback):
    """Scores the present policy at even parts of the budget, and saves a checkpoint then and every minute.

    Both happen where SB3 begins to collect: all that was collected before is learned from, so that nothing
    is lost or counted twice when the run goes on from there.

    Args:
        folder: the run's folder of checkpoints.
        clock: counts the training time.
        yardsticks: what scores the policy of each side that learns; none: nothing does.
        file: where the scores go.
        budget: the run's steps.
        looks: how many times to score on the way.
        stop: set where the run is to be saved and stopped.
    """

    def __init__(
        self,
        folder: Path,
        clock: Clock,
        yardsticks: Mapping[str, Yardstick],
        file: RowFile,
        budget: int,
        looks: int,
        stop: threading.Event,
    ) -> None:
        super().__init__()
        self._folder, self._clock, self._yardsticks, self._file = folder, clock, yardsticks, file
        self._every = budget / max(looks, 1)
        rows = file.read()
        self._last = rows[-1]["steps"] if rows else -1
        self._saved = time.monotonic()
        self._stop = stop

    def _on_rollout_start(self) -> None:
        looked = bool(self._yardsticks) and self.num_timesteps >= self._due
        if looked:
            self._look()
        if looked or self._stop.is_set() or time.monotonic() - self._saved > SAVE_EVERY_S:
            self._save()
        if self._stop.is_set():
            raise KeyboardInterrupt(f"saved at {self.model.num_timesteps:,} steps")

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        if self._yardsticks and self.num_timesteps > self._last:
            self._look()
        self._save()

    @property
    def _due(self) -> float:
        """The steps of the next look: the first even part of the budget that has no row yet."""
        return 0 if self._last < 0 else (self._last // self._every + 1) * self._every

    def _look(self) -> None:
        seconds = round(self._clock.seconds, 2)
        with self._clock.stopped():
            found: dict[str, Any] = {
                side: self._yardsticks[side].score(ActorPlayer(player))
                for side, player in by_side(self.model, tuple(self._yardsticks)).items()
            }
        head = {"steps": self.num_timesteps, "seconds": seconds}
        self._file.append([head | {"side": side} | scores for side, scores in found.items()])
        self._last = self.num_timesteps
        for side, scores in found.items():
            self.logger.record("field/score" if len(found) == 1 else f"field/{side}_score", scores["score"])

    def _save(self) -> None:
        save_checkpoint(self.model, self._folder, seconds=self._clock.seconds)
        self._saved = time.monotonic()


@contextlib.contextmanager
def stopped_by_ctrl_c() -> Iterator[threading.Event]:
    """An event that the first Ctrl-C sets; the second interrupts at once.

    Elsewhere than in the main thread, and where the caller hears or ignores Ctrl-C, nothing is changed.
    """
    stop = threading.Event()
    usual = signal.default_int_handler
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGINT) is not usual:
        yield stop
        return

    def hear(*_: Any) -> None:
        stop.set()
        os.write(2, _STOPPING)
        signal.signal(signal.SIGINT, usual)

    signal.signal(signal.SIGINT, hear)
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, usual)
