"""Hill climbing: every part of the path steps uphill from its best place so far."""

from __future__ import annotations

import numpy as np

from fpg_bench.planning.parts import first_places, recent, waypoints_through
from fpg_bench.planning.planner import Limits, Plan

# Four directions that span space: steps along them tell a slope apart from a round that went well.
_CORNERS = np.array([[1, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]])
_STEP, _SHRINK = 0.2, 0.7  # first step by the box, and what each round leaves of it
_NEAR = 0.12  # how far a place tells about the hill, by the box's longest side
_NEIGHBOURS = 0.4  # how far in time, in parts
_LEAP, _LEAP_SHRINK = 0.25, 0.85  # longest way to a summit by the box's longest side, and as above
_FLAT = 0.03  # least curvature that a summit is believed of
_RIDGE = 0.01


class HillClimb:
    """Goes from each part's best place to the summit of a hill fitted around it, and tries a step aside.

    The ally repeats its path, so part i of all rounds of a match speaks of one place in its flight, and each
    part of a round is an experiment of its own. Needs no chance: the steps aside go round the corners of a
    tetrahedron, smaller each round.
    """

    name, tier = "hill-climb", "history"

    def plan(
        self, history: np.ndarray, current_position: np.ndarray, limits: Limits, rng: np.random.Generator
    ) -> Plan:
        """The first round flies a circle; ``history`` is all that is learned from."""
        places = first_places(limits) if len(history) == 0 else _next_places(history, limits)
        return Plan(waypoints_through(places, current_position, limits), self.name)


def _next_places(history: np.ndarray, limits: Limits) -> np.ndarray:
    """``(n, 3)`` in m: best places, moved uphill where two rounds or more tell where that is, and aside."""
    rounds, box = len(history), np.asarray(limits.box_m)
    history = recent(history)
    flown, heights = history[..., :3], _heights(history[..., 3])
    best = flown[heights.argmax(axis=0), np.arange(limits.waypoints)]
    places = best + _CORNERS[rounds % 4] * box * _STEP * _SHRINK ** (rounds - 1)
    if rounds > 1:
        leap = _uphill(best, flown, heights, _NEAR * box.max())
        longest = _LEAP * box.max() * _LEAP_SHRINK ** (rounds - 1)
        places += leap * np.minimum(
            1, longest / np.maximum(np.linalg.norm(leap, axis=1, keepdims=True), 1e-9)
        )
    return np.clip(places, 0, box)


def _heights(rewards: np.ndarray) -> np.ndarray:
    """Logarithms: rewards rise by a factor, not by an amount, as the distance falls by a factor."""
    above = rewards - min(0.0, rewards.min())
    return np.log(above / max(above.mean(), 1e-9) + 0.2)


def _uphill(best: np.ndarray, flown: np.ndarray, heights: np.ndarray, near_m: float) -> np.ndarray:
    """The way from each part's best place to the summit of the round hill that fits what was flown near it.

    Least squares of ``height = a + g . x - c |x|^2``, x the way from the best place by ``near_m``; what lies
    nearer, in place and in time, counts more. The summit lies at ``g / 2c``.

    Args:
        best: ``(n, 3)`` in m. flown: ``(rounds, n, 3)`` in m. heights: ``(rounds, n)``.
    """
    parts = np.arange(len(best))
    away = (flown[None] - best[:, None, None]) / near_m  # (n, rounds, n, 3)
    squared = (away**2).sum(axis=-1)
    later = (parts[:, None] - parts) / _NEIGHBOURS
    weights = np.exp(-(later[:, None] ** 2 + squared) / 2)
    weights /= weights.sum(axis=(1, 2), keepdims=True)
    terms = np.concatenate([away, -squared[..., None]], axis=-1)
    terms -= np.einsum("irj,irjt->it", weights, terms)[:, None, None]
    rise = heights - np.einsum("irj,rj->i", weights, heights)[:, None, None]
    normal = np.einsum("irj,irjt,irju->itu", weights, terms, terms) + _RIDGE * np.eye(4)
    fitted = np.linalg.solve(normal, np.einsum("irj,irjt,irj->it", weights, terms, rise)[..., None])[..., 0]
    return near_m * fitted[:, :3] / (2 * np.maximum(fitted[:, 3:], _FLAT))
