"""Search planners: hill climbing and CMA-ES over the middles of the path's parts.

The ally repeats its path in every round of a match. Part i of all rounds therefore tests one place along its
flight, and each part of a round is an experiment of its own.
"""

from __future__ import annotations

import numpy as np

from fpg_bench.common.extras import require_extra
from fpg_bench.players.planner import Array, Limits, Plan

_REMEMBERED = 50  # rounds; the search flies near its best places again and again, so few suffice
_TURNS, _SHARE = 1.6, 7.5  # of the first circle: number of turns, and the box by its radius

# Hill climbing. Steps along four directions that span space tell a slope from a round that went well.
_CORNERS = np.array([[1, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]])
_STEP, _SHRINK = 0.2, 0.7  # first step by the box, and the factor per round
_NEAR = 0.12  # length scale of the fitted hill, by the box's longest side
_NEIGHBOURS = 0.4  # length scale in time, in parts
_LEAP, _LEAP_SHRINK = 0.25, 0.85  # longest way to a summit by the box's longest side, and as above
_FLAT = 0.03  # least curvature of a summit
_RIDGE = 0.01

# CMA-ES
_POPULATION = 4  # the smallest from which the package learns a covariance
_SPREAD = 6  # the box by the first standard deviation


class HillClimb:
    """Hill climbing: flies from each part's best place to the summit of a hill fitted around it.

    Every path also takes a step aside, around the corners of a tetrahedron that shrinks each round. The
    planner is deterministic.
    """

    name, tier = "hill-climb", "history"

    def plan(self, history: Array, current_position: Array, limits: Limits, rng: np.random.Generator) -> Plan:
        """Return the next path; the first round flies a circle."""
        places = first_places(limits) if len(history) == 0 else _next_places(history, limits)
        return Plan(waypoints_through(places, current_position, limits), self.name)


class CMAES:
    """CMA-ES: one search of dimension three for each part of the path, by the package ``cmaes``.

    The whole path at once would be 48 numbers and ten evaluations. Part by part, each round is a sample for
    each part and for its neighbours, where the ally is at nearly the same place. A generation consists of the
    best four samples so far, from the second round on. Samples are the positions actually *flown*, as the
    history holds them, so the search can be rebuilt at any time; only the next candidate is random.
    """

    name, tier = "cma-es", "history"

    def __init__(self) -> None:
        require_extra("evaluate", "cmaes")

    def plan(self, history: Array, current_position: Array, limits: Limits, rng: np.random.Generator) -> Plan:
        """Return a path through one candidate per part."""
        # In units of the spread, space is as wide as it is high, and the searches begin with a step of 1
        unit = np.asarray(limits.box_m) / _SPREAD
        flown = recent(history) / np.append(unit, 1.0)
        middles, seeds = first_places(limits) / unit, rng.integers(2**31, size=limits.waypoints)
        candidates = [
            _candidate(middle, flown[:, max(0, part - 1) : part + 2], int(seed))
            for part, (middle, seed) in enumerate(zip(middles, seeds, strict=True))
        ]
        return Plan(waypoints_through(np.array(candidates) * unit, current_position, limits), self.name)


def recent(history: Array) -> Array:
    """Return the last rounds of a history, which bounds planning time in matches of any length."""
    return history[-_REMEMBERED:]


def first_places(limits: Limits) -> Array:
    """Return places ``(n, 3)`` in m on a circle around the box's middle, never far from any path."""
    middle = np.asarray(limits.box_m) / 2
    angle = 2 * np.pi * _TURNS * (np.arange(limits.waypoints) + 0.5) / limits.waypoints
    around = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    return middle + min(limits.box_m[:2]) / _SHARE * around


