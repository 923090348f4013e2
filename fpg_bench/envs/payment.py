"""What a learner is paid for: the reward of the rules, or another one that makes it behave differently.

Players that answer the same fixed player differ most by what they are paid for. ``jamming``, ``overlap`` and
``spending`` are things that the opponent raises and the ally lowers, each in its own unit.
"""

from __future__ import annotations

import numpy as np

from fpg_bench.game.scenario import Scenario

REWARDS = ("own", "against", "jamming", "overlap", "spending")


def pay(reward: str, side: str, games: np.ndarray, scenario: Scenario) -> np.ndarray:
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
    if reward == "against":
        return -games[f"{other}_reward"]
    found = _of_opponent(reward, games, scenario)
    return found if side == "opponent" else -found


def _of_opponent(reward: str, games: np.ndarray, scenario: Scenario) -> np.ndarray:
    """``(N,)`` float64: what the opponent raises and the ally lowers."""
    if reward == "spending":
        cap = np.inf if scenario.snr_cap_db is None else scenario.snr_cap_db
        unspent = np.minimum(games["snr_db"], cap) - scenario.snr_threshold_db
        return unspent - games["ally_reward"]
    outage = games["snr_db"] < scenario.snr_threshold_db
    return (games["covered"] & (outage | (reward == "overlap"))).astype(float)
