"""Cores of the environments: N games of which the caller plays one side or both."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.ids import SCRIPTS, EnvConfig
from fpg_bench.common.imports import code_fingerprint, is_code
from fpg_bench.envs.two_player import PlannerSpec, TwoPlayerBatch, make_duel
from fpg_bench.game.batch import ActionError, Seeds, check_seeds, described, read_only
from fpg_bench.game.choices import Choices
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.spec import GameSpec
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE
from fpg_bench.game.waterfall import HISTORY, WIDTHS, Waterfall
from fpg_bench.players.agent import expand_suites
from fpg_bench.players.planner import Planner, as_planner, asks_language_model, planner_name
from fpg_bench.players.player import SIDES, Player, PlayerSpec
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player, named_card, player_name

Info = dict[str, Any]  # of a reset or a step, as Gymnasium has it
ResetOptions = dict[str, Any]


def observation_space(waterfall: Waterfall | None = None) -> spaces.Box:
    """Observation space of either side: ``Box(-1, 1, (15,), float32)``, or that of a waterfall.

    Both sides see their own position (0-2) and the other's position relative to it (3-5). The ally sees its
    frequency, its spreading time, its SNR, and centre, type (10-13) and cover of the sensed jamming. The
    opponent sees the frequency that it knows, its age, the time to the next check, centre and type (10-13)
    of its own jamming, and the result of the last check. ``fpg_bench.game.names.OBSERVED`` names each.

    Args:
        waterfall: of the ally; None for the 15 numbers.
    """
    shape = (OBSERVATION_SIZE,) if waterfall is None else waterfall.shape
    return spaces.Box(-1.0, 1.0, shape, np.float32)


def action_space(choices: Choices | None = None) -> spaces.Space[Any]:
    """Action space of either side: ``Box(-1, 1, (9,), float32)``, or that of its choices.

    The ally chooses hop gate, spread gate, speed, preferred frequency, knowledge gate, and the scores of the
    four strategies. The opponent chooses the scores of the four jamming types, tuning, its reference, and a
    velocity. ``fpg_bench.game.names.CHOSEN`` names each.

    Args:
        choices: of an action mode: ``MultiDiscrete`` in mode ``multi-discrete``, ``Discrete(n)`` in those of
            one list. None for the mode ``continuous``.
    """
    if choices is None:
        return spaces.Box(-1.0, 1.0, (ACTION_SIZE,), np.float32)
    return (
        spaces.MultiDiscrete(list(choices.sizes)) if choices.is_multi else spaces.Discrete(choices.sizes[0])
    )


def compute_reward(reward: str, side: str, games: np.ndarray, scenario: Scenario) -> np.ndarray:
    """Return the rewards ``(N,)`` float64 of one side for the last step.

    Agents trained against the same fixed player differ most by their reward, hence the alternatives.

    Args:
        reward: ``own``, the side's reward of the rules (Eq. 5 and 6); ``zero_sum``, minus the other side's;
            ``jamming``, 1 where the ally is covered and in outage; ``overlap``, 1 where it is covered;
            ``ally_cost``, the ally's costs of hopping and spreading (Eq. 4 and 5). The opponent gets the
            last three, the ally gets minus them.
        side: ``ally`` or ``opponent``.
        games: ``(N,)`` records of dtype ``state.GAME``.
        scenario: what is played.
    """
    value: np.ndarray
    if reward == "own":
        value = games[f"{side}_reward"]
        return value
    if reward == "zero_sum":
        value = -games["opponent_reward" if side == "ally" else "ally_reward"]
        return value
    if reward == "ally_cost":
        value = games["ally_value"] - games["ally_reward"]
    else:
        is_outage = games["snr_db"] < scenario.snr_threshold_db
        value = (games["covered"] & (is_outage | (reward == "overlap"))).astype(float)
    return value if side == "opponent" else -value


class Core:
    """Base class of the cores: N games, with the spaces, observations and rewards of an environment.

    All environments take their spaces, observations and rewards from their core, and give their actions to
    ``step(actions)``, which turns them into the ``(N, 9)`` floats of each side.
    """

    game_spec: GameSpec
    duel: TwoPlayerBatch
    planner: Planner | None = None
    samples = False  # whether exported agents draw their choices; else they play their mode

    @property
    def batch(self) -> Any:
        """The games, row by row as policies see them: records, observations and received actions."""
        return self.duel.batch

    def reset(
        self,
        mask: np.ndarray | None = None,
        seeds: Seeds | None = None,
        new_match: bool = False,
        horizons: np.ndarray | None = None,
    ) -> None:
        """Begin rounds in the masked games; see ``TwoPlayerBatch.reset`` for the arguments."""
        self._begin(self.duel.reset(mask, seeds, new_match, horizons))

    def _begin(self, mask: np.ndarray) -> None:
        """Prepare for the rounds that have begun in the masked games."""

    def measures(self, game: int) -> dict[str, float | None]:
        """Return the measures of one game's present round so far."""
        return self.duel.measures(game)

    def length(self, game: int) -> int:
        """Return the steps that one game's present round has had."""
        return int(self.batch.games["step"][game])


