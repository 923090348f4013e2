"""Measure what a planner's first round is worth at best while nothing is known of the ally's path.

python scripts/measure_first_round.py [--field planner-v1] [--matches 400]

The blind planner knows the game's rules and how paths are drawn, and nothing of this match but its own
start: for each start it looks for the one path that is worth most in the mean over many other matches' paths.
It stands beside the package's planners that know nothing. The upper end of its interval over matches is the
bound ``FIRST_ROUND`` of ``fpg_bench/leaderboard/planner_marks.py``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import numpy as np

from fpg_bench.envs.duel import Duel
from fpg_bench.evaluation.field import Field
from fpg_bench.evaluation.field_file import load_field
from fpg_bench.evaluation.play import rounds, table_of
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.evaluation.statistics import MATCHES, Interval, mean_interval
from fpg_bench.game.scenario import Scenario
from fpg_bench.planning import PATTERNS, BatchPlanner, Plan, Request, as_planner
from fpg_bench.planning.sighted import Optimised

PATHS = 256  # of other matches, that a path is judged by
STEPS_M = (160.0, 80.0, 40.0, 20.0)


class Blind(BatchPlanner):
    """Flies the path that is worth most in the mean over paths that the ally may fly."""

    name, tier = "blind", "none"

    def __init__(self, scenario: Scenario, paths: np.ndarray) -> None:
        self._paths, self._optimised = paths, Optimised(scenario)
        self._known: dict[int, np.ndarray] = {}  # every ally is met on the same starts

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """The best path from each round's start."""
        for request in requests:
            if request.seed not in self._known:
                self._known[request.seed] = self._best(request)
        return [Plan(self._known[request.seed], self.name) for request in requests]

    def _best(self, request: Request) -> np.ndarray:
        limits = request.limits
        waypoints = np.tile(np.array(limits.box_m) / 2, (limits.waypoints, 1))
        self._optimised.improve(waypoints, self._paths, request, np.array(STEPS_M))
        return waypoints


def paths_of(field: Field, seeds: Sequence[int]) -> np.ndarray:
    """``(n, T + 1, 3)`` in m: the allies' paths in the matches of these seeds."""
    duel = Duel(field.scenario, len(seeds), as_planner("hold", field.scenario))
    duel.reset(seeds=np.array(seeds))
    return np.array([duel.arena.ally_path(game) for game in range(len(seeds))])


def first_round(planner: Any, field: Field, seeds: Sequence[int]) -> Interval:
    """A planner's return a step in first rounds, the mean over the field, with its interval over matches."""
    found = []
    for met in field.counterparts:
        table = table_of(planner, field, met, len(seeds))
        duel = next(rounds(table, field, lambda count: list(seeds)))
        found.append(duel.arena.tallies[field.returned] / field.scenario.steps_per_round)
    return mean_interval(np.mean(found, axis=0), MATCHES)


def main() -> None:
    """Print a line per planner."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--field", default="planner-v1")
    parser.add_argument("--matches", type=int, default=400)
    words = parser.parse_args()
    field, seeds = load_field(words.field), tuning_seeds(PATHS + words.matches)
    for planner in (Blind(field.scenario, paths_of(field, seeds[:PATHS])), *PATTERNS):
        found = first_round(planner, field, seeds[PATHS:])
        name = planner if isinstance(planner, str) else planner.name
        print(f"{name}: {found.value:.2f} [{found.low:.2f}, {found.high:.2f}] a step", flush=True)


if __name__ == "__main__":
    main()
