"""A short trial of a policy where submissions are played: whether its answers are what they must be."""

from __future__ import annotations

import numpy as np

from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.leaderboard import host
from fpg_bench.leaderboard.host import Limits, PolicyFailed
from fpg_bench.leaderboard.policies import Policy

_GAMES, _FEW, _STEPS = 16, 5, 25
_ROUNDING = 1e-4
_DEPENDS = "its answer to one game depends on the other games of the batch"


def trial(policy: Policy, limits: Limits | None = None) -> list[str]:
    """What goes wrong when a policy plays random observations, one line each.

    Its answers must be finite, within [-1, 1] and of the right shape, and those to one game must not depend
    on which other games are in the batch.
    """
    try:
        lost, depends = _tried(policy, limits)
    except PolicyFailed as error:
        return [str(error)]
    if lost:
        return ["loses rounds: an answer is not finite, not in [-1, 1], or of another shape"]
    return [_DEPENDS] if depends else []


def check_batch(policy: Policy, limits: Limits | None = None) -> None:
    """Refuse a policy whose answer to one game depends on the other games of the batch.

    Raises:
        PolicyFailed: it does, or it cannot be played.
    """
    _, depends = _tried(policy, limits)
    if depends:
        raise PolicyFailed(_DEPENDS)


def _tried(policy: Policy, limits: Limits | None) -> tuple[bool, bool]:
    """Whether any round is lost, and whether answers depend on the batch."""
    seen = np.random.default_rng(0).uniform(-1, 1, (_STEPS, _GAMES, OBSERVATION_SIZE)).astype(np.float32)
    with host.PolicyHost(policy, limits) as player:
        whole, lost = _played(player, seen)
        few, _ = _played(player, seen[:, :_FEW])
    return lost, not np.allclose(few, whole[:, :_FEW], atol=_ROUNDING)


def _played(player: host.PolicyHost, seen: np.ndarray) -> tuple[np.ndarray, bool]:
    """The actions of some steps of a new round, and whether any game's round was lost."""
    games = seen.shape[1]
    player.reset(np.ones(games, bool), np.arange(games, dtype=np.uint64))
    state, actions, starts = None, [], np.ones(games, bool)
    for observation in seen:
        action, state = player.predict(observation, state, starts)
        actions.append(action)
        starts = np.zeros(games, bool)
    return np.array(actions), bool(player.invalid.any())