class SingleAgentGame(Core):
    """N games of which the caller plays one side.

    Args:
        game: the game: which side the caller plays, against whom, and where.
        games: number of games, N.
        threads: see :class:`fpg_bench.game.batch.GameBatch`.
        stacked: see :class:`fpg_bench.players.policy_runner.PolicyRunner`.

    Attributes:
        game_spec: the game.
        config: the configuration of the id.
        duel: the games of both sides.
        choices: what the caller chooses from; None where actions are continuous.
        waterfall: what the caller sees; None where it sees the 15 numbers.
        observation_space, action_space: of one game.
        observations: ``(N, 15)`` or ``(N, history, bins)`` float32, a read-only buffer; copy what you keep.
        truncated: ``(N,)`` bool, a read-only buffer.

    Raises:
        UserError: an unknown option, a value or side that does not fit, or options that exclude each other.
    """

    def __init__(
        self, game: GameSpec, games: int = 1, threads: int | None = None, stacked: bool = False
    ) -> None:
        game.check_trusted()
        self.game_spec = game
        self.config = config = game.config
        self.side, other_side = config.side, config.other_side
        if getattr(game, self.side) is not None:
            raise UserError(f"{self.side}: in {config.id} you play the {self.side}; name the {other_side}")
        self.other_specs = expand_suites(game.others, other_side)
        self._reward = game.reward or "own"
        if game.planner is not None and config.planner is None:
            raise UserError(f"planner: {config.id} plans no paths; FPG/AllyVsPlanner-v0 does")
        played = game.resolve()
        self.planner = _planner(game.planner, config, played)
        self.duel = TwoPlayerBatch(played, games, self.planner, threads, {self.side: game.action_mode})
        self.scenario, self.count = played, self.duel.count
        self.choices = self.duel.choices[self.side]
        self.waterfall = self._waterfall(game.observation, game.history)
        self.observation_space = observation_space(self.waterfall)
        self.action_space = action_space(self.choices)
        self._runner = PolicyRunner(other_side, self._others(), self.duel.batch, stacked=stacked)
        if self.waterfall is not None:
            self._windows = self.waterfall.empty(self.count)
        self._bind()

    def _waterfall(self, observation: str | None, history: int | None) -> Waterfall | None:
        """Return the waterfall that the caller asks for; None for the 15 numbers."""
        if observation in (None, "numbers"):
            if history is not None:
                raise UserError("history: counts the rows of a waterfall; add observation='waterfall'")
            return None
        if self.side != "ally":
            raise UserError(
                f"observation: the waterfall is the ally's; in {self.config.id} you play the opponent"
            )
        if drawn := [name for each in self.scenario.variants for name in WIDTHS if name in each]:
            raise UserError(f"variants: {drawn[0]} is drawn, and a waterfall shows one; observe the numbers")
        return Waterfall(self.scenario, HISTORY if history is None else history)

    def _bind(self) -> None:
        """Bind the buffers of the caller's side."""
        batch = self.duel.batch
        self._numbers = batch.ally_observations if self.side == "ally" else batch.opponent_observations
        self.observations = self._numbers if self.waterfall is None else read_only(self._windows)
        self.truncated = read_only(batch.games["truncated"])

    @property
    def rewards(self) -> np.ndarray:
        """``(N,)`` float64: of the last step; a buffer, copy what you keep."""
        return compute_reward(self._reward, self.side, self.duel.batch.games, self.scenario)

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)
        self._bind()  # a copied view no longer shares its buffer

    def _others(self) -> list[Player]:
        """Return the other side's players; one player for a name that is listed several times."""
        named = {spec: self._other(spec) for spec in self.other_specs if isinstance(spec, str)}
        return [named[spec] if isinstance(spec, str) else self._other(spec) for spec in self.other_specs]

    def _other(self, spec: PlayerSpec) -> Player:
        side = self.config.other_side
        if self.config.scripted and not (isinstance(spec, str) and spec in SCRIPTS[side]):
            hint = nearest(str(spec), SCRIPTS[side]) if isinstance(spec, str) else ""
            policy = re.sub("Scripted|Planner|LLM", "Policy", self.config.id)
            raise UserError(f"{side}: {spec!r} is not a script{hint} ({policy} plays against anyone)")
        return as_player(spec, side, self.scenario)

    def _begin(self, mask: np.ndarray) -> None:
        self._runner.begin(mask)
        if self.waterfall is not None:
            seen = self._numbers[mask]
            self._windows[mask] = self.waterfall.pushed(self.waterfall.empty(len(seen)), seen)

    def step(self, actions: np.ndarray) -> None:
        """Play one step with the caller's actions; the other side's player chooses its own.

        Args:
            actions: ``(N, 9)`` floats, or the choices of another action mode.

        Raises:
            ActionError: see ``GameBatch.step`` and ``Choices.decode``.
        """
        actions = self.duel.decode(self.side, actions)
        other = self._runner.act()
        if self.side == "ally":
            self.duel.batch.step(actions, other)
        else:
            self.duel.batch.step(other, actions)
        if self.waterfall is not None:
            self.waterfall.push(self._windows, self._numbers)

    def action_masks(self, game: int = 0) -> np.ndarray:
        """Return the choices that the scenario allows, ``(n,)`` bool, as sb3-contrib's MaskablePPO asks.

        Raises:
            UserError: actions are continuous.
        """
        if self.choices is None:
            raise UserError("action_masks: actions are continuous here; use actions='discrete'")
        return self.choices.mask

    def advice(self, game: int) -> str | None:
        """Return the knowledge base's advice on the jamming that the ally senses; None for the opponent."""
        base = self.scenario.knowledge_base
        sensed: int = self.duel.batch.games["sensed_type"][game]
        if self.side == "opponent" or base is None or sensed < 0:
            return None
        return str(base[sensed].advice)


