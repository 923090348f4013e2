"""Conformance: checks to call on a player, planner or scenario of one's own, in a test or a notebook.

Each returns nothing where all is well; what is wrong is an :class:`AssertionError` of one line that says
what, and how to mend it::

    from fpg_bench.testing import check_player

    check_player(MyAlly(), "ally")
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

from fpg_bench.envs.duel import Duel
from fpg_bench.errors import UserError
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.matches.rounds import play_round, seated
from fpg_bench.planning import Limits, Plan, Request, as_planner, plan_all
from fpg_bench.planning.naming import find_planner
from fpg_bench.planning.planner import check_described
from fpg_bench.players.naming import as_player
from fpg_bench.players.player import SIDES, Player
from fpg_bench.players.scripted import Scripted, player_seeds
from fpg_bench.players.seat import Seat

GAMES = 7
STEPS = 40
TORCH_TOLERANCE = 1e-4  # torch's last bits move with the batch size
_SPARRING = {"ally": ("opponent", "adaptive"), "opponent": ("ally", "expert")}


def check_player(player: Any, side: str, scenario: Scenario | str | None = None) -> None:
    """Check that a player keeps to the contract of :class:`fpg_bench.players.player.Player`.

    Its actions must be floats ``(n, 9)``, finite and in [-1, 1]; the same for the same seeds, whatever
    the batch size (to 1e-4 for torch models); it must leave what it is handed as it is, and begin
    with an empty memory where a round starts.

    Args:
        player: a player, or its name.
        side: ``ally`` or ``opponent``.
        scenario: what is played; None: ``standard``.

    Raises:
        AssertionError: the first thing that is wrong, and how to mend it.
        UserError: no such player or scenario.
    """
    _require(side in SIDES, f"side: expected 'ally' or 'opponent', got {side!r}")
    played = as_scenario(scenario)
    player = as_player(player, side, played)
    observations, seeds = _recorded(player, side, played)
    tolerance = TORCH_TOLERANCE if _holds_torch(player) else 0.0
    first = _replay(player, observations, seeds)
    _check_repeats(player, observations, seeds, first, tolerance)
    _check_batch_size(player, observations, seeds, first, tolerance)
    _check_memory(player, observations, seeds, first, tolerance)


def check_planner(planner: Any, scenario: Scenario | str | None = None) -> None:
    """Check that a planner keeps to the contract of :class:`fpg_bench.planning.Planner`.

    It must say its name and tier and answer with finite waypoints ``(n, 3)`` inside the box, the same for the
    same generator, without and with a history, which it must leave as it is, alone and in a batch. It
    plans six times.

    Args:
        planner: a planner, or its name.
        scenario: what is played; None: ``standard``.

    Raises:
        AssertionError: the first thing that is wrong, and how to mend it.
        UserError: no such planner or scenario.
    """
    played = as_scenario(scenario)
    planner = find_planner(planner, played)
    with _asserting():
        check_described(planner)
    limits = Limits.of(played)
    for rounds in (0, 3):
        rng = np.random.default_rng(rounds)
        history = rng.uniform(-1, 1, (rounds, limits.waypoints, 4))
        history[..., :3] = rng.uniform(0, limits.box_m, (rounds, limits.waypoints, 3))
        _check_plan(planner, history, rng.uniform(0, limits.box_m), limits)


def check_scenario(scenario: Scenario | str | None) -> None:
    """Check that a scenario can be played: whole rounds, sound numbers, the same game for the same seed.

    Args:
        scenario: a scenario, a preset's name or a YAML file.

    Raises:
        AssertionError: the first thing that is wrong, with the step.
        UserError: no such scenario.
    """
    played = as_scenario(scenario)
    for allies, opponents in (("random", "random"), ("expert-spread", "adaptive")):
        together = _played_round(played, allies, opponents, games=3, seed=11)
        again = _played_round(played, allies, opponents, games=3, seed=11)
        alone = _played_round(played, allies, opponents, games=1, seed=13)
        for k, (x, y, z) in enumerate(zip(together, again, alone, strict=True)):
            _require((x == y).all(), f"scenario: the same seed gave another game at step {k}")
            _require(
                (x[2] == z[0]).all(), f"scenario: game 2 of a batch of seed s is not seed s + 2 at step {k}"
            )


def _require(holds: Any, message: str) -> None:
    if not holds:
        raise AssertionError(message)


@contextlib.contextmanager
def _asserting() -> Iterator[None]:
    """What the package refuses in play is a check that fails here."""
    try:
        yield
    except UserError as error:
        raise AssertionError(str(error)) from error


# Players


def _recorded(player: Player, side: str, scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """What the player sees ``(steps, games, size)`` in games against a script, its answers checked."""
    duel = _duel(scenario, GAMES)
    other_side, other_name = _SPARRING[side]
    other = Seat(other_side, [Scripted(other_side, other_name, scenario)], duel.arena)
    other.begin(duel.reset(seeds=1))
    seeds = player_seeds(np.ascontiguousarray(duel.arena.games["round_key"]), side)
    _begin(player, np.ones(GAMES, bool), seeds)
    state, start, seen = None, np.ones(GAMES, bool), []
    for _ in range(min(STEPS, scenario.steps_per_round)):
        seen.append(_seen(player, side, duel))
        actions, state = _ask(player, seen[-1], state, start)
        start = np.zeros(GAMES, bool)
        pair = {side: actions, other_side: other.act()}
        duel.step(pair["ally"], pair["opponent"])
    return np.array(seen), seeds


def _seen(player: Player, side: str, duel: Duel) -> np.ndarray:
    if getattr(player, "sees", "") == "state":
        return duel.state()
    present = duel.present()
    return present.ally_observations if side == "ally" else present.opponent_observations


def _ask(player: Player, seen: np.ndarray, state: Any, start: np.ndarray) -> tuple[np.ndarray, Any]:
    """The player's answer to a copy, checked: shape, kind, range, and that the copy is as it was."""
    handed = seen.copy()
    answer = player.predict(handed, state, start, True)
    _require(
        isinstance(answer, tuple) and len(answer) == 2,
        f"player: predict returned {type(answer).__name__}; return (actions, state), None for no memory",
    )
    actions = answer[0]
    _require((handed == seen).all(), "player: predict changed its observation; work on a copy")
    shape = (len(seen), ACTION_SIZE)
    found = getattr(actions, "shape", type(actions).__name__)
    _require(found == shape, f"player: actions are {found} for a batch of {len(seen)}; return shape {shape}")
    kind = getattr(actions, "dtype", None)
    _require(
        isinstance(actions, np.ndarray) and actions.dtype.kind == "f",
        f"player: actions are {type(actions).__name__} of {kind}; return a float32 NumPy array",
    )
    _require(np.isfinite(actions).all(), "player: actions hold NaN or infinity; return finite numbers")
    _require(
        (np.abs(actions) <= 1).all(),
        f"player: actions reach {np.abs(actions).max():.3g}; clip them to [-1, 1]",
    )
    return actions, answer[1]


