"""What is watched while SB3 trains: the game's measures in TensorBoard, and a progress bar."""

from __future__ import annotations

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from stable_baselines3.common.callbacks import BaseCallback

WATCHED = ("overlap_ratio", "jamming_success_rate", "snr_db", "hop_rate", "spread_ratio", "near_ratio")


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
    """A bar with steps, steps per second, time left and the mean return of the last rounds."""

    def __init__(self, total: int) -> None:
        super().__init__()
        self._total = total
        self._progress = Progress(
            TextColumn("training"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]} steps/s"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[mean]}"),
        )

    def _on_training_start(self) -> None:
        self._first = self.num_timesteps
        self._task = self._progress.add_task("", total=self._total, rate="-", mean="")
        self._progress.start()

    def _on_step(self) -> bool:
        task = self._progress.tasks[0]
        rate = (self.num_timesteps - self._first) / task.elapsed if task.elapsed else 0
        self._progress.update(self._task, completed=self.num_timesteps, rate=f"{rate:,.0f}")
        return True

    def _on_rollout_end(self) -> None:
        if self.model.ep_info_buffer:
            mean = np.mean([info["r"] for info in self.model.ep_info_buffer])
            self._progress.update(self._task, mean=f"return {mean:,.0f}")

    def close(self) -> None:
        """Stop drawing, however training ended."""
        self._progress.stop()
