"""CMA-ES: every part of the path is a search of its own in space, led by the package ``cmaes``."""

from __future__ import annotations

import numpy as np

from fpg_bench.planning.parts import first_places, recent, waypoints_through
from fpg_bench.planning.planner import Limits, Plan

_POPULATION = 4  # the smallest from which the package learns a covariance
_SPREAD = 6  # the box by the first standard deviation


class CMAES:
    """One CMA-ES of dimension three for each part of the path, one candidate a round.

    The whole path at once would be 48 numbers and ten evaluations; part by part, each round tells about
    each part, and about its neighbours, whose ally is nearly at the same place. A generation is the best four
    of all that was flown there and before, told after each round from the second on. What is told is
    what was *flown*, as the history holds it: so the search is the same whenever it is made anew, and
    only the next candidate is left to chance.
    """

    name, tier = "cma-es", "history"

    def plan(
        self, history: np.ndarray, current_position: np.ndarray, limits: Limits, rng: np.random.Generator
    ) -> Plan:
        """Asks each part's search for a candidate, after telling it what was flown."""
        # In units of the spread, space is as wide as it is high, and the searches begin with a step of 1
        unit = np.asarray(limits.box_m) / _SPREAD
        flown = recent(history) / np.append(unit, 1.0)
        middles, seeds = first_places(limits) / unit, rng.integers(2**31, size=limits.waypoints)
        asked = [
            _candidate(middle, flown[:, max(0, part - 1) : part + 2], int(seed))
            for part, (middle, seed) in enumerate(zip(middles, seeds, strict=True))
        ]
        return Plan(waypoints_through(np.array(asked) * unit, current_position, limits), self.name)


def _candidate(middle: np.ndarray, flown: np.ndarray, seed: int) -> np.ndarray:
    """``(3,)``: where to go next, by a search that begins at ``middle`` and is told what was flown.

    Args:
        middle: ``(3,)``, in units of the spread, as all places here.
        flown: ``(rounds, parts, 4)``: places with rewards, of this part and its neighbours.
        seed: of the candidate.
    """
    from cmaes import CMA  # brings scipy along, too slow to load for those who plan otherwise

    bounds = np.array([[0, _SPREAD]] * 3)
    search = CMA(mean=middle, sigma=1.0, bounds=bounds, seed=seed, population_size=_POPULATION)
    for rounds in range(1, len(flown) + 1):
        tried = flown[:rounds].reshape(-1, 4)
        if rounds > 1 and len(tried) >= _POPULATION and not search.should_stop():
            best = tried[np.argsort(-tried[:, 3], kind="stable")[:_POPULATION]]
            search.tell([(place[:3], -place[3]) for place in best])
    return search.ask()
