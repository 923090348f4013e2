"""Cores of the environments: N games of which the caller plays one side or both."""

from __future__ import annotations

import contextlib
import inspect
import os
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from fpg_bench.common.errors import UnknownOptionError, UserError, nearest
from fpg_bench.common.ids import EnvConfig, find_env
from fpg_bench.envs.two_player import TwoPlayerBatch, make_duel
from fpg_bench.game.batch import ActionError, check_seeds, described
from fpg_bench.game.scenario import PRESETS, Scenario, as_scenario
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE
from fpg_bench.planning import LLM_CONTROLS, as_planner
from fpg_bench.planning.planner import planner_name
from fpg_bench.players.player import SIDES
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.population import with_members
from fpg_bench.players.registry import as_player, player_name, policy_hash
from fpg_bench.players.scripted import SCRIPTED


def observation_space() -> spaces.Box:
    """15 numbers in [-1, 1], either side; ``fpg_bench.game.names.OBSERVED`` says what each is.

    Both see their own position (0-2) and where the other is from there (3-5). The ally sees its frequency,
    its spreading time, its SNR, and centre, type (10-13) and cover of the jamming that it senses. The
    opponent sees the frequency that it knows, its age, the time to the next check, centre and type (10-13)
    of its own jamming, and whether the last check heard.
    """
    return spaces.Box(-1.0, 1.0, (OBSERVATION_SIZE,), np.float32)


def action_space() -> spaces.Box:
    """9 numbers in [-1, 1], either side; ``fpg_bench.game.names.CHOSEN`` says what each is.

    The ally's are hop gate, spread gate, speed, preferred frequency, knowledge gate and the scores of the
    four strategies. The opponent's are the scores of the four jamming types, tuning, its reference and a
    velocity.
    """
    return spaces.Box(-1.0, 1.0, (ACTION_SIZE,), np.float32)


