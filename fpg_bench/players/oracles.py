"""Oracles: players that see the full state ``(n, 54)``. Upper bounds to measure against, in no field."""

from __future__ import annotations

from typing import Any

import numpy as np

from fpg_bench.game.full_state import ALLY, OPPONENT
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.sensing import KNOWN_FREQUENCY, NEXT_CHECK, OWN_FREQUENCY, RELATIVE_POSITION
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.seeded import Batched

ORACLES = ("oracle",)


class OracleAlly(Batched):
    """Spreads in just the seconds in which a check comes, and leaves a frequency that is known."""

    sees = "state"

    def __init__(self, scenario: Scenario) -> None:
        self._check_s = scenario.check_scale_s
        self._half_point = 1.0 / (scenario.frequency_points - 1)

    def _answer(self, seen: np.ndarray, state: Any, starts: np.ndarray | None) -> tuple[np.ndarray, Any]:
        frequency = seen[:, ALLY + OWN_FREQUENCY]
        known = seen[:, OPPONENT + KNOWN_FREQUENCY]
        due = seen[:, OPPONENT + NEXT_CHECK] * self._check_s < 1.5
        actions = np.zeros((len(seen), ACTION_SIZE), np.float32)
        actions[:, 0] = np.where(np.abs(frequency - known) < self._half_point, 1, -1)
        actions[:, 1] = np.where(due, 1, -1)
        actions[:, 2] = 1
        actions[:, 3] = np.where(known > 0, -1, 1)  # the end of the band that is farther away
        actions[:, 4] = -1
        return actions, None


class OracleOpponent(Batched):
    """A single tone on the ally's true frequency, flying straight at it.

    An upper bound against allies that hop when they are jammed; one that hops every second has left by
    the time the tone arrives, and broadband serves better there.
    """

    sees = "state"

    def __init__(self, scenario: Scenario) -> None:
        self._box = np.asarray(scenario.box_m)

    def _answer(self, seen: np.ndarray, state: Any, starts: np.ndarray | None) -> tuple[np.ndarray, Any]:
        actions = np.full((len(seen), ACTION_SIZE), -1, np.float32)
        actions[:, 0] = 1
        actions[:, 4] = seen[:, ALLY + OWN_FREQUENCY]
        actions[:, 5] = 1
        start = OPPONENT + RELATIVE_POSITION
        root = seen[:, start : start + 3]
        away = np.sign(root) * root**2 * self._box
        actions[:, 6:] = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 10.0)
        return actions, None