def _begin(player: Player, mask: np.ndarray, seeds: np.ndarray) -> None:
    if hasattr(player, "reset"):
        player.reset(mask, seeds)


def _replay(
    player: Player,
    observations: np.ndarray,
    seeds: np.ndarray,
    restart: tuple[int, np.ndarray, np.ndarray] | None = None,
) -> np.ndarray:
    """The player's actions ``(steps, games, 9)`` on recorded observations.

    ``restart`` (step, mask, seeds) begins another round of the masked games there.
    """
    games = len(seeds)
    _begin(player, np.ones(games, bool), seeds)
    state, start, actions = None, np.ones(games, bool), []
    for k, seen in enumerate(observations):
        if restart is not None and k == restart[0]:
            start = restart[1].copy()
            _begin(player, restart[1], restart[2])
        answer, state = _ask(player, seen, state, start)
        actions.append(answer.copy())
        start = np.zeros(games, bool)
    return np.array(actions)


def _check_repeats(
    player: Player, observations: np.ndarray, seeds: np.ndarray, first: np.ndarray, tolerance: float
) -> None:
    again = _replay(player, observations, seeds)
    _require(
        _close(first, again, tolerance),
        "player: the same observations and seeds gave other actions; "
        "draw from the seeds of reset(mask, seeds), and keep memory in the returned state",
    )


def _check_batch_size(
    player: Player, observations: np.ndarray, seeds: np.ndarray, first: np.ndarray, tolerance: float
) -> None:
    for game in (0, GAMES - 1):
        alone = _replay(player, observations[:, game : game + 1], seeds[game : game + 1])
        _require(
            _close(first[:, game : game + 1], alone, tolerance),
            f"player: game {game} of a batch of {GAMES} gets other actions than alone; "
            "let each row depend on its own observation, memory and seed only",
        )


