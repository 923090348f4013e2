"""Measure the scale of each public suite, and compare it with that in the suite's file.

python scripts/measure_scales.py [SUITE ...]

zero: mean return per step of the random player or planner. top: for allies in a game with capped SNR the
unjammed link, cap - M per step; otherwise the mean over rivals of the best known return, of the oracle and
all scripts for players, and of ``optimised`` for planners. On the evaluation seeds of the suite.
"""

from __future__ import annotations

import argparse
import re
import sys
from statistics import fmean

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import OPPONENTS, SCRIPTED
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.suite import PLANNER, Suite, load_suite
from fpg_bench.players.agent import suites_folder

DIGITS = 2
OLDER = re.compile(r"opponent-(learned-|paper-)?v1")  # suites that are older than the scripts with memory
BORROWING = ("-shifted-v1", "-responses-v1")  # suites with the scale of their track's public suite


def rewards(name: str, suite: Suite) -> list[float]:
    """Return the mean return per step of a player or planner against each rival."""
    records = [play(player_entry(name), suite, rival) for rival in suite.rivals]
    return [float(suite.rewards(record.returns).mean()) for record in records]


def scale(suite: Suite) -> tuple[float, float]:
    """Return zero and top of a suite."""
    zero = fmean(rewards("random", suite))
    cap = suite.scenario.snr_cap_db
    if suite.side == "ally" and cap is not None:
        return zero, cap - suite.scenario.snr_threshold_db
    scripts = OPPONENTS if OLDER.fullmatch(suite.name) else SCRIPTED.get(suite.side, ())
    bounds = ("optimised",) if suite.side == PLANNER else ("oracle", *scripts)
    by_rival = zip(*(rewards(name, suite) for name in bounds), strict=True)
    return zero, fmean(map(max, by_rival))


def main() -> int:
    """Print a line per suite; returns 1 if a file has another scale."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("suites", nargs="*", help="names or files; default: all public ones")
    public = sorted(path.stem for path in suites_folder().glob("*-v[0-9].yml"))
    names = parser.parse_args().suites or [name for name in public if not name.endswith(BORROWING)]
    differ = False
    for suite in map(load_suite, names):
        zero, top = (round(value, DIGITS) for value in scale(suite))
        is_same = (suite.scale.zero, suite.scale.top) == (zero, top)
        differ |= not is_same
        note = "" if is_same else f"  (in the file: {suite.scale})"
        print(f"{suite.name}: scale: {{zero: {zero}, top: {top}}}{note}")
    return int(differ)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except UserError as error:
        sys.exit(f"measure_scales: {error}")
