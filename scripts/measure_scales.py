"""Measure the scale of each suite, and compare it with that in the suite's file.

python scripts/measure_scales.py [SUITE ...]

zero: mean return per step of the random player or planner; random: the same in a suite that borrows zero and
top from its track's public one. top: for allies a link that nobody jams, for
others the mean over rivals of the best known return, of the oracle and all scripts for players, of scripts
for teams, and of ``optimised`` for planners. On the evaluation seeds of the suite.
"""

from __future__ import annotations

import dataclasses
from statistics import fmean
from typing import Annotated

import typer
from command import run

from fpg_bench.common.ids import ALLIES, OPPONENTS, SCRIPTED
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.suite import PLANNER, Rival, Scale, Suite, load_suite, suite_names
from fpg_bench.game.flight import thriftiest_m_s
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.spec import GameSpec

DIGITS = 2
OLDER = "-paper-"  # than the scripts with memory; its allies have no bound but the best known
BORROWING = ("-shifted-", "-responses-", "-strangers-", "-season-")  # their track's public suite's zero, top


def rewards(name: str, suite: Suite) -> list[float]:
    """Return the mean return per step of a player or planner against each rival."""
    records = [play(player_entry(name), suite, rival) for rival in suite.rivals]
    return [float(suite.rewards(record.returns).mean()) for record in records]


def unjammed(scenario: Scenario, game: GameSpec | None) -> float:
    """Return what an ally earns per step that nobody jams: the cap, or the mean utility at the best speed.

    Allies of a team have a point each.
    """
    if scenario.snr_cap_db is not None:
        return scenario.snr_cap_db - scenario.snr_threshold_db
    slow, fast = scenario.ally_speed_m_s
    if scenario.flight_cost_per_w:
        slow = min(max(thriftiest_m_s(), slow), fast)
    quiet = dataclasses.replace(scenario, opponent_power_dbm=-100.0, ally_speed_m_s=(slow, slow))
    rivals = (Rival("nobody", ("tone",), quiet),)
    best = "idle" if game is None else "allotment"
    return rewards(best, Suite("unjammed", "ally", quiet, 100, rivals, game=game))[0]


def scale(suite: Suite) -> Scale:
    """Return the scale of a suite."""
    zero = round(fmean(rewards("random", suite)), DIGITS)
    if any(part in suite.name for part in BORROWING):
        return dataclasses.replace(suite.scale, random=zero)
    return Scale(zero, round(top(suite), DIGITS))


def top(suite: Suite) -> float:
    """Return the reward per step that scores 100."""
    if suite.side == "ally" and OLDER not in suite.name:
        return unjammed(suite.scenario, suite.game)
    if suite.game is not None:
        by_rival = zip(*(rewards(name, suite) for name in suite.game.scripts[suite.side]), strict=True)
        return fmean(map(max, by_rival))
    older = {"ally": ALLIES, "opponent": OPPONENTS}
    scripts = (older if OLDER in suite.name else SCRIPTED).get(suite.side, ())
    bounds = ("optimised",) if suite.side == PLANNER else ("oracle", *scripts)
    by_rival = zip(*(rewards(name, suite) for name in bounds), strict=True)
    return fmean(map(max, by_rival))


def main(suites: Annotated[list[str] | None, typer.Argument()] = None) -> int:
    """Print a line per suite, of all shipped ones by default; returns 1 if a file has another scale."""
    differ = False
    for suite in map(load_suite, suites or suite_names()):
        found = scale(suite)
        is_same = suite.scale in (Scale(), found)
        differ |= not is_same
        note = "" if is_same else f"  (in the file: {suite.scale})"
        shown = ", ".join(f"{key}: {value}" for key, value in vars(found).items() if value is not None)
        print(f"{suite.name}: scale: {{{shown}}}{note}")
    return int(differ)


if __name__ == "__main__":
    run(main)
