"""Playing planners: planner x ally x matches as one batch, one row per round, resumable."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from fpg_bench.envs.duel import Duel
from fpg_bench.errors import UserError
from fpg_bench.evaluation.planner_panel import PlannerPanel
from fpg_bench.evaluation.runner import code_fingerprint, play_round, rounds_done, tally_row
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.planning import PLANNERS, as_planner
from fpg_bench.players.naming import as_player
from fpg_bench.players.seat import Seat
from fpg_bench.rows import Row, RowFile


@dataclass(frozen=True)
class Contender:
    """A planner under comparison.

    Attributes:
        name: what rows call it.
        tier: what it knows.
        fingerprint: what tells two planners of one name apart.
        make: gives the planner that plays against an ally.
    """

    name: str
    tier: str
    fingerprint: str
    make: Callable[[str], Any]


def contender(spec: Any, panel: PlannerPanel) -> Contender:
    """A contender from a planner, or from its name by the one grammar of planners.

    Raises:
        UserError: no such planner, one that does not say what it knows, or one by the name of another.
    """
    planner = as_planner(spec, panel.scenario)
    name = spec if isinstance(spec, str) else str(getattr(spec, "name", type(spec).__name__))
    code = spec if isinstance(spec, str) else f"{type(spec).__module__}:{name}"
    if not isinstance(spec, str) and name in PLANNERS:
        raise UserError(f"planner {spec!r}: calls itself {name}, as one of the package does; rename it")
    return Contender(
        name, planner.tier, code_fingerprint(code), lambda ally: as_planner(spec, panel.scenario)
    )


def play_planner(
    who: Contender, panel: PlannerPanel, file: RowFile, progress: Callable[[str, int], None]
) -> None:
    """Play a planner against every ally of a panel whose rows are not there yet.

    Args:
        who: the planner.
        panel: the allies and how many matches of each.
        file: where rows go, round by round; pairings that are complete there are skipped, others are played
            again from the start and give the rows that are missing.
        progress: called with the ally and the number of rounds played, before each round.

    Raises:
        UserError: the file holds rows of another panel, or of another planner under the same name; or the
            planner fails: with the ally and the round, from 0.
    """
    head: Row = {"panel": panel.name, "panel_hash": panel.hash[:16], "planner": who.name, "tier": who.tier}
    head["fingerprint"] = who.fingerprint[:16]
    done = rounds_done(file, head, who=("planner",), entry="ally")
    for ally in panel.allies:
        known = done.get(ally, set())
        if len(known) == panel.matches * panel.rounds:
            continue
        progress(ally, 0)
        planner, played = who.make(ally), 0
        try:
            for rows in play_pairing(planner, ally, panel):
                fresh = [row for row in rows if (row["seed"], row["round"]) not in known]
                file.append({**head, "ally": ally, **row} for row in fresh)
                played += 1
                progress(ally, played)
        except UserError as error:
            raise UserError(f"{error} (against {ally}, round {played})") from error


def play_pairing(planner: Any, ally: str, panel: PlannerPanel) -> Iterator[list[Row]]:
    """Play all matches of a planner and an ally as one batch; gives the rows of each round as it ends."""
    for duel in pairing_rounds(planner, ally, panel):
        yield [_row(duel, game) for game in range(panel.matches)]


def pairing_rounds(planner: Any, ally: str, panel: PlannerPanel) -> Iterator[Duel]:
    """Play all matches of a planner and an ally as one batch; gives their games at the end of each round."""
    duel = Duel(panel.scenario, panel.matches, planner)
    flown_after = Seat("ally", [as_player(ally, "ally", panel.scenario)], duel.arena)
    jammer = Seat("opponent", [as_player(panel.opponent, "opponent", panel.scenario)], duel.arena)
    seeds: Any = np.array(evaluation_seeds(panel.matches, panel.season))
    for _ in range(panel.rounds):
        play_round(duel, flown_after, jammer, seeds)
        yield duel
        seeds = None


def _row(duel: Duel, game: int) -> Row:
    """One round: its tally, and how the path came about that it flew."""
    plan = duel.plans[game]
    assert plan is not None
    planned = {"status": plan.status, "source": plan.source, "tokens": plan.tokens}
    return tally_row(duel, game) | planned | {"seconds": round(plan.seconds or 0.0, 6)}
