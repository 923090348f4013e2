"""Players without learning: what every trained agent has to beat. They read observations only."""

from __future__ import annotations

from typing import Any

import numpy as np

from fpg_bench.game import rng
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.scripts import ALLIES, OPPONENTS, play_ally, play_opponent
from fpg_bench.players.seeded import SeededPolicy

SCRIPTED = {"ally": ALLIES, "opponent": OPPONENTS}


class Scripted(SeededPolicy):
    """A scripted ally or opponent, compiled over a batch; its memory is the round's step count.

    Args:
        side: ``ally`` or ``opponent``.
        name: one of ``SCRIPTED[side]``.
        scenario: what is played; gives the scales in which observations are read.
    """

    def __init__(self, side: str, name: str, scenario: Scenario) -> None:
        self.side, self.name = side, name
        self._kind = SCRIPTED[side].index(name)
        self._play = play_ally if side == "ally" else play_opponent
        self._scales = np.array(
            [
                scenario.snr_scale_db,
                scenario.snr_threshold_db,
                scenario.spreading_scale_s,
                scenario.frequency_points,
                *scenario.box_m,
            ]
        )

    def _answer(self, seen: np.ndarray, state: Any, starts: np.ndarray | None) -> tuple[np.ndarray, Any]:
        count = len(seen)
        steps = np.zeros(count, np.int64) if state is None else state.copy()
        if starts is not None:
            steps[starts] = 0
        actions = np.empty((count, ACTION_SIZE), np.float32)
        if seen.dtype != np.float32 or not seen.flags.carray:  # what is compiled
            seen = np.require(seen, np.float32, ("C", "A", "W"))
        self._play(self._kind, seen, actions, steps, self.keys(count), self._scales)
        return actions, steps

    def __repr__(self) -> str:
        return f"Scripted({self.side!r}, {self.name!r})"


def player_seeds(round_keys: np.ndarray, side: str) -> np.ndarray:
    """``(N,)`` uint64 seeds of one side's player for the rounds of these keys."""
    seeds = np.empty(len(round_keys), np.uint64)
    purpose = rng.PLAYER_SEED if side == "ally" else rng.OPPONENT_PLAYER_SEED
    rng.derived_keys(seeds, np.ascontiguousarray(round_keys), purpose)
    return seeds