class SingleAgentGame:
    """N games of which the caller plays one side.

    Args:
        env_id: one of the ids of :mod:`fpg_bench.common.ids`.
        games: how many, N.
        scenario: a :class:`Scenario`, a preset's name or a YAML file; None: ``standard`` (with ten rounds
            a match in planner views).
        opponent, ally: the other side's player (its name, or in ``...VsPolicy`` views any object with
            ``predict``), or a list to draw from per round; ``suite:NAME``, alone or in a list, stands for all
            members of that field that play this side.
        path: how the opponent flies, or a list to draw from per round.
        planner: who plans the opponent's path (planner views): a name, an object, or a function or class
            that makes one, told the scenario. ``FPG/AllyVsLLM-v0`` takes those that ask a language model.
        knowledge, jamming_types: shorthand for the scenario's fields of these names.
        reward: ``own`` (None), as the rules say; or what a responder is paid for instead: ``against``,
            ``jamming``, ``overlap``, ``spending``; see :mod:`fpg_bench.envs.core`.

    Attributes:
        observations: ``(N, 15)`` float32, a buffer; copy what you keep.
        truncated: ``(N,)`` bool, a buffer.

    Raises:
        UserError: something unknown, out of range, of the wrong side, or impossible together.
    """

    def __init__(
        self,
        env_id: str,
        games: int = 1,
        *,
        scenario: Scenario | str | None = None,
        opponent: Any = None,
        ally: Any = None,
        path: Any = None,
        planner: Any = None,
        knowledge: str | None = None,
        jamming_types: Any = None,
        reward: str | None = None,
        threads: int | None = None,
        **unknown: Any,
    ) -> None:
        self.view = view = find_env(env_id)
        refuse_unknown(unknown, SingleAgentGame.__init__)
        named = {"opponent": opponent, "ally": ally}
        if named[view.side] is not None:
            raise UserError(f"{view.side}: in {view.id} you play the {view.side}; name the {view.other_side}")
        self.other_specs = with_members(_as_list(named[view.other_side], view.other), view.other_side)
        if reward not in (None, *REWARDS):
            raise UserError(
                f"reward: expected one of {', '.join(REWARDS)}, got {reward!r}{nearest(str(reward), REWARDS)}"
            )
        self._reward = reward or "own"
        if planner is not None and view.planner is None:
            raise UserError(f"planner: {view.id} plans no paths; FPG/AllyVsPlanner-v0 does")
        own_rounds = scenario is not None and not (isinstance(scenario, str) and scenario in PRESETS)
        played = as_scenario(
            scenario,
            opponent_path=_path(path, view.path, scenario),
            knowledge=knowledge,
            jamming_types=jamming_types,
            rounds_per_match=None if own_rounds else view.rounds_per_match,
        )
        if "waypoints" in played.paths and view.planner is None:
            raise UserError(f"path: {view.id} plans no 'waypoints'; FPG/AllyVsPlanner-v0 does")
        self.planner = _planner(planner, view, played)
        self.duel = TwoPlayerBatch(played, games, self.planner, threads)
        self.scenario, self.side, self.count = played, view.side, self.duel.count
        self.observation_space, self.action_space = observation_space(), action_space()
        self._runner = PolicyRunner(view.other_side, self._others(), self.duel.batch)
        hashes = zip(self.other_specs, map(policy_hash, self._runner.players), strict=True)
        self.policies = {player_name(spec): found for spec, found in hashes if found is not None}
        self._bind()

    def _bind(self) -> None:
        """The caller's side of the arena's buffers."""
        batch = self.duel.batch
        self.observations = batch.ally_observations if self.side == "ally" else batch.opponent_observations
        self.truncated = batch.games["truncated"]

    @property
    def rewards(self) -> np.ndarray:
        """``(N,)`` float64: of the last step; a buffer, copy what you keep."""
        return compute_reward(self._reward, self.side, self.duel.batch.games, self.scenario)

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._bind()  # a copied view of a buffer is a buffer of its own

    def _others(self) -> list[Any]:
        """The other side's players; one player for a name that stands in the list several times."""
        named = {spec: self._other(spec) for spec in self.other_specs if isinstance(spec, str)}
        return [named[spec] if isinstance(spec, str) else self._other(spec) for spec in self.other_specs]

    def _other(self, spec: Any) -> Any:
        side = self.view.other_side
        if self.view.scripted and not (isinstance(spec, str) and spec in SCRIPTED[side]):
            hint = nearest(str(spec), SCRIPTED[side]) if isinstance(spec, str) else ""
            policy = re.sub("Scripted|Planner|LLM", "Policy", self.view.id)
            raise UserError(f"{side}: {spec!r} is no script{hint} ({policy} plays against anyone)")
        return as_player(spec, side, self.scenario)

    def reset(
        self,
        mask: np.ndarray | None = None,
        seeds: Any = None,
        new_match: bool = False,
        horizons: np.ndarray | None = None,
    ) -> None:
        """Begin rounds in the masked games; see :meth:`fpg_bench.envs.two_player.Duel.reset`."""
        self._runner.begin(self.duel.reset(mask, seeds, new_match, horizons))

    def step(self, actions: np.ndarray) -> None:
        """Play one step with the caller's actions ``(N, 9)``; the other side's player chooses its own."""
        other = self._runner.act()
        if self.side == "ally":
            self.duel.batch.step(actions, other)
        else:
            self.duel.batch.step(other, actions)

    def advice(self, game: int) -> str | None:
        """What the expert knowledge base advises on what the ally has sensed; None for the opponent."""
        base = self.scenario.knowledge_base
        sensed = self.duel.batch.games["sensed_type"][game]
        if self.side == "opponent" or base is None or sensed < 0:
            return None
        return base.entries[sensed].advice

    def measures(self, game: int) -> dict[str, float | None]:
        """The measures of one game's present round so far."""
        return self.duel.measures(game)


def refuse_unknown(options: dict[str, Any], function: Any) -> None:
    """Raise UnknownOptionError for options that a function does not have, with the nearest that it has."""
    known = inspect.signature(function).parameters.values()
    for name in options:
        hint = nearest(name, (p.name for p in known if p.kind == p.KEYWORD_ONLY))
        raise UnknownOptionError(f"got an unexpected keyword argument {name!r}{hint}")


def one_action(action: Any, whose: str) -> np.ndarray:
    """``(9,)`` floats, from an array of them or a list.

    Raises:
        ActionError: another shape or kind.
    """
    if isinstance(action, list | tuple):
        with contextlib.suppress(ValueError, TypeError):
            action = np.array(action, float)
    if not isinstance(action, np.ndarray) or action.shape != (ACTION_SIZE,) or action.dtype.kind != "f":
        expected = f"expected a float array of shape ({ACTION_SIZE},)"
        raise ActionError(f"{whose}: {expected}, got {described(action)}")
    return action


def staggered_horizons(count: int, steps: int) -> np.ndarray:
    """``(count,)`` cuts of the first round, spread evenly over it, so that a batch mixes phases."""
    return steps - np.arange(count) * steps // count


def first_seeds(seed: Any, count: int) -> np.ndarray:
    """``(count,)`` seeds from what a caller gives: a whole number, one per game, or None for chance."""
    if seed is None:
        seed = int.from_bytes(os.urandom(4), "little")
    return check_seeds(seed, count)


