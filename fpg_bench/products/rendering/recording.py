"""Recording of a round, step by step, for pictures and replays."""

from __future__ import annotations

import numpy as np
from numpy.lib.recfunctions import repack_fields

from fpg_bench.game.batch import GameBatch
from fpg_bench.game.names import PATHS
from fpg_bench.game.state import GAME

FIELDS = (
    "step",
    "ally_position",
    "frequency_mhz",
    "spreading",
    "spreading_s",
    "hopped",
    "opponent_position",
    "known_mhz",
    "age_s",
    "checked",
    "last_check",
    "jamming_type",
    "jamming_mhz",
    "distance_m",
    "covered",
    "snr_db",
    "clean_snr_db",
    "ally_reward",
    "opponent_reward",
)
FRAME = repack_fields(np.zeros(0, GAME)[list(FIELDS)]).dtype


class Recording:
    """Recording of one game's round: call :meth:`begin` after each reset and :meth:`add` after each step.

    Attributes:
        scenario: scenario of the game.
        seed, match, round: seed and indices of the round.
        horizon: the step at which it is truncated.
        path: how the opponent flies, one of ``scenario.PATHS``.
        control_points: ``(4, 3)`` in m, the ally's Bezier curve.
        waypoints: ``(n, 3)`` in m where the path is ``waypoints``, else None.

    Args:
        batch: the games.
        game: index of the recorded game.
    """

    def __init__(self, batch: GameBatch, game: int = 0) -> None:
        self.scenario = batch.scenario
        self._batch, self._game = batch, game
        self.begin()

    def begin(self) -> None:
        """Forget the last round and record the start of the round that has just begun."""
        game = self._batch.games[self._game]
        self.seed, self.match, self.round = int(game["seed"]), int(game["match"]), int(game["round"])
        self.horizon, self.path = int(game["horizon"]), PATHS[game["path"]]
        self.control_points = game["control_points"].copy()
        self.waypoints = self._batch.waypoints[self._game].copy() if self.path == "waypoints" else None
        self._kept = np.zeros(self.horizon + 1, FRAME)
        self._count = 0
        self.add()

    def add(self) -> None:
        """Record the last step; a step that is recorded already is skipped."""
        step = int(self._batch.games["step"][self._game])
        for name in FIELDS:
            self._kept[name][step] = self._batch.games[name][self._game]
        self._count = step + 1

    @property
    def frames(self) -> np.ndarray:
        """``(steps played + 1,)`` records of dtype ``FRAME``; the first is the start of the round."""
        return self._kept[: self._count]
