"""Flying at somebody whose path is known, or thought to be."""

from __future__ import annotations

import numpy as np

from fpg_bench.game.compiling import compiled
from fpg_bench.game.flight import distance_m
from fpg_bench.planning.planner import Limits


@compiled
def chase(path, start, speed, lead, track):
    """Fly at the ally, second by second.

    Args:
        path: ``(T + 1, 3)`` where the ally is after each second.
        start: ``(3,)`` where the opponent starts.
        speed: its greatest speed, m/s.
        lead: aim at the first place where both can be at one time (True), or at where the ally is now.
        track: ``(T + 1, 3)`` is filled with where the opponent is after each second.
    """
    last, aim = path.shape[0] - 1, 0
    for axis in range(3):
        track[0, axis] = start[axis]
    for k in range(last):
        aim = max(aim, k + 1)
        while lead and aim < last and distance_m(track[k], path[aim]) > speed * (aim - k):
            aim += 1
        target = path[aim if lead else k]
        distance = distance_m(track[k], target)
        pace = min(speed, distance / (aim - k) if lead else distance)  # be there with it, not before it
        share = pace / distance if distance > 0.0 else 0.0
        for axis in range(3):
            track[k + 1, axis] = track[k, axis] + share * (target[axis] - track[k, axis])


def chase_waypoints(path: np.ndarray, start: np.ndarray, limits: Limits, lead: bool = True) -> np.ndarray:
    """The waypoints ``(n, 3)`` of a chase after an ally on ``path`` ``(T + 1, 3)``, in the box; all in m."""
    track = np.empty_like(path)
    chase(path, start, limits.speed_m_s, lead, track)
    seconds, due = np.arange(len(track)), limits.due_s()
    places = [np.interp(due, seconds, track[:, axis]) for axis in range(3)]
    return np.clip(np.column_stack(places), 0, limits.box_m)
