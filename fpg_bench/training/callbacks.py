"""SB3 callbacks of a training run: game measures, progress, evaluation and checkpoints."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from fpg_bench.common.output import shown_progress
from fpg_bench.common.parallel import StopRequest
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.policy_evaluator import PolicyEvaluator
from fpg_bench.training.checkpoint import save_checkpoint
from fpg_bench.training.export import exported_player
from fpg_bench.training.models import by_side

# What TensorBoard plots of a round; ``evaluations.jsonl`` has all measures.
PLOTTED = (
    *("overlap_ratio", "jamming_success_rate", "outage", "detection_rate", "hop_rate", "spread_ratio"),
    *("capacity_mbit_s", "ally_return", "opponent_return"),
)
SAVE_EVERY_S = 60.0


class GameMeasuresCallback(BaseCallback):
    """Log the means of the game's measures over the last rounds, as ``game/...`` beside SB3's curves.

    Args:
        interval: rollouts from one log to the next.
    """

    def __init__(self, interval: int = 1) -> None:
        super().__init__()
        self._interval, self._rollouts = interval, 0

    def _on_rollout_start(self) -> None:
        self._rollouts += 1
        if self._rollouts % self._interval:
            return
        infos = self.model.ep_info_buffer or ()
        for name in PLOTTED:
            if known := [info[name] for info in infos if name in info]:
                self.logger.record(f"game/{name}", float(np.mean(known)))

    def _on_step(self) -> bool:
        return True


def score_tag(side: str, name: str, sides: Sequence[str]) -> str:
    """Return the tag of a side's score or measure on its suite; TensorBoard shows ``eval`` first."""
    return f"eval/{name}" if len(sides) == 1 else f"eval/{side}_{name}"


class ProgressCallback(BaseCallback):
    """Shows steps, rate and the mean return of the last rounds, as :func:`shown_progress` does.

    Args:
        total: the budget in steps.
        name: of one of several runs; it draws no bar.
    """

    def __init__(self, total: int, name: str = "") -> None:
        super().__init__()
        self._total, self._name = total, name
        self._held = contextlib.ExitStack()

    def _on_training_start(self) -> None:
        self._first, self._start = self.num_timesteps, time.monotonic()
        self._show = self._held.enter_context(shown_progress(draws=not self._name))

    def _on_rollout_end(self) -> None:
        rate = (self.num_timesteps - self._first) / (time.monotonic() - self._start)
        what = f"{self._name or 'training'}, {rate:,.0f} steps/s"
        if self.model.ep_info_buffer:
            (side,) = self.training_env.get_attr("side", 0)
            mean_return = np.mean([info["r"] for info in self.model.ep_info_buffer])
            what += f", {side}'s return {mean_return:,.0f} (sampled actions)"
        self._show(what, self.num_timesteps, self._total)

    def _on_step(self) -> bool:
        return True

    def close(self) -> None:
        """Remove the bar, also after an error."""
        self._held.close()


class Clock:
    """Stopwatch of the training time over all parts of a run, without evaluations.

    Args:
        before: seconds of the earlier parts.
    """

    def __init__(self, before: float = 0.0) -> None:
        self._start = time.monotonic() - before

    @property
    def seconds(self) -> float:
        """Training time so far in seconds."""
        return time.monotonic() - self._start

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Exclude the time within the context."""
        begin = time.monotonic()
        yield
        self._start += time.monotonic() - begin


class EvalCheckpointCallback(BaseCallback):
    """Evaluate the policy at equal intervals of the budget; save a checkpoint then, and every minute.

    Both happen at the start of a rollout. By then, all collected data has been used for updates, so a resumed
    run neither loses nor repeats any.

    Args:
        folder: the run's folder of checkpoints.
        clock: counts the training time.
        evaluators: evaluator of each learning side; empty for no evaluations.
        file: file that the scores are appended to.
        budget: steps of the run.
        n_evals: number of evaluations, besides the one at the start.
        stop: request to save and stop the run.
    """

    def __init__(
        self,
        folder: Path,
        clock: Clock,
        evaluators: Mapping[str, PolicyEvaluator],
        file: RowFile,
        budget: int,
        n_evals: int,
        stop: StopRequest,
    ) -> None:
        super().__init__()
        self._folder, self._clock, self._evaluators, self._file = folder, clock, evaluators, file
        self._eval_freq = budget / max(n_evals, 1)
        rows = file.read()
        self._last_eval = rows[-1]["steps"] if rows else -1
        self._last_save = time.monotonic()
        self._stop = stop

    def _on_rollout_start(self) -> None:
        is_due = bool(self._evaluators) and self.num_timesteps >= self._next_eval
        if is_due:
            self._evaluate()
        if is_due or self._stop.is_set or time.monotonic() - self._last_save > SAVE_EVERY_S:
            self._save()
        if self._stop.is_set:
            raise KeyboardInterrupt(f"saved at {self.model.num_timesteps:,} steps")

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        if self._evaluators and self.num_timesteps > self._last_eval:
            self._evaluate()
        self._save()

    @property
    def _next_eval(self) -> float:
        """Number of steps at the next evaluation: the first interval of the budget that has no row yet."""
        return 0 if self._last_eval < 0 else (self._last_eval // self._eval_freq + 1) * self._eval_freq

    def _evaluate(self) -> None:
        seconds = round(self._clock.seconds, 2)
        with self._clock.paused():
            results = {
                side: self._evaluators[side].score(exported_player(player))
                for side, player in by_side(self.model, tuple(self._evaluators)).items()
            }
        head = {"steps": self.num_timesteps, "seconds": seconds}
        self._file.append([head | {"side": side} | result for side, result in results.items()])
        self._last_eval = self.num_timesteps
        for side, result in results.items():
            for name, value in ({"score": result["score"]} | result["measures"]).items():
                if value is not None and name in ("score", *PLOTTED):
                    self.logger.record(score_tag(side, name, list(results)), value)
        self.logger.dump(self.num_timesteps)  # no rollout may follow

    def _save(self) -> None:
        save_checkpoint(self.model, self._folder, seconds=self._clock.seconds)
        self._last_save = time.monotonic()
