"""Full state as a vector: for centralised critics and oracles, never part of an observation."""

from __future__ import annotations

import numpy as np

from fpg_bench.game.batch import GameBatch
from fpg_bench.game.names import PATHS
from fpg_bench.game.state import OBSERVATION_SIZE

# Indices into the full state; both observations come first.
ALLY, OPPONENT = 0, OBSERVATION_SIZE
ELAPSED = 2 * OBSERVATION_SIZE
OUTBOUND = ELAPSED + 1
CURVE_SHARE = OUTBOUND + 1
CONTROL_POINTS = CURVE_SHARE + 1
TARGET = CONTROL_POINTS + 12
PATH = TARGET + 3
FULL_STATE_SIZE = PATH + len(PATHS)


def full_state(batch: GameBatch) -> np.ndarray:
    """Return the full state of every game, ``(N, 54)`` float32 in [-1, 1].

    Both observations (which hold the true frequency, jamming, known frequency and time to the next
    check), share of the round played, the ally's direction and place on its curve, the curve's control
    points, the waypoint flown to (0 where there is none), and the opponent's path (one-hot).
    """
    games, scenario = batch.games, batch.scenario
    state = np.zeros((batch.count, FULL_STATE_SIZE), np.float32)
    state[:, ALLY:OPPONENT] = batch.ally_observations
    state[:, OPPONENT:ELAPSED] = batch.opponent_observations
    state[:, ELAPSED] = games["step"] / scenario.steps_per_round
    state[:, OUTBOUND] = np.where(games["outbound"], 1, -1)
    along = games["chord_offset_m"] / np.maximum(games["chord_length_m"], 1e-9)
    state[:, CURVE_SHARE] = (games["chord"] + along) / scenario.ally_path_chords
    box = np.asarray(scenario.box_m)
    state[:, CONTROL_POINTS:TARGET] = (2 * games["control_points"] / box - 1).reshape(batch.count, 12)
    flown = games["path"] == PATHS.index("waypoints")
    due = np.minimum(games["step"] * scenario.waypoints // scenario.steps_per_round, scenario.waypoints - 1)
    target = batch.waypoints[np.arange(batch.count), due]
    state[:, TARGET:PATH] = np.where(flown[:, None], 2 * target / box - 1, 0)
    state[np.arange(batch.count), PATH + games["path"]] = 1
    return state
