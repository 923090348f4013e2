"""Checkers for a player or planner of your own, for a test or a notebook.

Each prints one line if all is well, and raises :class:`AssertionError` with one line that names the first
problem and how to fix it::

    from fpg_bench.products.checkers import check_player

    check_player(MyAlly(), "ally")
"""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

from fpg_bench.common.checks import one_of
from fpg_bench.common.errors import UserError
from fpg_bench.common.products import offered
from fpg_bench.envs.core import Core
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.suite import seated_player
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.game.spec import GameSpec, OtherGame, game_product, observation_size, other_game
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.planner import Limits, Planner, Request, as_planner, check_described, plan_all, resolve
from fpg_bench.players.player import SIDES, Abilities, Memory, Player, Prediction
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import ModelPlayer, player_name, trained_game
from fpg_bench.players.scripted import Scripted, player_seeds

__all__ = ["check_planner", "check_player"]

_GAMES = 7
_STEPS = 40
_TORCH_TOLERANCE = 1e-4  # torch's last bits depend on the batch size
_SPARRING = {"ally": ("opponent", "adaptive"), "opponent": ("ally", "expert")}


def _require(holds: bool | np.bool_, message: str) -> None:
    """Raise AssertionError with a message unless a condition holds."""
    if not holds:
        raise AssertionError(message)


@contextlib.contextmanager
def _as_assertions() -> Iterator[None]:
    """Turn a UserError raised during play into a failed check."""
    try:
        yield
    except UserError as error:
        raise AssertionError(str(error)) from error


def check_player(
    player: Player | str,
    side: str,
    scenario: Scenario | str | None = None,
    game: str | GameSpec | None = None,
) -> None:
    """Check that a player keeps the contract of :class:`fpg_bench.players.player.Player`.

    Its actions must be floats ``(n, 9)``, finite and in [-1, 1], and equal for equal seeds, whatever the
    batch size (to 1e-4 for torch models). It must leave its arguments unchanged, and start with an empty
    memory where a round starts.

    Args:
        player: a player, or its name.
        side: ``ally`` or ``opponent``.
        scenario: a scenario, a preset's name or a YAML file; None: that of ``game``.
        game: a product's game, as ``FPG/team_v0``; None: that of the agent's training, or else the duel.

    Raises:
        AssertionError: the first problem, and how to fix it.
        UserError: no such player, scenario or game.
    """
    _require(side in SIDES, f"side: expected 'ally' or 'opponent', got {side!r}")
    other = trained_game(player, side)
    if game is not None:
        one_of(game if isinstance(game, str) else game.id, "game", offered("game"))
        other = other_game(GameSpec.of(game, side=side))
    if other is not None:  # against its scripts
        changes: dict[str, Any] = {"ally": None, "opponent": None, "actions": None, "untrusted": frozenset()}
        other = dataclasses.replace(
            other, **changes if scenario is None else changes | {"scenario": scenario}
        )
    played = as_scenario(scenario) if other is None else other.resolve()
    name, player = player_name(player), seated_player(player, side, played, other)
    observations, seeds = _record_observations(player, side, played, other)
    tolerance = _TORCH_TOLERANCE if _holds_torch(player) else 0.0

    def equal(x: np.ndarray, y: np.ndarray) -> bool:
        return bool((np.abs(x - y) <= tolerance).all())

    first = _replay(player, observations, seeds)
    _require(
        equal(first, _replay(player, observations, seeds)),
        "player: the same observations and seeds gave other actions; "
        "draw from the seeds of reset(mask, seeds), and keep memory in the returned state",
    )
    count = len(seeds)
    for row in (slice(0, 1), slice(count - 1, count)):
        _require(
            equal(first[:, row], _replay(player, observations[:, row], seeds[row])),
            f"player: game {row.start} of a batch of {count} gets other actions than alone; "
            "let each row depend on its own observation, memory and seed only",
        )
    # The second half repeats the observations of the first, so that an empty memory repeats its actions.
    half, restarted = len(observations) // 2, np.arange(count) % 2 == 0
    twice = np.concatenate([observations[:half], observations[:half]])
    broken = _replay(player, twice, seeds, restart=(half, restarted))
    _require(
        equal(broken[half:, restarted], first[:half, restarted]),
        "player: remembers the round before; empty the memory where episode_start is True",
    )
    _require(
        equal(broken[:, ~restarted], _replay(player, twice, seeds)[:, ~restarted]),
        "player: a round that starts in one game changed another's; empty only where episode_start is True",
    )
    print(f"{name}: keeps to the contract of players")


