"""What is watched while SB3 trains: the game's measures in TensorBoard, and a progress bar."""

from __future__ import annotations

import sys
import time

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from stable_baselines3.common.callbacks import BaseCallback

from fpg_bench.jobs.run import LINE_EVERY_S

WATCHED = (
    "overlap_ratio",
    "jamming_success_rate",
    "outage",
    "snr_db",
    "capacity_mbit_s",
    "hop_rate",
    "spread_ratio",
    "near_ratio",
    "ally_return",
    "opponent_return",
)


class GameMeasures(BaseCallback):
    """Logs the means of the game's measures over the last rounds, as ``game/...`` beside SB3's curves."""

    def _on_rollout_start(self) -> None:
        rounds = self.model.ep_info_buffer
        for name in WATCHED if rounds else ():
            values = [info[name] for info in rounds if info.get(name) is not None]  # type: ignore[union-attr]
            if values:
                self.logger.record(f"game/{name}", float(np.mean(values)))

    def _on_step(self) -> bool:
        return True


class TrainingBar(BaseCallback):
    """A bar with steps, rate, time left and the last rounds' mean return.

    Where none can be drawn, a line is printed for each tenth of the budget, and 30 s after the last one.
    """

    def __init__(self, total: int) -> None:
        super().__init__()
        self._total = total
        self._lines = 0  # tenths of the budget that a line was printed for
        self._progress = Progress(
            TextColumn("training"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[said]}"),
            TimeRemainingColumn(),
            disable=not sys.stdout.isatty(),
        )

    def _on_training_start(self) -> None:
        self._first, self._start = self.num_timesteps, time.monotonic()
        self._printed = self._start
        self._lines = 10 * self._first // self._total
        self._task = self._progress.add_task("", total=self._total, completed=self._first, said="")
        self._progress.start()

    def _on_step(self) -> bool:
        self._progress.update(self._task, completed=self.num_timesteps)
        if time.monotonic() - self._printed >= LINE_EVERY_S:
            self._print()
        return True

    def _on_rollout_end(self) -> None:
        self._progress.update(self._task, said=self._said())
        tenth = 10 * self.num_timesteps // self._total
        if tenth > self._lines:
            self._lines = tenth
            self._print()

    def _said(self) -> str:
        """The rate, and the last rounds' mean return."""
        rate = (self.num_timesteps - self._first) / (time.monotonic() - self._start)
        said = f"{rate:,.0f} steps/s"
        if self.model.ep_info_buffer:
            (side,) = self.training_env.get_attr("side", 0)
            said += f", {side}'s return {np.mean([info['r'] for info in self.model.ep_info_buffer]):,.0f}"
        return said

    def _print(self) -> None:
        """Print how far it is, where no bar is drawn."""
        self._printed = time.monotonic()
        if self._progress.disable:
            done = f"{self.num_timesteps:,} of {self._total:,} steps"
            print(f"training: {done}, {self._said()}", flush=True)

    def close(self) -> None:
        """Stop drawing, however training ended."""
        self._progress.stop()
