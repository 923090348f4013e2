"""Small hands for the tests of the groups: fixed actions, and what each view shows under them."""

from __future__ import annotations

import dataclasses

import gymnasium
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


def single_game(env_id: str, seed: int, actions: np.ndarray, **options) -> list[tuple]:
    """(observation, reward) of every step over the rounds, a round's start with reward None."""
    env = gymnasium.make(env_id, scenario=SHORT, disable_env_checker=True, **options).unwrapped
    shown = [(env.reset(seed=seed)[0], None)]
    for action in actions:
        observation, reward, terminated, truncated, _ = env.step(action)
        assert not terminated
        shown.append((observation, reward))
        if truncated:
            shown.append((env.reset()[0], None))
    return shown


def same(first: list[tuple], second: list[tuple]) -> bool:
    """Whether two games showed the same to the bit (rewards to a float32's)."""
    assert len(first) == len(second)
    return all(
        np.array_equal(x, y) and (r is None) == (s is None) and (r is None or np.float32(r) == np.float32(s))
        for (x, r), (y, s) in zip(first, second, strict=True)
    )
