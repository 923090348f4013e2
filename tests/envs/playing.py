"""Helpers of the environments' tests: ids, a short scenario, and fixed actions."""

from __future__ import annotations

import dataclasses

import numpy as np

from fpg_bench.common.ids import ENVS
from fpg_bench.game.scenario import STANDARD

IDS = tuple(name for name, view in ENVS.items() if view.planner != "llm")  # that needs an endpoint
ALLY, PLANNED, OPPONENT, ALLY_POLICY, OPPONENT_POLICY = IDS
STEPS = 32
# Short rounds, two to a match: three of them show a round, a match and the seed's next match.
SHORT = dataclasses.replace(STANDARD, steps_per_round=STEPS, rounds_per_match=2)
ROUNDS = 3
REST = np.zeros(9, np.float32)


def tape(games: int, steps: int = ROUNDS * STEPS, seed: int = 0) -> np.ndarray:
    """Uniform actions ``(steps, games, 9)``; a game's own do not depend on how many there are."""
    rows = [np.random.default_rng([seed, game]).uniform(-1, 1, (steps, 9)) for game in range(games)]
    return np.stack(rows, axis=1).astype(np.float32)


class Tape:
    """A player that plays actions ``(steps, games, 9)``, the same in every round."""

    def __init__(self, actions: np.ndarray) -> None:
        self.actions = actions

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        steps = np.zeros(len(observation), int) if state is None else state.copy()
        steps[episode_start] = 0
        return self.actions[steps, np.arange(len(steps))], steps + 1
