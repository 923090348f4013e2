"""The batched Gymnasium view: N games, NEXT_STEP autoreset."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from fpg_bench.envs.one_sided import (
    OneSided,
    action_space,
    first_seeds,
    observation_space,
    staggered_horizons,
)
from fpg_bench.envs.single import wants_new_match
from fpg_bench.errors import UserError


class VectorView(VectorEnv):
    """N games stepped at once; game i of a batch seeded s plays as a single game seeded s + i.

    A round's last step has ``truncations`` set; the step after it begins the next round, ignores that
    game's action and gives reward 0 (NEXT_STEP). Infos of a last step hold ``measures``.

    Args:
        view_id: one of the ids of :mod:`fpg_bench.ids`.
        num_envs: N.
        stagger: cut the first rounds at evenly spread steps, so that the batch mixes phases.
        **options: those of :class:`fpg_bench.envs.one_sided.OneSided`.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        view_id: str,
        num_envs: int = 1,
        stagger: bool = False,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        if render_mode is not None:
            raise UserError(f"render_mode: a batch is not rendered, got {render_mode!r}; use gymnasium.make")
        self.core = OneSided(view_id, num_envs, **options)
        self.num_envs = num_envs
        self.render_mode = None
        self.single_observation_space = observation_space()
        self.single_action_space = action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._stagger = stagger
        self._begun = False

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a round in every game; seeds as in :class:`fpg_bench.envs.single.SingleView`."""
        options = dict(options or {})
        mask = options.pop("reset_mask", None)
        seeds = first_seeds(seed, self.num_envs) if seed is not None or not self._begun else None
        horizons = None
        if self._stagger and not self._begun:
            horizons = staggered_horizons(self.num_envs, self.core.scenario.steps_per_round)
        self.core.reset(mask, seeds, wants_new_match(options), horizons)
        self._begun = True
        return self.core.observations.copy(), {}

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Play one step with actions ``(N, 9)``; raises as :meth:`fpg_bench.game.arena.Arena.step` does."""
        core = self.core
        over = core.truncated.copy()
        core.step(actions)
        if over.any():
            core.reset(over)
        infos: dict[str, Any] = {}
        for game in np.flatnonzero(core.truncated).tolist():
            infos = self._add_info(infos, {"measures": core.measures(game)}, game)
        truncated = core.truncated.copy()
        return core.observations.copy(), core.rewards.copy(), np.zeros(self.num_envs, bool), truncated, infos
