"""A short trial of a policy where submissions are played: whether its answers are what they must be."""

from __future__ import annotations

import numpy as np

from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.leaderboard.host import Limits, PolicyFailed, PolicyHost
from fpg_bench.leaderboard.policies import Policy

_GAMES, _FEW, _STEPS = 16, 5, 25
_ROUNDING = 1e-4


def trial(policy: Policy, limits: Limits | None = None) -> list[str]:
    """What goes wrong when a policy plays random observations, one line each.

    Its answers must be finite, within [-1, 1] and of the right shape, and those to one game must not depend
    on which other games are in the batch.
    """
    seen = np.random.default_rng(0).uniform(-1, 1, (_STEPS, _GAMES, OBSERVATION_SIZE)).astype(np.float32)
    try:
        with PolicyHost(policy, limits) as host:
            whole, lost = _played(host, seen)
            few, _ = _played(host, seen[:, :_FEW])
    except PolicyFailed as error:
        return [str(error)]
    if lost:
        return ["loses rounds: an answer is not finite, not in [-1, 1], or of another shape"]
    if not np.allclose(few, whole[:, :_FEW], atol=_ROUNDING):
        return ["its answer to one game depends on the other games of the batch"]
    return []


def _played(host: PolicyHost, seen: np.ndarray) -> tuple[np.ndarray, bool]:
    """The actions of some steps of a new round, and whether any game's round was lost."""
    games = seen.shape[1]
    host.reset(np.ones(games, bool), np.arange(games, dtype=np.uint64))
    state, actions, starts = None, [], np.ones(games, bool)
    for observation in seen:
        action, state = host.predict(observation, state, starts)
        actions.append(action)
        starts = np.zeros(games, bool)
    return np.array(actions), bool(host.invalid.any())
