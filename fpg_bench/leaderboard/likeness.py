"""Who plays like whom: policies are compared by what they do on rounds that nobody could prepare for."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.leaderboard import host
from fpg_bench.leaderboard.check import load_submission
from fpg_bench.leaderboard.policies import Policy
from fpg_bench.leaderboard.submission import Submission
from fpg_bench.players import agent
from fpg_bench.players.player import Player

# The mean difference of actions, in [-1, 1], below which two policies play alike. Training seeds of one
# algorithm lie 0.06 to 0.95 apart; a policy and its copy with 5 % of noise on each weight, 0.00 to 0.03.
ALIKE = 0.04
_GAMES, _STEPS = 6, 150
_BLOCK = 16  # traces at once
_VIEWS = {"ally": "FPG/AllyVsScripted-v0", "opponent": "FPG/OpponentVsScripted-v0"}
_AGAINST: dict[str, dict[str, Any]] = {
    "ally": {"opponent": ["adaptive", "tone", "comb"]},
    "opponent": {"ally": ["expert", "reactive", "expert-spread"]},
}


@dataclass(frozen=True)
class Trace:
    """What a policy saw in some rounds, and what it did: ``(steps, games, 15)`` and ``(steps, games, 9)``."""

    seen: np.ndarray
    done: np.ndarray


def fresh_seed() -> int:
    """A seed that nobody knew before."""
    return random.SystemRandom().randrange(2**31)


def traces(players: Sequence[Player], side: str, path: str | None, seed: int) -> list[Trace]:
    """Let policies play the same rounds against scripts, each for itself.

    Args:
        players: the policies, each another one where it keeps its memory itself (a ``PolicyHost``).
        side: which they play.
        path: how the opponent flies; None: in pursuit.
        seed: of the rounds.
    """
    if not players:
        return []
    count = len(players) * _GAMES
    games = gymnasium.make_vec(_VIEWS[side], num_envs=count, path=path or "pursuit", **_AGAINST[side])
    seeds = [seed + game for game in range(_GAMES)] * len(players)
    seen, _ = games.reset(seed=seeds)  # type: ignore[arg-type]  # one a game
    memories: list[Any] = [None] * len(players)
    for player in players:
        _begin(player, _GAMES)
    starts, before, done = np.ones(count, bool), [], []
    for _ in range(_STEPS):
        actions = np.empty((count, ACTION_SIZE), np.float32)
        for number, player in enumerate(players):
            own = slice(number * _GAMES, (number + 1) * _GAMES)
            action, memories[number] = player.predict(seen[own], memories[number], starts[own])
            actions[own] = _clipped(action)
        before.append(np.array(seen))
        done.append(actions)
        seen, _, terminated, truncated, _ = games.step(actions)
        starts = terminated | truncated
    games.close()
    both = (np.split(np.array(each), len(players), axis=1) for each in (before, done))
    return [Trace(*each) for each in zip(*both, strict=True)]


def apart(player: Player, others: Sequence[Trace]) -> np.ndarray:
    """How far a policy's actions lie from others', where it sees what they saw: ``(others,)``, means.

    It sees some of them at a time: what a policy may cost is known for such batches.
    """
    blocks = [others[start : start + _BLOCK] for start in range(0, len(others), _BLOCK)]
    return np.concatenate([np.empty(0), *(_apart(player, block) for block in blocks)])


def _apart(player: Player, others: Sequence[Trace]) -> np.ndarray:
    seen, done = (
        np.concatenate(each, axis=1) for each in zip(*((o.seen, o.done) for o in others), strict=True)
    )
    count = seen.shape[1]
    _begin(player, count)
    state, starts, differences = None, np.ones(count, bool), []
    for observation, theirs in zip(seen, done, strict=True):
        action, state = player.predict(observation, state, starts)
        differences.append(np.abs(_clipped(action) - theirs).mean(axis=1))
        starts = np.zeros(count, bool)
    return np.mean(differences, axis=0).reshape(len(others), _GAMES).mean(axis=1)


def alike(
    policies: Sequence[Policy], side: str, path: str | None, others: Mapping[str, Trace], seed: int
) -> list[str]:
    """Who of some policies plays like whom, one line each; none where each plays for itself.

    Args:
        policies: a submission's.
        side: which they play.
        path: how the opponent flies.
        others: traces of others' policies, by name.
        seed: of the rounds.

    Raises:
        PolicyFailed: one of them cannot be played.
    """
    known, found = dict(others), []
    for policy in policies:
        with host.PolicyHost(policy) as player:
            for name, distance in zip(known, apart(player, list(known.values())).tolist(), strict=True):
                if distance < ALIKE:
                    found.append(f"seed_{policy.seed} plays as {name} does ({distance:.3f} apart)")
            (known[f"seed_{policy.seed}"],) = traces([player], side, path, seed)
    return found


def told_apart(submission: Submission, board: Path | None = None) -> list[str]:
    """Who of a submission plays like whom of its own, of what the package ships, and of a board; a line each.

    Args:
        submission: a player's; of a script, a planner or the zoo there is nothing to tell.
        board: a leaderboard's folder; None: nobody else's submissions are compared.
    """
    if submission.track not in _VIEWS or submission.zoo is not None or not submission.policies:
        return []
    seed, side, path = fresh_seed(), submission.track, submission.path
    others = shipped_traces(side, path, seed)
    if board is not None:
        others |= _of_board(board, submission, seed)
    return alike(submission.policies, side, path, others, seed)


def _of_board(board: Path, submission: Submission, seed: int) -> dict[str, Trace]:
    """The traces of the other policies of a submission's table; those that cannot be played are left out."""
    found = {}
    for folder in sorted((board / "submissions" / submission.track).glob("[!.]*/")):
        with contextlib.suppress(UserError):
            other = load_submission(folder)
            if other.slug == submission.slug or other.path != submission.path or other.zoo is not None:
                continue
            for policy in other.policies:
                with host.PolicyHost(policy) as player:
                    name = f"{other.slug}/seed_{policy.seed}"
                    (found[name],) = traces([player], other.track, other.path, seed)
    return found


def shipped_traces(side: str, path: str | None, seed: int) -> dict[str, Trace]:
    """The traces of all agents of a side that the package ships, by their names."""
    players = dict(_shipped(side))
    return dict(zip(players, traces(list(players.values()), side, path, seed), strict=True))


def _shipped(side: str) -> Iterator[tuple[str, Player]]:
    home = agent.baselines_folder() / "agents"
    for folder in sorted(home.glob("*/*/seed_*"), key=Path.as_posix):
        name = folder.relative_to(home).as_posix()
        try:
            player = agent.load_agent(name, side)
        except UserError:  # of the other side
            continue
        yield name, player


def _begin(player: Any, count: int) -> None:
    if hasattr(player, "reset"):
        player.reset(np.ones(count, bool), np.arange(count, dtype=np.uint64) % _GAMES)


def _clipped(action: np.ndarray) -> np.ndarray:
    return np.clip(np.nan_to_num(action), -1, 1).astype(np.float32)