def waypoints_through(places: Array, start: Array, limits: Limits) -> Array:
    """Return the waypoints of a path that comes as near to some places as the speed allows.

    Args:
        places: ``(n, 3)`` in m, the wanted position in the middle of each part.
        start: ``(3,)`` in m, the position at the start of the round.
        limits: of the plan.

    Returns:
        ``(n, 3)`` in m, inside the box; each can be reached in time from the one before.
    """
    ahead = np.vstack([places[1:], 2 * places[-1:] - places[-2:-1] if len(places) > 1 else places])
    path = np.clip(np.vstack([start[None], (places + ahead) / 2]), 0, limits.box_m)
    longest = limits.speed_m_s * limits.round_s / limits.waypoints
    _slacken(path, longest)
    for i in range(1, len(path)):  # remaining excess: each point waits for the one before
        step = path[i] - path[i - 1]
        path[i] = path[i - 1] + step * min(1.0, longest / max(float(np.linalg.norm(step)), 1e-9))
    return np.clip(path[1:], 0, limits.box_m)


def _slacken(path: Array, longest: float) -> None:
    """Draw points together where a step is too long, so that places out of reach are met halfway."""
    start = path[0].copy()
    for _ in range(30):
        steps = np.diff(path, axis=0)
        lengths = np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-9)
        excess = steps * np.maximum(1 - longest / lengths, 0) / 2
        path[1:] -= excess
        path[:-1] += excess
        path[0] = start


def _next_places(history: Array, limits: Limits) -> Array:
    """Return hill climbing's places ``(n, 3)`` in m: the best ones, moved uphill and aside."""
    rounds, box = len(history), np.asarray(limits.box_m)
    history = recent(history)
    flown, heights = history[..., :3], _heights(history[..., 3])
    best = flown[heights.argmax(axis=0), np.arange(limits.waypoints)]
    places = best + _CORNERS[rounds % 4] * box * _STEP * _SHRINK ** (rounds - 1)
    if rounds > 1:
        leap = _uphill(best, flown, heights, _NEAR * box.max())
        longest = _LEAP * box.max() * _LEAP_SHRINK ** (rounds - 1)
        length = np.maximum(np.linalg.norm(leap, axis=1, keepdims=True), 1e-9)
        places += leap * np.minimum(1, longest / length)
    inside: Array = np.clip(places, 0, box)
    return inside


def _heights(rewards: Array) -> Array:
    """Return logarithms of the rewards, which rise by a factor as the distance falls by a factor."""
    above = rewards - min(0.0, rewards.min())
    heights: Array = np.log(above / max(above.mean(), 1e-9) + 0.2)
    return heights


def _uphill(best: Array, flown: Array, heights: Array, near_m: float) -> Array:
    """Return the way from each part's best place to the summit of the round hill fitted around it.

    Weighted least squares of ``height = a + g . x - c |x|^2``, with x the way from the best place by
    ``near_m``. Samples nearer in place and in time weigh more. The summit lies at ``g / 2c``.

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
    solution = np.linalg.solve(normal, np.einsum("irj,irjt,irj->it", weights, terms, rise)[..., None])[..., 0]
    way: Array = near_m * solution[:, :3] / (2 * np.maximum(solution[:, 3:], _FLAT))
    return way


def _candidate(middle: Array, flown: Array, seed: int) -> Array:
    """Return the next place ``(3,)`` of a CMA-ES search.

    Args:
        middle: ``(3,)``, the initial mean, in units of the spread, as all places here.
        flown: ``(rounds, parts, 4)``: places with rewards, of this part and its neighbours.
        seed: of the candidate.
    """
    from cmaes import CMA  # imports scipy, which is slow to load

    bounds = np.array([[0, _SPREAD]] * 3)
    search = CMA(mean=middle, sigma=1.0, bounds=bounds, seed=seed, population_size=_POPULATION)
    for rounds in range(1, len(flown) + 1):
        samples = flown[:rounds].reshape(-1, 4)
        if rounds > 1 and len(samples) >= _POPULATION and not search.should_stop():
            best = samples[np.argsort(-samples[:, 3], kind="stable")[:_POPULATION]]
            search.tell([(sample[:3], -sample[3]) for sample in best])
    candidate: Array = search.ask()
    return candidate
