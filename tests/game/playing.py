"""Helpers of the game's tests: actions by name, and games in a given state."""

from __future__ import annotations

import dataclasses

import numpy as np

from fpg_bench.game.batch import GameBatch
from fpg_bench.game.scenario import STANDARD, Scenario

HOP, SPREAD, SPEED, PREFERENCE, EXPERT = range(5)
TUNING = 4
TONE, NARROWBAND, BROADBAND, COMB = range(4)

# A quiet world: no fading, exact sensing, an ally that hovers and an opponent that stays where it is put.
STILL = {
    "fading_sd_db": 0.0,
    "sensing_centre_sd_mhz": 0.0,
    "sensing_type_error": 0.0,
    "ally_speed_m_s": (0.0, 0.0),
    "opponent_path": "learned",
}


def still(base: Scenario = STANDARD, ally=(750.0, 750.0, 600.0), **changes) -> Scenario:
    """A scenario in which nothing moves unless told to; the ally hovers at ``ally``."""
    away = (0.0, 0.0, 0.0) if tuple(ally) != (0.0, 0.0, 0.0) else (1500.0, 1500.0, 600.0)
    curve = (tuple(ally), away, away, away)
    return dataclasses.replace(base, **{**STILL, "ally_path_m": curve, **changes})


def begin(scenario: Scenario, seed: int = 0, games: int = 1, **options) -> GameBatch:
    batch = GameBatch(scenario, games, **options)
    batch.reset(seeds=range(seed, seed + games))
    return batch


def ally(hop=False, spread=False, speed=1.0, preference=0.0, expert=False, scores=(0, 0, 0, 0)) -> np.ndarray:
    gates = [1.0 if gate else -1.0 for gate in (hop, spread, expert)]
    return np.array([[gates[0], gates[1], speed, preference, gates[2], *scores]])


def opponent(kind=TONE, tuning=0.0, in_band=False, velocity=(0, 0, 0)) -> np.ndarray:
    scores = [1.0 if kind == i else -1.0 for i in range(4)]
    return np.array([[*scores, tuning, 1.0 if in_band else -1.0, *velocity]])


def to_point(point: int, points: int = 15) -> float:
    """The preference that means a frequency point."""
    return 2.0 * point / (points - 1) - 1.0


def at_mhz(frequency_mhz: float) -> float:
    """The tuning in the band [150, 250] MHz that means a frequency."""
    return (frequency_mhz - 200.0) / 50.0


def place(batch: GameBatch, position, game: int = 0) -> None:
    """Put the opponent somewhere before the next step."""
    batch.games["opponent_position"][game] = position


def wander(seed: int, steps: int, games: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Actions ``(steps, games, 9)`` of both sides, some beyond [-1, 1]; gates stay for about ten steps.

    Made of sines, so that they are the same on every version of NumPy.
    """
    k, i, j = np.meshgrid(np.arange(steps), np.arange(games), np.arange(9), indexing="ij")
    phase = seed * 0.7 + i * 1.3 + j * 2.1
    slow, quick = np.sin(0.11 * (1 + 0.3 * j) * k + phase), np.sin(1.7 * k * (1 + 0.1 * j) + phase)
    return 1.2 * np.where(j == 1, slow + 0.2, quick), 1.2 * np.where(j < 6, quick, slow)


def play(batch: GameBatch, ally_actions: np.ndarray, opponent_actions: np.ndarray) -> list[np.ndarray]:
    """Play ``(steps, games, 9)`` actions; the games' records after each step."""
    records = []
    for a, o in zip(ally_actions, opponent_actions, strict=True):
        batch.step(a, o)
        records.append(batch.games.copy())
    return records
