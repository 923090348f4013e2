"""Measure the two constants of each public suite's scale, and compare them with those that stand in its file.

python scripts/measure_scales.py [FIELD ...]

zero: the random player's (or planner's) mean return a step over the suite. top: for allies in a game whose
SNR is capped the unjammed link, cap - M a step; otherwise the mean over rivals of the best that is
known: the oracle and all scripts for players, the planner ``optimised`` for planners. On the suite's own
evaluation seeds.
"""

from __future__ import annotations

import argparse
import sys

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.suite import PLANNER, Suite, load_suite
from fpg_bench.players.agent import suites_folder
from fpg_bench.players.scripted import SCRIPTED

DIGITS = 2
BORROWING = ("-shifted-v1", "-responses-v1")  # have the scale of their track's public suite


def rewards(who: str, suite: Suite) -> list[float]:
    """The mean return a step of a player or planner against each rival."""
    records = [play(player_entry(who), suite, rival) for rival in suite.rivals]
    return [float(suite.rewards(record.returns).mean()) for record in records]


def scale(suite: Suite) -> tuple[float, float]:
    """Zero and top of a suite."""
    zero = mean(rewards("random", suite))
    cap = suite.scenario.snr_cap_db
    if suite.side == "ally" and cap is not None:
        return zero, cap - suite.scenario.snr_threshold_db
    bounds = ("optimised",) if suite.side == PLANNER else ("oracle", *SCRIPTED[suite.side])
    each = [rewards(who, suite) for who in bounds]
    return zero, mean([max(against) for against in zip(*each, strict=True)])


def mean(values: list[float]) -> float:
    """The mean of some numbers."""
    return sum(values) / len(values)


def main() -> int:
    """Print a line per suite; 1 where a file says something else."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("suites", nargs="*", help="names or files; default: all public ones")
    named = parser.parse_args().suites
    public = (path.stem for path in suites_folder().glob("*-v1.yml"))
    names = named or sorted(name for name in public if not name.endswith(BORROWING))
    same = True
    for name in names:
        suite = load_suite(name)
        zero, top = (round(value, DIGITS) for value in scale(suite))
        kept = (suite.scale.zero, suite.scale.top) == (zero, top)
        same = same and kept
        print(f"{name}: scale: {{zero: {zero}, top: {top}}}{'' if kept else f'  (the file: {suite.scale})'}")
    return 0 if same else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except UserError as error:
        sys.exit(f"measure_scales: {error}")
