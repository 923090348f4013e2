"""One trial: train with its values over several seeds, and score what was trained on tuning seeds."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from fpg_bench.common.ids import sides_of
from fpg_bench.envs.sb3_vec_env import FPGVecEnv
from fpg_bench.evaluation.policy_evaluator import PolicyEvaluator
from fpg_bench.evaluation.seeds import training_seed
from fpg_bench.evaluation.statistics import MATCHES, TRAINING_SEEDS, Interval, mean_interval
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.training.actor import ActorPlayer
from fpg_bench.training.export import export_onnx
from fpg_bench.training.hyperparameters import Hyperparameters, load_hyperparameters
from fpg_bench.training.models import make_games, make_model, tells_divergence
from fpg_bench.training.tuning.space import merged
from fpg_bench.training.tuning.task import Task
from fpg_bench.training.tuning.worker import Report

PARTS = 4  # of a seed's budget: how often a policy is looked at while it is trained


class Diverged(ArithmeticError):
    """Training came to numbers that are none."""


class Objective:
    """What a study maximises: the mean score over a suite's rivals and the training seeds.

    Args:
        task: what is tuned.
    """

    def __init__(self, task: Task) -> None:
        torch.set_num_threads(1)
        self._task = task
        with contextlib.closing(self._games(task.hyperparameters, task.first_seed)[0]) as games:
            self._evaluator = PolicyEvaluator(task.suite, task.rounds, games.core.scenario)

    def check(self, values: dict[str, Any]) -> None:
        """Raise UserError where the algorithm does not know a value's name."""
        self._model(values, self._task.first_seed).get_env().close()  # type: ignore[union-attr]

    def __call__(self, values: dict[str, Any], seeds: list[int], report: Report) -> Interval:
        """Train with these values and score the policies.

        Args:
            values: of the hyper-parameters that are searched, by name.
            seeds: the training seeds, one after the other.
            report: told the score so far and the steps so far (in parts of a seed's budget); may raise.

        Returns:
            The score with its interval over training seeds.

        Raises:
            Diverged: training came to numbers that are none.
            UserError: a value that the algorithm does not take.
        """
        found: list[np.ndarray] = []
        for index, seed in enumerate(seeds):

            def look(part: int, scores: np.ndarray, before: int = index * PARTS) -> None:
                report(_mean([*found, scores]), before + part)

            found.append(self._trained(values, seed, look))
            if index + 1 < len(seeds):
                report(_mean(found), (index + 1) * PARTS)
        return interval_of(found)

    def _trained(
        self, values: dict[str, Any], seed: int, look: Callable[[int, np.ndarray], None]
    ) -> np.ndarray:
        """The scores ``(rivals, matches)`` of the policy that one seed leads to."""
        model = self._model(values, seed)
        try:
            n_evals = _Looks(self._task.steps, lambda part: look(part, self._scores(ActorPlayer(model))))
            model.learn(self._task.steps, callback=n_evals)
            return self._scores(OnnxPlayer(export_onnx(model), {"algorithm": self._task.algorithm}))
        except ValueError as error:
            if tells_divergence(error, sides_of(self._task.env_id)):
                raise Diverged("training came to numbers that are none") from error
            raise
        finally:
            model.get_env().close()  # type: ignore[union-attr]

    def _scores(self, player: Any) -> np.ndarray:
        scores = self._evaluator.scores(player)
        if not np.isfinite(scores).all():
            raise Diverged("the policy's score is no number")
        return scores

    def _model(self, values: dict[str, Any], seed: int) -> BaseAlgorithm:
        games, parameters = self._games(merged(self._task.hyperparameters, values), seed)
        return make_model(self._task.algorithm, games, parameters, seed)

    def _games(self, wanted: dict[str, Any], seed: int) -> tuple[FPGVecEnv, Hyperparameters]:
        task = self._task
        parameters = load_hyperparameters(task.algorithm, task.env_id, wanted)
        return make_games(task.env_id, parameters, training_seed(seed), **task.options), parameters


class _Looks(BaseCallback):
    """Has the policy looked at when a part of the budget is over, between two updates."""

    def __init__(self, steps: int, look: Callable[[int], None]) -> None:
        super().__init__()
        self._steps, self._look = steps, look
        self._part = 0

    def _on_rollout_start(self) -> None:
        part = PARTS * self.num_timesteps // self._steps
        if self._part < part < PARTS:
            self._part = part
            self._look(part)

    def _on_step(self) -> bool:
        return True


def _mean(found: list[np.ndarray]) -> float:
    """The mean over training seeds of the score."""
    return float(np.mean([scores.mean() for scores in found]))


def interval_of(found: list[np.ndarray]) -> Interval:
    """The score of training seeds, ``(rivals, matches)`` each; of a single one over its matches."""
    if len(found) == 1:
        return mean_interval(found[0].mean(axis=0), MATCHES)
    return mean_interval(np.array([scores.mean() for scores in found]), TRAINING_SEEDS)
