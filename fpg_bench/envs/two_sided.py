"""Both sides of N games as one player: what trains both at once."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
from gymnasium import spaces

from fpg_bench.envs.duel import make_duel
from fpg_bench.envs.one_sided import refuse_unknown
from fpg_bench.game.arena import ActionError, described
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE
from fpg_bench.players.player import SIDES


class TwoSided:
    """N games whose sides are both played by the caller, the ally's numbers first everywhere.

    Args:
        games: how many, N.
        **options: those of :func:`fpg_bench.envs.duel.make_duel`.

    Raises:
        UserError: something unknown, out of range, or impossible together.

    Attributes:
        sizes: of each side's observation and action.
        side: whose return stands for a round's in SB3's statistics.
    """

    sizes = ((OBSERVATION_SIZE, ACTION_SIZE),) * 2
    side = "ally"

    def __init__(self, games: int = 1, **options: Any) -> None:
        known = inspect.signature(make_duel).parameters
        refuse_unknown({name: value for name, value in options.items() if name not in known}, make_duel)
        self.duel = make_duel(games, **options)
        self.scenario, self.count = self.duel.scenario, self.duel.count
        self.observation_space = spaces.Box(-1.0, 1.0, (2 * OBSERVATION_SIZE,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (2 * ACTION_SIZE,), np.float32)

    @property
    def truncated(self) -> np.ndarray:
        """``(N,)`` bool, a buffer; of the present duel, which a copy has its own of."""
        return self.duel.arena.games["truncated"]

    @property
    def observations(self) -> np.ndarray:
        """``(N, 30)`` float32."""
        return np.concatenate([getattr(self.duel.arena, f"{side}_observations") for side in SIDES], axis=1)

    @property
    def rewards(self) -> np.ndarray:
        """``(N, 2)`` float64."""
        return np.stack([self.duel.arena.games[f"{side}_reward"] for side in SIDES], axis=1)

    def reset(self, *arguments: Any, **more: Any) -> None:
        """Begin rounds; see :meth:`fpg_bench.envs.duel.Duel.reset`."""
        self.duel.reset(*arguments, **more)

    def step(self, actions: np.ndarray) -> None:
        """Play one step with ``(N, 18)`` actions.

        Raises:
            ActionError: a wrong shape or dtype, or NaN or infinity (the message names side, game and index).
        """
        shape = (self.count, 2 * ACTION_SIZE)
        if not isinstance(actions, np.ndarray) or actions.dtype.kind != "f" or actions.shape != shape:
            raise ActionError(f"actions: expected a float array of shape {shape}, got {described(actions)}")
        self.duel.arena.step(*(np.ascontiguousarray(part) for part in np.split(actions, 2, axis=1)))

    def measures(self, game: int) -> dict[str, float | None]:
        """The measures of one game's present round so far."""
        return self.duel.measures(game)