def _as_list(spec: Any, default: Any) -> list[Any]:
    if spec is None:
        return [default]
    if isinstance(spec, Sequence) and not isinstance(spec, str):
        if not spec:
            raise UserError("a list of players to draw from must not be empty")
        return list(spec)
    return [spec]


def _planner(spec: Any, view: EnvConfig, scenario: Scenario) -> Any:
    """Who plans in a view, if anybody does: the planner named, or the view's own."""
    spec = view.planner if spec is None else spec
    planner = None if spec is None else as_planner(spec, scenario)
    if view.planner in LLM_CONTROLS and not getattr(planner, "asks_language_model", False):
        raise UserError(
            f"planner: in {view.id} a language model plans, and {planner_name(planner)} asks none; "
            "FPG/AllyVsPlanner-v0 takes any planner"
        )
    return planner


def _path(path: Any, default: str, scenario: Any) -> Any:
    """The view's own path, unless the caller names one or hands a whole scenario."""
    if path is not None:
        if default == "waypoints" and "waypoints" not in (path if isinstance(path, list | tuple) else [path]):
            raise UserError("path: a planner view flies waypoints; choose a planner instead")
        return path
    if default == "waypoints":
        return default
    return None if scenario is not None else default


class JointGame:
    """N games whose sides are both played by the caller, the ally's numbers first everywhere.

    Args:
        games: how many, N.
        **options: those of :func:`fpg_bench.envs.two_player.make_duel`.

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
        return self.duel.batch.games["truncated"]

    @property
    def observations(self) -> np.ndarray:
        """``(N, 30)`` float32."""
        return np.concatenate([getattr(self.duel.batch, f"{side}_observations") for side in SIDES], axis=1)

    @property
    def rewards(self) -> np.ndarray:
        """``(N, 2)`` float64."""
        return np.stack([self.duel.batch.games[f"{side}_reward"] for side in SIDES], axis=1)

    def reset(self, *arguments: Any, **more: Any) -> None:
        """Begin rounds; see :meth:`fpg_bench.envs.two_player.Duel.reset`."""
        self.duel.reset(*arguments, **more)

    def step(self, actions: np.ndarray) -> None:
        """Play one step with ``(N, 18)`` actions.

        Raises:
            ActionError: a wrong shape or dtype, or NaN or infinity (the message names side, game and index).
        """
        shape = (self.count, 2 * ACTION_SIZE)
        if not isinstance(actions, np.ndarray) or actions.dtype.kind != "f" or actions.shape != shape:
            raise ActionError(f"actions: expected a float array of shape {shape}, got {described(actions)}")
        self.duel.batch.step(*(np.ascontiguousarray(part) for part in np.split(actions, 2, axis=1)))

    def measures(self, game: int) -> dict[str, float | None]:
        """The measures of one game's present round so far."""
        return self.duel.measures(game)


REWARDS = ("own", "zero_sum", "jamming", "overlap", "ally_cost")


def compute_reward(reward: str, side: str, games: np.ndarray, scenario: Scenario) -> np.ndarray:
    """``(N,)`` float64: what one side is paid for the step just played.

    Args:
        reward: ``own``, the side's reward of the rules (Eq. 5 and 6); ``against``, minus the other side's;
            ``jamming``, 1 where the ally is covered and in outage; ``overlap``, 1 where it is covered;
            ``spending``, what it pays for hopping and spreading (Eq. 4 and 5). The ally gets minus the last
            three.
        side: ``ally`` or ``opponent``.
        games: ``(N,)`` records of dtype ``state.GAME``; a view of them where that is enough.
        scenario: what is played.
    """
    other = "opponent" if side == "ally" else "ally"
    if reward == "own":
        return games[f"{side}_reward"]
    if reward == "zero_sum":
        return -games[f"{other}_reward"]
    found = _of_opponent(reward, games, scenario)
    return found if side == "opponent" else -found


def _of_opponent(reward: str, games: np.ndarray, scenario: Scenario) -> np.ndarray:
    """``(N,)`` float64: what the opponent raises and the ally lowers."""
    if reward == "ally_cost":
        cap = np.inf if scenario.snr_cap_db is None else scenario.snr_cap_db
        unspent = np.minimum(games["snr_db"], cap) - scenario.snr_threshold_db
        return unspent - games["ally_reward"]
    outage = games["snr_db"] < scenario.snr_threshold_db
    return (games["covered"] & (outage | (reward == "overlap"))).astype(float)
