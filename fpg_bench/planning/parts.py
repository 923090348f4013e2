"""A path by the places in the middle of its parts: what a history tells, and what planners learn from it."""

from __future__ import annotations

import numpy as np

from fpg_bench.planning.planner import Limits

_REMEMBERED = 50  # a planner that learns flies near its best places again and again, so few rounds suffice
_TURNS, _SHARE = 1.6, 7.5  # of the first circle: how often round, and the box by its radius


def recent(history: np.ndarray) -> np.ndarray:
    """The last rounds of a history, so that planning takes bounded time in a match of any length."""
    return history[-_REMEMBERED:]


def first_places(limits: Limits) -> np.ndarray:
    """``(n, 3)`` in m: a circle around the box's middle, which is never far from any path in the box."""
    middle = np.asarray(limits.box_m) / 2
    angle = 2 * np.pi * _TURNS * (np.arange(limits.waypoints) + 0.5) / limits.waypoints
    around = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    return middle + min(limits.box_m[:2]) / _SHARE * around


def waypoints_through(places: np.ndarray, start: np.ndarray, limits: Limits) -> np.ndarray:
    """Waypoints of a path that comes as near to the places as the speed allows.

    Args:
        places: ``(n, 3)`` in m, where to be in the middle of each part.
        start: ``(3,)`` in m, where the round starts.
        limits: what the path must keep to.

    Returns:
        ``(n, 3)`` in m, inside the box; each can be reached in time from the one before.
    """
    ahead = np.vstack([places[1:], 2 * places[-1:] - places[-2:-1] if len(places) > 1 else places])
    path = np.clip(np.vstack([start[None], (places + ahead) / 2]), 0, limits.box_m)
    longest = limits.speed_m_s * limits.round_s / limits.waypoints
    _slacken(path, longest)
    for i in range(1, len(path)):  # what is left over: each point waits for the one before
        step = path[i] - path[i - 1]
        path[i] = path[i - 1] + step * min(1.0, longest / max(float(np.linalg.norm(step)), 1e-9))
    return np.clip(path[1:], 0, limits.box_m)


def _slacken(path: np.ndarray, longest: float) -> None:
    """Draw points together where a step is too long, so that places out of reach are met halfway."""
    start = path[0].copy()
    for _ in range(30):
        steps = np.diff(path, axis=0)
        lengths = np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-9)
        excess = steps * np.maximum(1 - longest / lengths, 0) / 2
        path[1:] -= excess
        path[:-1] += excess
        path[0] = start
