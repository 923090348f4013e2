"""Valid paths that are of no use, by cheap signs: a model may keep to the form and say nothing."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from fpg_bench.planning.planner import Request

EXAMPLE, STILL, UNFLYABLE, REPEATED = "example", "still", "unflyable", "repeated"
STILL_M = 10.0  # a path that keeps within so much of its middle stands still
SAME_M = 1.0  # a point this near to another is copied from it: prompts hold whole metres
_MOST = 0.75  # of a path's points, where most of them are copied
_FAR = 1.01  # a leg so many times what can be flown is too long: points are whole metres


def why_useless(
    waypoints: np.ndarray, request: Request, example: np.ndarray, past: Iterable[np.ndarray]
) -> str:
    """The first sign by which a valid path is of no use.

    Args:
        waypoints: ``(n, 3)`` in m, the path.
        request: what was asked.
        example: ``(m, 3)`` in m, the points that the prompt has as an example.
        past: ``(n, 3)`` in m, the match's paths before.

    Returns:
        ``example``: more than one of its points is one of the example's; ``still``: all its points lie
        within 10 m of their middle; ``unflyable``: more than half of its legs are longer than the opponent
        flies in their time; ``repeated``: three quarters of its points are those of one path before, or of
        one past round as the history shows it. Empty: none of these.
    """
    if sum(_near(waypoints, point).any() for point in example) > 1:
        return EXAMPLE
    if (np.linalg.norm(waypoints - waypoints.mean(axis=0), axis=1) <= STILL_M).all():
        return STILL
    if _too_long(waypoints, request).mean() > 0.5:
        return UNFLYABLE
    known = [*past, *request.history[..., :3]]
    return REPEATED if any(_near(waypoints, path).mean() >= _MOST for path in known) else ""


def _near(waypoints: np.ndarray, other: np.ndarray) -> np.ndarray:
    """``(n,)`` bool: which points are those of another path, or are one point."""
    found: np.ndarray = np.abs(waypoints - other).max(axis=1) <= SAME_M
    return found


def _too_long(waypoints: np.ndarray, request: Request) -> np.ndarray:
    """``(n,)`` bool: which legs are longer than what is flown in their time."""
    due_s = np.diff(request.limits.due_s(), prepend=0.0)
    legs_m = np.linalg.norm(np.diff(waypoints, axis=0, prepend=request.current_position[None]), axis=1)
    found: np.ndarray = legs_m > _FAR * request.limits.speed_m_s * due_s
    return found
