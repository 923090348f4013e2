"""The paper's experiment: both sides learn by MADDPG under a condition (Algorithm 1, Table 3)."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import configure

from fpg_bench.common.ids import DUEL
from fpg_bench.envs.core import JointGame
from fpg_bench.envs.sb3_vec_env import FPGVecEnv
from fpg_bench.evaluation.seeds import evaluation_seeds, training_seed
from fpg_bench.paper.conditions import Condition, swapped
from fpg_bench.paper.runs import FINAL, Run, window_row, windows_of
from fpg_bench.players.player import SIDES
from fpg_bench.training.hyperparameters import Hyperparameters, load_hyperparameters
from fpg_bench.training.language_model import training_planner
from fpg_bench.training.maddpg.multi_seed import learn_seeds
from fpg_bench.training.models import make_model
from fpg_bench.version import __version__

_KNOWLEDGE_GATE = 4


class Recorded(JointGame):
    """Both sides of N games; the ally asks the knowledge base whenever it hops (Algorithm 1, line 6).

    Args:
        games, **options: as for :class:`fpg_bench.envs.core.JointGame`.

    Attributes:
        played: steps so far, over all games.
        rounds: for each round that ended: ``played`` then, its record of dtype ``state.TALLY``, and its
            histogram ``(2, points)``.
    """

    def __init__(self, games: int = 1, **options: Any) -> None:
        super().__init__(games, **options)
        self.played = 0
        self.rounds: list[tuple[int, np.void, np.ndarray]] = []

    def step(self, actions: np.ndarray) -> None:
        """Play one step with ``(N, 18)`` actions."""
        actions = actions.copy()
        actions[:, _KNOWLEDGE_GATE] = 1
        super().step(actions)
        self.played += self.count

    def reset(
        self,
        mask: np.ndarray | None = None,
        seeds: Any = None,
        new_match: bool = False,
        horizons: np.ndarray | None = None,
    ) -> None:
        """Start new rounds; finished ones are recorded first."""
        over = self.truncated if mask is None else self.truncated & mask
        batch = self.duel.batch
        for game in np.flatnonzero(over).tolist():
            self.rounds.append((self.played, batch.tallies[game].copy(), batch.histograms[game].copy()))
        super().reset(mask, seeds, new_match, horizons)


ALGORITHM = "maddpg"
_POSITIONS = 50  # of a round that is drawn


@dataclass(frozen=True)
class Budget:
    """How long a run trains.

    Attributes:
        name: what folders call it.
        steps: game steps, over all games.
        games: how many at once.
        train_freq, gradient_steps: so many updates after so many steps of all games.
        seeds: how many runs each condition that a claim rests on has, where nothing else is said.
    """

    name: str
    steps: int
    games: int
    train_freq: int
    gradient_steps: int
    seeds: int

    def updates(self) -> int:
        """About how many updates a run makes."""
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


def hyperparameters(budget: Budget, **others: Any) -> Hyperparameters:
    """Table 3, what the shipped file says where the paper says nothing, and what is another one."""
    shipped = load_hyperparameters(ALGORITHM, DUEL)
    rhythm = {"train_freq": budget.train_freq, "gradient_steps": budget.gradient_steps}
    return dataclasses.replace(shipped, n_envs=budget.games, algorithm=shipped.algorithm | rhythm | others)


def run_experiment(
    condition: Condition,
    preset: str,
    budget: Budget,
    seeds: Iterable[int],
    folder: Path,
    llm: Mapping[str, Any] | None = None,
    learner: str = "torch",
) -> list[Run]:
    """Train both sides under a condition, and evaluate the final policies without exploration noise.

    The seeds are trained one after the other, each with games and random numbers of its own; a seed's result
    does not depend on the other seeds.

    Args:
        condition: differences from the preset.
        preset: the scenario, ``paper``, ``standard`` or ``figures``.
        budget: length of the training.
        seeds: training seeds. A seed starts from the same networks and matches under every condition.
        folder: for the transcripts of a language model.
        llm: options of the language-model planner, and ``transcript`` to replay one.
        learner: see :func:`fpg_bench.training.maddpg.multi_seed.learn_seeds`.

    Returns:
        A run per seed, and one per seed and swapped path.
    """
    torch.set_num_threads(1)
    seeds, steps = list(seeds), condition.budgets * budget.steps
    start = time.monotonic()
    trainings = {
        seed: _Training(condition, preset, budget, seed, folder / f"seed_{seed}", llm) for seed in seeds
    }
    learn_seeds({seed: each.model for seed, each in trainings.items()}, steps, learner)
    finals = {seed: play_deterministic(each.model, each.games(None)) for seed, each in trainings.items()}
    seconds = round((time.monotonic() - start) / len(seeds))
    runs = []
    for seed, training in trainings.items():
        about = {
            "scenario": f"{preset}, {condition.scenario(preset).hash}",
            "trained at once": ", ".join(map(str, seeds)),
            "versions": _versions(learner),
            "seconds": seconds,
            "budget": f"{budget.name}, {steps} steps, {training.model.n_updates} updates",
        }
        rows = [*windows_of(training.core.rounds, steps), window_row(FINAL, steps, *finals[seed])]
        runs.append(Run(condition.name, seed, about, rows))
        for path in condition.swaps:
            swap = play_deterministic(training.model, training.games(None, path=path, planner=None))
            runs.append(Run(swapped(condition.name, path), seed, about, [window_row(FINAL, steps, *swap)]))
    return runs


def _versions(learner: str) -> str:
    """Of what the numbers hang on."""
    names = ("torch", "numpy", *(["jax"] if learner == "jax" else []))
    return ", ".join([f"fpg-bench {__version__}", *(f"{name} {version(name)}" for name in names)])


class _Training:
    """One training seed under a condition: its games, which keep what was played, and its model."""

    def __init__(
        self,
        condition: Condition,
        preset: str,
        budget: Budget,
        seed: int,
        place: Path,
        llm: Mapping[str, Any] | None,
    ) -> None:
        self.scenario, options = condition.scenario(preset), dict(condition.options)
        words = dict(llm or {}) if options.get("planner") == "llm" else {}
        options["planner"] = training_planner(
            options.get("planner"), place, words.pop("transcript", None), words
        )
        self._make = partial(Recorded, budget.games, scenario=self.scenario, **options)
        games = self.games(training_seed(seed))
        self.core: Recorded = games.core  # type: ignore[assignment]
        self.model: Any = make_model(ALGORITHM, games, hyperparameters(budget, **condition.algorithm), seed)
        self.model.set_logger(configure(None, []))

    def games(self, first_seed: int | None, **instead: Any) -> FPGVecEnv:
        """Games to train in, whose rounds end at different times; without a seed: to be played together."""
        return FPGVecEnv(self._make(**instead), first_seed, stagger=first_seed is not None)


def play_deterministic(
    model: BaseAlgorithm, games: FPGVecEnv
) -> tuple[list[tuple[np.void, np.ndarray]], np.ndarray]:
    """Play a match in every game, on evaluation seeds.

    Returns:
        Each round's tally and histogram, and both sides' ``(2, n, 3)`` positions in m, in the last round of
        the first game's match, every few steps.
    """
    core: Any = games.core
    scenario, state = core.scenario, core.duel.batch.games
    core.reset(seeds=np.array(evaluation_seeds(games.num_envs)))
    flown = []
    for _ in range(scenario.rounds_per_match * scenario.steps_per_round):
        flown.append([state[f"{side}_position"][0].copy() for side in SIDES])
        core.step(model.predict(core.observations, deterministic=True)[0])
        if core.truncated.any():
            core.reset(core.truncated.copy())
    last = np.array(flown[-scenario.steps_per_round :: max(scenario.steps_per_round // _POSITIONS, 1)])
    return [(tally, histogram) for _, tally, histogram in core.rounds], last.transpose(1, 0, 2)
