"""The paper's experiment: both sides learn by MADDPG under a condition (Algorithm 1, Table 3)."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import configure

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.extras import require_extra
from fpg_bench.common.ids import DUEL
from fpg_bench.envs.core import JointGame
from fpg_bench.envs.sb3_vec_env import FPGVecEnv
from fpg_bench.evaluation.seeds import evaluation_seeds, training_seed
from fpg_bench.game.actions import KNOWLEDGE_GATE
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.player import SIDES
from fpg_bench.products.language_models.training import training_planner
from fpg_bench.products.papers.reproduction import versions
from fpg_bench.products.papers.yang_2026.conditions import Condition, swapped
from fpg_bench.products.papers.yang_2026.runs import FINAL, PaperRun, RunAbout, window_row, windows_of
from fpg_bench.training.hyperparameters import Hyperparameters, load_hyperparameters
from fpg_bench.training.models import make_model

LEARNERS = ("torch", "jax")


class Recorded(JointGame):
    """N games that record their rounds; the ally always hops by the knowledge base (Algorithm 1, line 6).

    Args:
        games: number of games, N.
        **options: of the game, attributes of :class:`fpg_bench.game.spec.GameSpec`.

    Attributes:
        played: number of steps, over all games.
        rounds: for each finished round ``played`` at its end, its record of dtype ``state.TALLY``, and its
            histogram ``(2, points)``.
    """

    def __init__(self, games: int = 1, **options: Any) -> None:
        super().__init__(GameSpec.of(DUEL, **options), games)
        self.played = 0
        self.rounds: list[tuple[int, np.void, np.ndarray]] = []

    def step(self, actions: np.ndarray) -> None:
        """Play one step with ``(N, 18)`` actions."""
        actions = actions.copy()
        actions[:, KNOWLEDGE_GATE] = 1
        super().step(actions)
        self.played += self.count

    def reset(
        self,
        mask: np.ndarray | None = None,
        seeds: Any = None,
        new_match: bool = False,
        horizons: np.ndarray | None = None,
    ) -> None:
        """Record finished rounds, and start new ones."""
        over = self.truncated if mask is None else self.truncated & mask
        batch = self.duel.batch
        for game in np.flatnonzero(over).tolist():
            self.rounds.append((self.played, batch.tallies[game].copy(), batch.histograms[game].copy()))
        super().reset(mask, seeds, new_match, horizons)


ALGORITHM = "maddpg"
_POSITIONS = 50  # per drawn path


@dataclass(frozen=True)
class Budget:
    """Length of a training.

    Attributes:
        name: name in file names.
        steps: game steps, over all games.
        games: number of parallel games.
        train_freq, gradient_steps: ``gradient_steps`` updates follow ``train_freq`` steps of all games.
        seeds: default number of runs of each condition that a claim rests on.
    """

    name: str
    steps: int
    games: int
    train_freq: int
    gradient_steps: int
    seeds: int

    def updates(self) -> int:
        """Return the approximate number of updates of a run."""
        return self.steps // self.games // self.train_freq * self.gradient_steps


BUDGETS: Mapping[str, Budget] = MappingProxyType(
    {
        "quick": Budget("quick", 192_000, 64, 15, 15, 2),  # 3 * 10^3 updates
        "full": Budget("full", 1_000_000, 64, 5, 16, 10),  # 5 * 10^4 updates
        "hundredth": Budget("hundredth", 1_000_000, 64, 5, 32, 10),  # 10^5 updates
        # An update after each step, as in Algorithm 1, and a tenth of the paper's steps or all of them.
        "tenth": Budget("tenth", 1_000_000, 64, 1, 64, 10),
        "paper": Budget("paper", 10_000_000, 64, 1, 64, 3),
    }
)


def hyperparameters(budget: Budget) -> Hyperparameters:
    """Return the hyper-parameters of Table 3, completed with the shipped values."""
    shipped = load_hyperparameters(ALGORITHM, DUEL)
    rates = {"train_freq": budget.train_freq, "gradient_steps": budget.gradient_steps}
    return shipped.model_copy(update={"n_envs": budget.games, **rates})


def run_experiment(
    condition: Condition,
    preset: str,
    budget: Budget,
    seed: int,
    folder: Path,
    transcript: str | Path | None = None,
    learner: str = "torch",
) -> list[PaperRun]:
    """Train both sides under a condition, and evaluate the final policies without exploration noise.

    Args:
        condition: differences from the preset.
        preset: the scenario, ``paper``, ``standard`` or ``figures``.
        budget: length of the training.
        seed: training seed. It starts from the same networks and matches under every condition.
        folder: folder for the transcript of a language model.
        transcript: transcript of a language model, which is replayed; None: it is asked.
        learner: ``torch``, or ``jax``, which is faster and needs the extra ``fast``. Both give the same
            weights apart from the rounding of sums.

    Returns:
        A run, and one per swapped path.

    Raises:
        UserError: an unknown learner, or one whose packages are missing.
    """
    check_learner(learner)
    torch.set_num_threads(1)
    libraries = ("torch", "numpy", *(["jax"] if learner == "jax" else []))
    scenario, steps = condition.scenario(preset), condition.budgets * budget.steps
    replays = condition.planner == "llm" and transcript is not None
    planner = training_planner(condition.planner, folder, {"transcript": transcript} if replays else {})
    make_games = partial(Recorded, budget.games, scenario=scenario, planner=planner, path=condition.path)
    start = time.monotonic()
    games = make_games()
    staggered = FPGVecEnv(games, training_seed(seed), stagger=True)
    model: Any = make_model(ALGORITHM, staggered, hyperparameters(budget), seed)
    model.set_logger(configure(None, []))
    if learner == "torch":
        model.learn(steps)
    else:
        from fpg_bench.products.maddpg.jax_learner import JaxLearner

        JaxLearner(model).learn(steps)
    final = play_deterministic(model, make_games())
    about = RunAbout(
        scenario=f"{preset}, {scenario.hash}",
        versions=versions(*libraries),
        seconds=round(time.monotonic() - start),
        budget=f"{budget.name}, {steps} steps, {model.n_updates} updates",
    )
    rows = [*windows_of(games.rounds, steps), window_row(FINAL, steps, *final)]
    runs = [PaperRun(condition.name, seed, about, rows)]
    for path in condition.swaps:
        swap = play_deterministic(model, make_games(path=path, planner=None))
        runs.append(PaperRun(swapped(condition.name, path), seed, about, [window_row(FINAL, steps, *swap)]))
    return runs


def check_learner(name: str) -> None:
    """Raise UserError for an unknown learner, or one whose packages are missing."""
    if name not in LEARNERS:
        raise UserError(f"learner: expected torch or jax, got {name!r}{nearest(name, LEARNERS)}")
    if name == "jax":
        require_extra("fast", "jax", "optax")


def play_deterministic(
    model: BaseAlgorithm, games: Recorded
) -> tuple[list[tuple[np.void, np.ndarray]], np.ndarray]:
    """Play a match in every game, on evaluation seeds.

    Returns:
        The tally and histogram of each round, and the positions of both sides in the last round of the first
        game, ``(2, n, 3)`` in m, every few steps.
    """
    scenario, state = games.scenario, games.duel.batch.games
    games.reset(seeds=np.array(evaluation_seeds(games.count)))
    positions = []
    for _ in range(scenario.rounds_per_match * scenario.steps_per_round):
        positions.append([state[f"{side}_position"][0].copy() for side in SIDES])
        games.step(model.predict(games.observations, deterministic=True)[0])
        if games.truncated.any():
            games.reset(games.truncated.copy())
    every = max(scenario.steps_per_round // _POSITIONS, 1)
    last = np.array(positions[-scenario.steps_per_round :: every])
    return [(tally, histogram) for _, tally, histogram in games.rounds], last.transpose(1, 0, 2)
