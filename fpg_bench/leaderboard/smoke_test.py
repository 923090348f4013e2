"""A short trial of a policy where submissions are played: whether its answers are what they must be."""

from __future__ import annotations

import dataclasses

import numpy as np

from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.suite import Rival, Suite
from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.leaderboard import policy_client as host
from fpg_bench.leaderboard.policies import Policy
from fpg_bench.leaderboard.policy_client import PolicyFailed

_GAMES, _STEPS, _ROUNDS = 16, 25, 6


def trial(policy: Policy, suite: Suite | None = None) -> list[str]:
    """What goes wrong when a policy plays random observations and some rounds, one line each.

    Its answers must be finite, within [-1, 1] and of the right shape.

    Args:
        policy: what is tried.
        suite: whose first and last rival it meets for some rounds; None: it meets nobody.
    """
    try:
        with host.PolicyClient(policy) as player:
            lost = _random(player)
            for few, rival in _some(suite):
                play(player_entry(player), few, rival)
    except PolicyFailed as error:
        return [str(error)]
    return ["loses rounds: an answer is not finite, not in [-1, 1], or of another shape"] if lost else []


def _random(player: host.PolicyClient) -> bool:
    """Play random observations; whether any round is lost by them."""
    rng = np.random.default_rng(0)
    player.reset(np.ones(_GAMES, bool), np.arange(_GAMES, dtype=np.uint64))
    state, starts = None, np.ones(_GAMES, bool)
    for _ in range(_STEPS):
        seen = rng.uniform(-1, 1, (_GAMES, OBSERVATION_SIZE)).astype(np.float32)
        _, state = player.predict(seen, state, starts)
        starts = np.zeros(_GAMES, bool)
    return bool(player.invalid.any())


def _some(suite: Suite | None) -> list[tuple[Suite, Rival]]:
    if suite is None:
        return []
    few = dataclasses.replace(suite, matches=-(-_ROUNDS // suite.rounds_per_match))
    return [(few, rival) for rival in dict.fromkeys([suite.rivals[0], suite.rivals[-1]])]
