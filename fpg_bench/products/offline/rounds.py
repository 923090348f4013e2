"""Whole rounds of one side, played in a batch: observations, actions and rewards."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.game import rng
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player
from fpg_bench.products.offline.spec import DatasetSpec


@dataclass(frozen=True)
class Rounds:
    """N rounds of T steps.

    Attributes:
        seeds: ``(N,)`` int64, one per round.
        observations: ``(N, T + 1, 15)`` float32.
        actions: ``(N, T, 9)`` float32, or ``(N, T)`` int64 if they are discrete.
        rewards: ``(N, T)`` float64.
        players, rivals: names of the players and rivals of each round.
    """

    seeds: np.ndarray
    observations: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    players: list[str]
    rivals: list[str]

    def __len__(self) -> int:
        return len(self.seeds)

    def digests(self) -> Iterator[bytes]:
        """Yield the SHA-256 of each round."""
        for arrays in zip(self.observations, self.actions, self.rewards, strict=True):
            yield round_digest(*arrays)


def round_digest(observations: np.ndarray, actions: np.ndarray, rewards: np.ndarray) -> bytes:
    """Return the SHA-256 of one round: its observations, actions and rewards, as little-endian bytes."""
    digest = hashlib.sha256()
    for array in (observations, actions, rewards):
        digest.update(np.ascontiguousarray(array, array.dtype.newbyteorder("<")).data)
    return digest.digest()


def play_rounds(spec: DatasetSpec, seeds: Sequence[int] | np.ndarray) -> Rounds:
    """Play the first round of each of these seeds, all in one batch.

    The rounds do not depend on the batch. Discrete actions are the choices nearest to the players' floats;
    the game is played with these choices.

    Args:
        spec: specification of the players and the game.
        seeds: ``(N,)`` whole numbers.

    Raises:
        UserError: a player that does not exist, plays the other side, or fails.
    """
    scenario, side, count = spec.load_scenario(), spec.side, len(seeds)
    duel = TwoPlayerBatch(scenario, count, threads=1, actions={side: spec.actions})
    batch, choices = duel.batch, duel.choices[side]
    runners = {
        of: PolicyRunner(of, [as_player(name, of, scenario) for name in names], batch, purpose)
        for of, names, purpose in (
            (side, spec.players, rng.BEHAVIOUR_CHOICE),
            (spec.other_side, spec.rivals, rng.PLAYER_CHOICE),
        )
    }
    seen = runners[side].observations
    steps = scenario.steps_per_round
    observations = np.empty((count, steps + 1, OBSERVATION_SIZE), np.float32)
    actions = np.empty(
        (count, steps, *(() if choices else (ACTION_SIZE,))), np.int64 if choices else np.float32
    )
    rewards = np.empty((count, steps))
    mask = duel.reset(seeds=seeds)
    for runner in runners.values():
        runner.begin(mask)
    for step in range(steps):
        observations[:, step] = seen
        floats = {of: runner.act() for of, runner in runners.items()}
        actions[:, step] = choices.encode(floats[side], seen) if choices else np.clip(floats[side], -1, 1)
        floats[side] = duel.decode(side, np.ascontiguousarray(actions[:, step]))
        batch.step(floats["ally"], floats["opponent"])
        rewards[:, step] = batch.games[f"{side}_reward"]
    observations[:, steps] = seen
    players, rivals = (
        [names[k] for k in runners[of].choice]
        for of, names in ((side, spec.players), (spec.other_side, spec.rivals))
    )
    return Rounds(np.array(seeds, np.int64), observations, actions, rewards, players, rivals)