def _check_memory(
    player: Player, observations: np.ndarray, seeds: np.ndarray, first: np.ndarray, tolerance: float
) -> None:
    """A round that starts in some games empties their memory, and leaves the others'."""
    half = len(observations) // 2
    mask = np.arange(GAMES) % 2 == 0
    # The second half shows what the first did, so a memory emptied answers as it did at first
    twice = np.concatenate([observations[:half], observations[:half]])
    restarted = _replay(player, twice, seeds, (half, mask, seeds))
    _require(
        _close(restarted[half:, mask], first[:half, mask], tolerance),
        "player: remembers the round before; empty the memory where episode_start is True",
    )
    unbroken = _replay(player, twice, seeds)
    _require(
        _close(restarted[:, ~mask], unbroken[:, ~mask], tolerance),
        "player: a round that starts in one game changed another's; empty only where episode_start is True",
    )


def _close(x: np.ndarray, y: np.ndarray, tolerance: float) -> bool:
    return bool((np.abs(x - y) <= tolerance).all())


def _holds_torch(player: Any) -> bool:
    torch = sys.modules.get("torch")
    parts = [player, *getattr(player, "__dict__", {}).values()]
    return torch is not None and any(isinstance(part, torch.nn.Module) for part in parts)


# Planners


def _check_plan(planner: Any, history: np.ndarray, position: np.ndarray, limits: Limits) -> None:
    past, here = history.copy(), position.copy()
    (waypoints,) = _planned(planner, past, here, limits, games=1)
    _require((past == history).all(), "planner: plan changed the history; work on a copy")
    _require((here == position).all(), "planner: plan changed the current position; work on a copy")
    for again in _planned(planner, past, here, limits, games=2):
        _require(
            (waypoints == again).all(),
            f"planner: the same generator gave another plan after {len(history)} rounds; draw from rng only",
        )


def _planned(
    planner: Any, history: np.ndarray, position: np.ndarray, limits: Limits, games: int
) -> list[np.ndarray]:
    """The waypoints of some plans for the same situation, checked."""
    path = np.linspace(0, limits.box_m, limits.round_s + 1) if planner.tier == "ally" else None
    requests = [
        Request(history, position, limits, np.random.default_rng(5), round=len(history), ally_path=path)
        for _ in range(games)
    ]
    with _asserting():
        plans = plan_all(planner, requests)
    return [_checked_waypoints(plan, limits, f"after {len(history)} rounds") for plan in plans]


def _checked_waypoints(plan: Plan, limits: Limits, after: str) -> np.ndarray:
    waypoints, shape = plan.waypoints, (limits.waypoints, 3)
    _require(
        waypoints.shape == shape, f"planner: waypoints are {waypoints.shape} {after}; return shape {shape}"
    )
    _require(np.isfinite(waypoints).all(), f"planner: waypoints hold NaN or infinity {after}; return metres")
    for index, point in enumerate(waypoints):
        inside = ((point >= 0) & (point <= np.asarray(limits.box_m))).all()
        _require(inside, f"planner: waypoint {index} lies outside the box {limits.box_m} {after}; clip it")
    return waypoints


# Scenarios


def _duel(scenario: Scenario, games: int) -> Duel:
    planner = as_planner("random", scenario) if "waypoints" in scenario.paths else None
    return Duel(scenario, games, planner)


def _played_round(scenario: Scenario, ally: str, opponent: str, games: int, seed: int) -> list[np.ndarray]:
    """Everything that a whole round shows, ``(games, ...)`` per step, checked to be sound."""
    table = seated(_duel(scenario, games), ally, opponent)
    shown: list[np.ndarray] = []

    def look() -> None:
        duel, k = table.duel, len(shown)
        step = duel.present()
        _check_shown(step.ally_observations, step.opponent_observations, duel.state(), k)
        rewards = np.column_stack([step.ally_rewards, step.opponent_rewards])
        _require(
            np.isfinite(rewards).all(),
            f"scenario: a reward at step {k} is NaN or infinite: {rewards.tolist()}",
        )
        over = step.truncated.all() if k + 1 == scenario.steps_per_round else not step.truncated.any()
        _require(
            over, f"scenario: a round of {scenario.steps_per_round} steps did not end with its last one ({k})"
        )
        shown.append(np.column_stack([step.ally_observations, step.opponent_observations, rewards]))

    play_round(table, seeds=seed, on_step=look)
    return shown


def _check_shown(ally: np.ndarray, opponent: np.ndarray, state: np.ndarray, k: int) -> None:
    for name, shown in (
        ("ally's observation", ally),
        ("opponent's observation", opponent),
        ("full state", state),
    ):
        bad = ~(np.abs(shown) <= 1).all(axis=0)
        _require(
            not bad.any(),
            f"scenario: index {bad.argmax()} of the {name} at step {k} lies outside [-1, 1] or is NaN",
        )