def _record_observations(
    player: Player, side: str, scenario: Scenario, game: OtherGame | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the observations ``(steps, games, size)`` of games against scripts, and the player's seeds."""
    core = _Sparring(side, scenario) if game is None else game_product(game.id).make_core(game, _GAMES)
    size = observation_size(game if getattr(player, "sees", "") == getattr(game, "sees", "") else None)
    core.reset(seeds=1)
    seeds = player_seeds(np.ascontiguousarray(core.batch.games["round_key"]), side)
    start = np.ones(len(seeds), bool)
    _reset(player, start, seeds)
    state, observations = None, []
    sees_state = Abilities.of(player).sees_state
    for _ in range(min(_STEPS, scenario.steps_per_round)):
        seen = core.duel.state() if sees_state else core.observations[:, :size].copy()
        observations.append(seen)
        actions, state = _predict(player, seen, state, start)
        start = np.zeros(len(seeds), bool)
        core.step(actions)
    return np.array(observations), seeds


class _Sparring(Core):
    """Games of the duel of which one side meets a script."""

    def __init__(self, side: str, scenario: Scenario) -> None:
        self.duel, self._is_ally = _duel_of(scenario, _GAMES), side == "ally"
        other, script = _SPARRING[side]
        self._other = PolicyRunner(other, [Scripted(other, script, scenario)], self.duel.batch)

    def _begin(self, mask: np.ndarray) -> None:
        self._other.begin(mask)

    @property
    def observations(self) -> np.ndarray:
        batch = self.duel.batch
        return batch.ally_observations if self._is_ally else batch.opponent_observations

    def step(self, actions: np.ndarray) -> None:
        both = actions, self._other.act()
        self.duel.step(*both[:: 1 if self._is_ally else -1])


def _predict(player: Player, observation: np.ndarray, state: Memory, start: np.ndarray) -> Prediction:
    """Return the player's actions and memory, checked: shape, dtype, range, and its arguments unchanged."""
    given = observation.copy()
    answer = player.predict(given, state, start, True)
    _require(
        isinstance(answer, tuple) and len(answer) == 2,
        f"player: predict returned {type(answer).__name__}; return (actions, state), None for no memory",
    )
    actions = answer[0]
    _require((given == observation).all(), "player: predict changed its observation; work on a copy")
    count, shape = len(observation), getattr(actions, "shape", type(actions).__name__)
    _require(
        shape == (count, ACTION_SIZE),
        f"player: actions are {shape} for a batch of {count}; return shape {(count, ACTION_SIZE)}",
    )
    _require(
        isinstance(actions, np.ndarray) and actions.dtype.kind == "f",
        f"player: actions are {type(actions).__name__} of {getattr(actions, 'dtype', None)}; "
        "return a float32 NumPy array",
    )
    _require(np.isfinite(actions).all(), "player: actions hold NaN or infinity; return finite numbers")
    largest = np.abs(actions).max()
    _require(largest <= 1, f"player: actions reach {largest:.3g}; clip them to [-1, 1]")
    return actions, answer[1]


def _reset(player: Player, mask: np.ndarray, seeds: np.ndarray) -> None:
    if (reset := Abilities.of(player).reset) is not None:
        reset(mask, seeds)


def _replay(
    player: Player, observations: np.ndarray, seeds: np.ndarray, restart: tuple[int, np.ndarray] | None = None
) -> np.ndarray:
    """Return the player's actions ``(steps, games, 9)`` on recorded observations.

    ``restart`` (step, mask) begins another round of the masked games at that step.
    """
    start = np.ones(len(seeds), bool)
    _reset(player, start, seeds)
    state, actions = None, []
    for step, observation in enumerate(observations):
        if restart is not None and step == restart[0]:
            start = restart[1].copy()
            _reset(player, restart[1], seeds)
        answer, state = _predict(player, observation, state, start)
        actions.append(answer.copy())
        start = np.zeros(len(seeds), bool)
    return np.array(actions)


def _holds_torch(player: Player) -> bool:
    torch = sys.modules.get("torch")
    model = player.model if isinstance(player, ModelPlayer) else player
    parts = [model, *getattr(model, "__dict__", {}).values()]
    return torch is not None and any(isinstance(part, torch.nn.Module) for part in parts)


def check_planner(planner: Planner | str, scenario: Scenario | str | None = None) -> None:
    """Check that a planner keeps the contract of :class:`fpg_bench.players.planner.Planner`.

    It must have a name and a tier, and return finite waypoints ``(n, 3)`` inside the box. They must be
    equal for equal generators, with and without a history, alone and in a batch. It must leave its arguments
    unchanged. The check asks for six plans.

    Args:
        planner: a planner, or its name.
        scenario: a scenario, a preset's name or a YAML file; None: ``standard``.

    Raises:
        AssertionError: the first problem, and how to fix it.
        UserError: no such planner or scenario.
    """
    played = as_scenario(scenario)
    resolved = resolve(planner, played)
    with _as_assertions():
        check_described(resolved)
    limits = Limits.of(played)
    for rounds in (0, 3):
        rng = np.random.default_rng(rounds)
        history = rng.uniform(-1, 1, (rounds, limits.waypoints, 4))
        history[..., :3] = rng.uniform(0, limits.box_m, (rounds, limits.waypoints, 3))
        position = rng.uniform(0, limits.box_m)
        past, here = history.copy(), position.copy()
        (waypoints,) = _plan(resolved, past, here, limits, games=1)
        _require((past == history).all(), "planner: plan changed the history; work on a copy")
        _require((here == position).all(), "planner: plan changed the current position; work on a copy")
        _require(
            all((waypoints == again).all() for again in _plan(resolved, past, here, limits, games=2)),
            f"planner: the same generator gave another plan after {rounds} rounds; draw from rng only",
        )
    print(f"{resolved.name}: keeps to the contract of planners")


def _plan(
    planner: Planner, history: np.ndarray, position: np.ndarray, limits: Limits, games: int
) -> list[np.ndarray]:
    """Return the waypoints of several plans for one situation, checked."""
    path = np.linspace(0, limits.box_m, limits.round_s + 1) if planner.tier == "ally" else None
    requests = [
        Request(history, position, limits, np.random.default_rng(5), round=len(history), ally_path=path)
        for _ in range(games)
    ]
    with _as_assertions():
        plans = [plan.waypoints for plan in plan_all(planner, requests)]
    shape, after = (limits.waypoints, 3), f"after {len(history)} rounds"
    for waypoints in plans:
        _require(
            waypoints.shape == shape,
            f"planner: waypoints are {waypoints.shape} {after}; return shape {shape}",
        )
        _require(
            np.isfinite(waypoints).all(), f"planner: waypoints hold NaN or infinity {after}; return metres"
        )
        outside = ((waypoints < 0) | (waypoints > np.asarray(limits.box_m))).any(axis=1)
        _require(
            not outside.any(),
            f"planner: waypoint {outside.argmax()} lies outside the box {limits.box_m} {after}; clip it",
        )
    return plans


def _duel_of(scenario: Scenario, games: int) -> TwoPlayerBatch:
    """Return a batch of games; an opponent whose path is planned flies random plans."""
    planner = as_planner("random", scenario) if "waypoints" in scenario.paths else None
    return TwoPlayerBatch(scenario, games, planner)
