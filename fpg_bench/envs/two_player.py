"""A batch of games with both sides in the caller's hands, and plans made between rounds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from fpg_bench.common.checks import check_keys
from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import DUEL
from fpg_bench.game import rng
from fpg_bench.game.batch import GameBatch, Seeds
from fpg_bench.game.choices import action_choices
from fpg_bench.game.full_state import full_state
from fpg_bench.game.metrics import measures, pool
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.planner import Limits, Plan, Planner, Request, as_planner, plan_all, planner_name
from fpg_bench.players.player import SIDES
from fpg_bench.players.scripted import player_noise, player_seeds

PlannerSpec = str | Planner | Callable[..., Planner]  # a planner, its name, or a factory


class TwoPlayerStep(NamedTuple):
    """Results of a step, all copies: observations ``(N, 15)``, rewards ``(N,)`` float64, ``(N,)`` bool."""

    ally_observations: np.ndarray
    opponent_observations: np.ndarray
    ally_rewards: np.ndarray
    opponent_rewards: np.ndarray
    truncated: np.ndarray


class TwoPlayerBatch:
    """N games of which the caller plays both sides; a round that is over waits for :meth:`reset`.

    Observations are ``(N, 15)`` float32 and actions ``(N, 9)`` floats in [-1, 1] for each side, or the
    choices of :class:`fpg_bench.game.choices.Choices` for a side that has another action mode.

    Args:
        scenario: what is played.
        games: number of games, N.
        planner: plans the opponent's path between rounds; needed for the path ``waypoints``.
        threads: see :class:`fpg_bench.game.batch.GameBatch`.
        actions: action mode of both sides, one of ``fpg_bench.common.ids.ACTION_MODES``, or a mapping from
            ``ally`` and ``opponent`` to one each.

    Attributes:
        batch: the games and all their buffers.
        choices: the choices of each side; None where its actions are continuous.
        plans: the present plan of each game, None where the path is not planned.
        game_spec: the game, if :func:`make_duel` made it.
    """

    game_spec: GameSpec | None = None

    def __init__(
        self,
        scenario: Scenario,
        games: int = 1,
        planner: Planner | None = None,
        threads: int | None = None,
        actions: str | Mapping[str, str] = "continuous",
    ) -> None:
        if "waypoints" in scenario.paths and planner is None:
            raise UserError("path 'waypoints' needs a planner; name one, or choose another path")
        if planner is not None and "waypoints" not in scenario.paths:
            raise UserError(f"planner: nothing to plan where the path is {scenario.opponent_path!r}")
        self.scenario = scenario
        modes = actions if isinstance(actions, Mapping) else dict.fromkeys(SIDES, actions)
        check_keys(modes, SIDES, "actions")
        self.choices = {side: action_choices(side, modes.get(side, "continuous"), scenario) for side in SIDES}
        self.batch = GameBatch(scenario, games, threads)
        self.count = self.batch.count
        self.planner = planner
        self.plans: list[Plan | None] = [None] * self.count
        self._limits = Limits.of(scenario)
        self._histories: list[list[np.ndarray]] = [[] for _ in range(self.count if planner else 0)]
        self._flown: dict[int, np.ndarray] = {}
        self._sees_ally = getattr(planner, "tier", "") == "ally"
        if self._sees_ally:
            self.batch.keep_flown()

    def reset(
        self,
        mask: np.ndarray | None = None,
        seeds: Seeds | None = None,
        new_match: bool = False,
        horizons: np.ndarray | None = None,
    ) -> np.ndarray:
        """Begin rounds in the masked games; see :meth:`fpg_bench.game.batch.GameBatch.reset`.

        Args:
            mask: ``(N,)`` bool; None: all.
            seeds: None for the next round of each match; for new matches a whole number
                (:func:`fpg_bench.game.batch.check_seeds`), or one per game.
            new_match: leave the present match and begin the same seed's next one.
            horizons: ``(N,)`` the steps at which these rounds are cut; None: the scenario's.

        Returns:
            The mask, as an array.

        Raises:
            UserError: a mask of another shape, a seed or horizon out of range, or no seeds at the first call.
        """
        mask = np.ones(self.count, bool) if mask is None else np.asarray(mask, bool)
        self.batch.check_reset(mask, horizons)
        if self.planner is not None:
            self._remember(mask)
        self.batch.reset(mask, seeds, horizons, new_match)
        if self.planner is not None:
            self._plan(mask)
        return mask

    def step(self, ally_actions: np.ndarray, opponent_actions: np.ndarray) -> TwoPlayerStep:
        """Play one step with both sides' actions; raises as ``GameBatch.step`` and ``Choices.decode`` do."""
        self.batch.step(self.decode("ally", ally_actions), self.decode("opponent", opponent_actions))
        return self.present()

    def decode(self, side: str, actions: np.ndarray) -> np.ndarray:
        """Return a side's actions as ``(N, 9)`` floats, from its choices if it has a list of them."""
        choices, batch = self.choices[side], self.batch
        if choices is None:
            return actions
        seen = batch.ally_observations if side == "ally" else batch.opponent_observations
        return choices.decode(actions, seen, side, self.noise(side) if choices.is_drawn else None)

    def noise(self, side: str) -> np.ndarray:
        """Return ``(N, 1)`` float32, the noise of a side's players at this step of their rounds."""
        games = self.batch.games
        return player_noise(player_seeds(games["round_key"], side), games["step"])

    def present(self) -> TwoPlayerStep:
        """Return the present observations, the last step's rewards and which rounds are over, as copies."""
        batch = self.batch
        return TwoPlayerStep(
            batch.ally_observations.copy(),
            batch.opponent_observations.copy(),
            batch.games["ally_reward"].copy(),
            batch.games["opponent_reward"].copy(),
            batch.games["truncated"].copy(),
        )

    def state(self) -> np.ndarray:
        """Return the full state, ``(N, 54)`` float32; see :func:`fpg_bench.game.full_state.full_state`."""
        return full_state(self.batch)

    def measures(self, game: int) -> dict[str, float | None]:
        """Return the measures of one game's present round so far."""
        return measures(
            pool(self.batch.tallies[game]) | self.batch.clean_sum([game]), self.batch.histograms[game]
        )

    def _remember(self, mask: np.ndarray) -> None:
        """Keep the segments of the rounds that end now, for the plans of their match's next rounds.

        Rounds that were left or cut early are not kept: their later parts were never flown.
        """
        is_complete = self.batch.games["step"] == self.scenario.steps_per_round
        for game in np.flatnonzero(mask & is_complete).tolist():
            self._histories[game].append(self.batch.segments[game].copy())
            if self.batch.flown_m is not None:
                self._flown[game] = self.batch.flown_m[game].copy()

    def _plan(self, mask: np.ndarray) -> None:
        requests = [self._request(game) for game in np.flatnonzero(mask).tolist()]
        for request, plan in zip(requests, plan_all(self.planner, requests), strict=True):
            try:
                self.batch.set_waypoints(request.game, plan.waypoints)
            except UserError as error:
                where = f"seed {request.seed}, match {request.match}, round {request.round}"
                raise UserError(f"planner {planner_name(self.planner)}: {where}: {error}") from error
            self.plans[request.game] = plan

    def _request(self, game: int) -> Request:
        played = self.batch.games[game]
        if played["round"] == 0:
            self._histories[game].clear()
            self._flown.pop(game, None)
        key = np.empty(1, np.uint64)
        rng.derived_keys(key, self.batch.games["round_key"][game : game + 1].copy(), rng.PLANNER_SEED)
        return Request(
            history=np.array(self._histories[game]).reshape(-1, self._limits.waypoints, 4),
            current_position=played["opponent_position"].copy(),
            limits=self._limits,
            rng=np.random.default_rng(key[0]),
            game=game,
            seed=int(played["seed"]),
            match=int(played["match"]),
            round=int(played["round"]),
            ally_path=self.batch.ally_path(game) if self._sees_ally else None,
            ally_flown=self._flown[game].copy() if game in self._flown else None,
        )


def make_duel(
    games: int = 1, *, game: GameSpec | None = None, threads: int | None = None, **options: Any
) -> TwoPlayerBatch:
    """Make a batch of games of which the caller plays both sides.

    >>> duel = make_duel(64, path="circle")
    >>> duel.reset(seeds=0).sum()
    np.int64(64)

    Args:
        games: number of games, N.
        game: a specification of ``FPG/duel_v0`` whose options are replaced; None: that of the id alone.
        threads: see :class:`TwoPlayerBatch`.
        **options: ``scenario``, ``path``, ``planner``, ``knowledge``, ``jamming_types`` and ``actions``, the
            attributes of :class:`fpg_bench.game.spec.GameSpec`; with a planner the path is ``waypoints``.

    Raises:
        UserError: an unknown option, a value out of range, or options that exclude each other.
    """
    spec = GameSpec.of(DUEL if game is None else game, **options)
    if not spec.is_duel:
        raise UserError(f"game: expected one of {DUEL}, got {spec.id}")
    spec.check_trusted()
    played = spec.resolve()
    planner = None if spec.planner is None else as_planner(spec.planner, played)
    duel = TwoPlayerBatch(played, games, planner, threads, spec.actions or "continuous")
    duel.game_spec = spec
    return duel
