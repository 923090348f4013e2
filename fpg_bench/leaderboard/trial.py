"""A short trial of a policy where submissions are played: whether its answers are what they must be."""

from __future__ import annotations

import dataclasses

import numpy as np

from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.field import Counterpart, Field
from fpg_bench.evaluation.play import play
from fpg_bench.game.state import OBSERVATION_SIZE
from fpg_bench.leaderboard import host
from fpg_bench.leaderboard.host import PolicyFailed
from fpg_bench.leaderboard.policies import Policy

_GAMES, _STEPS, _ROUNDS = 16, 25, 6


def trial(policy: Policy, field: Field | None = None) -> list[str]:
    """What goes wrong when a policy plays random observations and some rounds, one line each.

    Its answers must be finite, within [-1, 1] and of the right shape.

    Args:
        policy: what is tried.
        field: whose first and last counterpart it meets for some rounds; None: it meets nobody.
    """
    try:
        with host.PolicyHost(policy) as player:
            lost = _random(player)
            for few, counterpart in _some(field):
                play(player_entry(player), few, counterpart)
    except PolicyFailed as error:
        return [str(error)]
    return ["loses rounds: an answer is not finite, not in [-1, 1], or of another shape"] if lost else []


def _random(player: host.PolicyHost) -> bool:
    """Play random observations; whether any round is lost by them."""
    rng = np.random.default_rng(0)
    player.reset(np.ones(_GAMES, bool), np.arange(_GAMES, dtype=np.uint64))
    state, starts = None, np.ones(_GAMES, bool)
    for _ in range(_STEPS):
        seen = rng.uniform(-1, 1, (_GAMES, OBSERVATION_SIZE)).astype(np.float32)
        _, state = player.predict(seen, state, starts)
        starts = np.zeros(_GAMES, bool)
    return bool(player.invalid.any())


def _some(field: Field | None) -> list[tuple[Field, Counterpart]]:
    if field is None:
        return []
    few = dataclasses.replace(field, matches=-(-_ROUNDS // field.rounds_per_match))
    return [
        (few, counterpart) for counterpart in dict.fromkeys([field.counterparts[0], field.counterparts[-1]])
    ]