def policies_of(game: GameSpec) -> dict[str, str]:
    """Return the SHA-256 of the policies of the other side's agents in a game, and of code, by name.

    Raises:
        UserError: no such agent.
    """
    if game.is_duel:
        return {}
    side = game.config.other_side
    cards = {player_name(spec): named_card(spec, side) for spec in expand_suites(game.others, side)}
    code = [name for name in (*cards, game.planner) if isinstance(name, str) and is_code(name)]
    policies = {name: card.policy_sha256 for name, card in cards.items() if card is not None}
    return policies | {name: code_fingerprint(name) for name in code}


class JointGame(Core):
    """N games of which the caller plays both sides, the ally's numbers first everywhere.

    Args:
        game: a game of ``FPG/duel_v0`` without action mode.
        games: number of games, N.
        threads: see :class:`fpg_bench.game.batch.GameBatch`.

    Attributes:
        game_spec: the game.
        observation_space, action_space: ``Box(-1, 1, (30,), float32)`` and ``Box(-1, 1, (18,), float32)``.
        sizes: of each side's observation and action.
        side: the side whose return SB3's statistics show.

    Raises:
        UserError: something unknown, out of range, or impossible together.
    """

    sizes = ((OBSERVATION_SIZE, ACTION_SIZE),) * 2
    side = "ally"

    def __init__(self, game: GameSpec, games: int = 1, threads: int | None = None) -> None:
        if game.actions is not None:
            raise UserError(f"actions: of both sides together they are continuous, got {game.actions!r}")
        self.game_spec = game
        self.duel = make_duel(games, game=game, threads=threads)
        self.scenario, self.count, self.planner = self.duel.scenario, self.duel.count, self.duel.planner
        self.observation_space = spaces.Box(-1.0, 1.0, (2 * OBSERVATION_SIZE,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (2 * ACTION_SIZE,), np.float32)

    @property
    def truncated(self) -> np.ndarray:
        """``(N,)`` bool: rounds that are over; a read-only buffer."""
        return read_only(self.duel.batch.games["truncated"])

    @property
    def observations(self) -> np.ndarray:
        """``(N, 30)`` float32."""
        batch = self.duel.batch
        return np.concatenate([batch.ally_observations, batch.opponent_observations], axis=1)

    @property
    def rewards(self) -> np.ndarray:
        """``(N, 2)`` float64."""
        return np.stack([self.duel.batch.games[f"{side}_reward"] for side in SIDES], axis=1)

    def step(self, actions: np.ndarray) -> None:
        """Play one step with both sides' actions ``(N, 18)``.

        Raises:
            ActionError: a wrong shape or dtype, or NaN or infinity (the message names side, game and index).
        """
        shape = (self.count, 2 * ACTION_SIZE)
        if not isinstance(actions, np.ndarray) or actions.dtype.kind != "f" or actions.shape != shape:
            raise ActionError(f"actions: expected a float array of shape {shape}, got {described(actions)}")
        self.duel.batch.step(*(np.ascontiguousarray(part) for part in np.split(actions, 2, axis=1)))


def as_info(measures: Mapping[str, float | None]) -> Info:
    """Return measures as infos hold them: floats, without those that do not exist."""
    return {name: float(value) for name, value in measures.items() if value is not None}


def wants_new_match(options: ResetOptions | None) -> bool:
    """Return True if a reset's options ask for a new match; raises UserError for an unknown option."""
    for key in options or {}:
        if key != "new_match":
            raise UserError(f"reset: unknown option {key!r}; known: new_match")
    return bool((options or {}).get("new_match", False))


def one_action(action: object, whose: str, choices: Choices | None = None) -> np.ndarray:
    """Return the action of one game as a batch of one, from an array or a list.

    Args:
        action: nine floats, or a choice.
        whose: begins the message of an error.
        choices: what is chosen from; None where actions are continuous.

    Returns:
        ``(1, 9)`` floats, or whole numbers ``(1,)`` or ``(1, lists)``.

    Raises:
        ActionError: another shape or kind.
    """
    if choices is not None:
        with contextlib.suppress(ValueError):  # lists of unlike lengths
            array = np.asarray(action)
            if array.dtype.kind in "iu":
                return array[None]
        expected = f"{len(choices.lists)} whole numbers" if choices.is_multi else "a whole number"
        raise ActionError(f"{whose}: expected {expected}, got {described(action)} (actions={choices.mode!r})")
    if isinstance(action, list | tuple):
        with contextlib.suppress(ValueError, TypeError, OverflowError):
            action = np.array(action, float)
    if not isinstance(action, np.ndarray) or action.shape != (ACTION_SIZE,) or action.dtype.kind != "f":
        expected = f"expected a float array of shape ({ACTION_SIZE},)"
        raise ActionError(f"{whose}: {expected}, got {described(action)}")
    return action[None]


def staggered_horizons(count: int, steps: int) -> np.ndarray:
    """Return ``(count,)`` lengths of the first rounds, spread evenly, so that a batch mixes phases."""
    return steps - np.arange(count) * steps // count


def first_seeds(seed: Seeds | None, count: int) -> np.ndarray:
    """Return the seeds of :func:`check_seeds`; None draws the whole number at random."""
    if seed is None:
        seed = int.from_bytes(os.urandom(4), "little")
    return check_seeds(seed, count)


def _planner(spec: PlannerSpec | None, config: EnvConfig, scenario: Scenario) -> Planner | None:
    """Return the planner that the caller names, otherwise the environment's default."""
    spec = config.planner if spec is None else spec
    planner = None if spec is None else as_planner(spec, scenario)
    if asks_language_model(config.planner) and not asks_language_model(planner):
        raise UserError(
            f"planner: in {config.id} a language model plans, and {planner_name(planner)} does not use one; "
            "FPG/AllyVsPlanner-v0 takes any planner"
        )
    return planner
