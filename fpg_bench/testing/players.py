"""The contract of players."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from fpg_bench.envs.duel import Duel
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.naming import as_player, player_name
from fpg_bench.players.player import SIDES, Player
from fpg_bench.players.scripted import Scripted, player_seeds
from fpg_bench.players.seat import Seat
from fpg_bench.testing.requiring import require
from fpg_bench.testing.scenarios import duel_of

GAMES = 7
STEPS = 40
TORCH_TOLERANCE = 1e-4  # torch's last bits move with the batch size
_SPARRING = {"ally": ("opponent", "adaptive"), "opponent": ("ally", "expert")}


def check_player(player: Any, side: str, scenario: Scenario | str | None = None) -> None:
    """Check that a player keeps to the contract of :class:`fpg_bench.players.player.Player`.

    A line says that it does. Its actions must be floats ``(n, 9)``, finite and in [-1, 1]; the same for the
    same seeds, whatever the batch size (to 1e-4 for torch models); it must leave what it is handed as it
    is, and begin with an empty memory where a round starts.

    Args:
        player: a player, or its name.
        side: ``ally`` or ``opponent``.
        scenario: what is played; None: ``standard``.

    Raises:
        AssertionError: the first thing that is wrong, and how to mend it.
        UserError: no such player or scenario.
    """
    require(side in SIDES, f"side: expected 'ally' or 'opponent', got {side!r}")
    played = as_scenario(scenario)
    name, player = player_name(player), as_player(player, side, played)
    observations, seeds = _recorded(player, side, played)
    tolerance = TORCH_TOLERANCE if _holds_torch(player) else 0.0
    first = _replay(player, observations, seeds)
    require(
        _close(first, _replay(player, observations, seeds), tolerance),
        "player: the same observations and seeds gave other actions; "
        "draw from the seeds of reset(mask, seeds), and keep memory in the returned state",
    )
    _check_batch_size(player, observations, seeds, first, tolerance)
    _check_memory(player, observations, seeds, first, tolerance)
    print(f"{name}: keeps to the contract of players")


def _recorded(player: Player, side: str, scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """What the player sees ``(steps, games, size)`` in games against a script, its answers checked."""
    duel = duel_of(scenario, GAMES)
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
    require(
        isinstance(answer, tuple) and len(answer) == 2,
        f"player: predict returned {type(answer).__name__}; return (actions, state), None for no memory",
    )
    actions = answer[0]
    require((handed == seen).all(), "player: predict changed its observation; work on a copy")
    shape = (len(seen), ACTION_SIZE)
    found = getattr(actions, "shape", type(actions).__name__)
    require(found == shape, f"player: actions are {found} for a batch of {len(seen)}; return shape {shape}")
    kind = getattr(actions, "dtype", None)
    require(
        isinstance(actions, np.ndarray) and actions.dtype.kind == "f",
        f"player: actions are {type(actions).__name__} of {kind}; return a float32 NumPy array",
    )
    require(np.isfinite(actions).all(), "player: actions hold NaN or infinity; return finite numbers")
    require(
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


def _check_batch_size(
    player: Player, observations: np.ndarray, seeds: np.ndarray, first: np.ndarray, tolerance: float
) -> None:
    for game in (0, GAMES - 1):
        alone = _replay(player, observations[:, game : game + 1], seeds[game : game + 1])
        require(
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
    require(
        _close(restarted[half:, mask], first[:half, mask], tolerance),
        "player: remembers the round before; empty the memory where episode_start is True",
    )
    unbroken = _replay(player, twice, seeds)
    require(
        _close(restarted[:, ~mask], unbroken[:, ~mask], tolerance),
        "player: a round that starts in one game changed another's; empty only where episode_start is True",
    )


def _close(x: np.ndarray, y: np.ndarray, tolerance: float) -> bool:
    return bool((np.abs(x - y) <= tolerance).all())


def _holds_torch(player: Any) -> bool:
    torch = sys.modules.get("torch")
    parts = [player, *getattr(player, "__dict__", {}).values()]
    return torch is not None and any(isinstance(part, torch.nn.Module) for part in parts)
