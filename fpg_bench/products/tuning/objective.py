"""The objective of a study: train with a trial's values over several seeds, and score the policies."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Sequence

import numpy as np
import optuna
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from fpg_bench.common.errors import UserError
from fpg_bench.common.imports import reason
from fpg_bench.envs.sb3_vec_env import make_sb3
from fpg_bench.evaluation.policy_evaluator import PolicyEvaluator
from fpg_bench.evaluation.seeds import training_seed
from fpg_bench.evaluation.statistics import TRAINING_SEEDS, Interval, mean_interval
from fpg_bench.players.player import Player
from fpg_bench.products.tuning.space import format_values, merge_values, suggest
from fpg_bench.products.tuning.study import N_EVALS, Task
from fpg_bench.training.export import exported_player
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import by_side, make_model, tells_divergence
from fpg_bench.training.rl_zoo3_format import Entry

FAILURES = (ArithmeticError, RuntimeError, ValueError)  # of a trial with unsuitable values

_logger = logging.getLogger(__name__)
Report = Callable[[float, int], None]


class Diverged(ArithmeticError):
    """Training diverged to NaN or infinity."""


class Objective:
    """The score of a trial: the mean over a suite's rivals and the training seeds.

    Args:
        task: what is tuned.
        check_stop: called in each training step; raises KeyboardInterrupt to end the trial.
        allow: the code and agents of the Hub that the study's game and the suite's file may name.

    Raises:
        UserError: the search space names something that the algorithm does not have.
    """

    def __init__(
        self, task: Task, check_stop: Callable[[], None] = lambda: None, allow: Collection[str] = ()
    ) -> None:
        torch.set_num_threads(1)
        self._task, self._check_stop, self._allow = task, check_stop, allow
        self._sides = task.game.sides
        first = {name: values.first() for name, values in task.space.items()}
        games = self._model(first, task.seeds[0]).get_env()
        scenario = games.unwrapped.core.scenario  # type: ignore[union-attr]
        self._evaluator = PolicyEvaluator(task.suite, task.rounds, scenario, allow=allow)
        games.close()  # type: ignore[union-attr]

    def __call__(self, trial: optuna.Trial) -> float:
        """Run a trial; a training that diverges or fails is pruned and has the user attribute ``error``."""
        self._check_stop()
        values = suggest(self._task.space, trial)
        _logger.info("trial %d: %s", trial.number, format_values(values))

        def report(score: float, step: int) -> None:
            trial.report(score, step)
            if trial.should_prune():
                raise optuna.TrialPruned

        try:
            score = self.train(values, self._task.seeds, report)
        except (UserError, optuna.exceptions.OptunaError):
            raise
        except FAILURES as error:
            trial.set_user_attr("error", reason(error)[:200])
            raise optuna.TrialPruned from error
        if math.isfinite(score.half):
            trial.set_user_attr("interval", [score.low, score.high, score.over])
        return score.value

    def train(
        self, values: Entry, seeds: Sequence[int], report: Report = lambda score, step: None
    ) -> Interval:
        """Train with these values and score the policies.

        Args:
            values: values of the tuned hyper-parameters, by name.
            seeds: the training seeds, one after the other.
            report: called with the score so far and the number of evaluations so far; may raise to stop.

        Returns:
            The score with its interval over training seeds; NaN for a single one.

        Raises:
            Diverged: training diverged.
            UserError: a value that the algorithm does not accept.
        """
        scores: list[np.ndarray] = []
        for index, seed in enumerate(seeds):

            def evaluate(part: int, present: np.ndarray, before: int = index * N_EVALS) -> None:
                report(_mean([*scores, present]), before + part)

            scores.append(self._train_seed(values, seed, evaluate))
            if index + 1 < len(seeds):
                report(_mean(scores), (index + 1) * N_EVALS)
        return mean_interval(np.mean(scores, axis=(1, 2)), TRAINING_SEEDS)

    def _train_seed(
        self, values: Entry, seed: int, evaluate: Callable[[int, np.ndarray], None]
    ) -> np.ndarray:
        """Return the scores ``(rivals, matches)`` of the policy of one training seed."""
        model = self._model(values, seed)
        scored = by_side(model, self._sides)[self._evaluator.suite.side]
        try:
            callback = _TrialCallback(
                self._task.steps,
                lambda part: evaluate(part, self._scores(exported_player(scored))),
                self._check_stop,
            )
            model.learn(self._task.steps, callback=callback)
            return self._scores(exported_player(scored))
        except ValueError as error:
            if tells_divergence(error, self._sides):
                raise Diverged("training diverged to NaN or infinity") from error
            raise
        finally:
            model.get_env().close()  # type: ignore[union-attr]

    def _scores(self, player: Player) -> np.ndarray:
        scores = self._evaluator.scores(player)
        if not np.isfinite(scores).all():
            raise Diverged("the policy's score is not a number")
        return scores

    def _model(self, values: Entry, seed: int) -> BaseAlgorithm:
        task = self._task
        entry = merge_values(task.hyperparameters, values)
        parameters = load_hyperparameters(task.algorithm, task.game, entry)
        games = make_sb3(task.game, parameters.n_envs, training_seed(seed), stagger=True, allow=self._allow)
        return make_model(task.algorithm, games, parameters, seed)


class _TrialCallback(BaseCallback):
    """Evaluate the policy after each quarter of the budget, between two updates."""

    def __init__(self, steps: int, evaluate: Callable[[int], None], check_stop: Callable[[], None]) -> None:
        super().__init__()
        self._steps, self._evaluate, self._check_stop = steps, evaluate, check_stop
        self._part = 0

    def _on_rollout_start(self) -> None:
        part = N_EVALS * self.num_timesteps // self._steps
        if self._part < part < N_EVALS:
            self._part = part
            self._evaluate(part)

    def _on_step(self) -> bool:
        self._check_stop()
        return True


def _mean(scores: list[np.ndarray]) -> float:
    """Return the mean over training seeds of the score."""
    return float(np.mean([matches.mean() for matches in scores]))
