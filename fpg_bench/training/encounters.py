"""A player against others that no field names: its past selves, or best responses to it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.field import Counterpart, Field, Scale, side_field
from fpg_bench.evaluation.play import Seeds, play
from fpg_bench.evaluation.summary import Summary, summarise
from fpg_bench.game.scenario import Scenario
from fpg_bench.rows import Row

MATCHES = 100


def met(
    spec: Any,
    others: Mapping[str, Any],
    side: str,
    scenario: Scenario,
    matches: int = MATCHES,
    seeds: Seeds | None = None,
) -> Summary:
    """Play a player against each of several others.

    Args:
        spec: the player.
        others: those of the other side, by the names that they are told by.
        side: the player's.
        scenario: what is played.
        matches: against each.
        seeds: gives the seeds of so many matches; None: the evaluation seeds.

    Raises:
        UserError: no such player, or one of the wrong side.
    """
    counterparts = tuple(Counterpart(name, (other,), scenario) for name, other in others.items())
    field = Field("met", side, scenario, matches, counterparts, scale_of(side, scenario))
    entry = player_entry(spec)
    (summary,) = summarise([play(entry, field, counterpart, seeds) for counterpart in counterparts], field)
    return summary


def scale_of(side: str, scenario: Scenario) -> Scale:
    """The scale of a side's track where the scenario is its own but for the path, else none."""
    field = side_field(side, scenario)
    alike = dataclasses.replace(scenario, opponent_path=field.scenario.opponent_path)
    return field.scale if alike.hash == field.scenario.hash else Scale()


def told(summary: Summary) -> Row:
    """What rows of self-play and of best responses say of such a meeting.

    Returns:
        ``score`` and ``return`` (a step), the mean over the others; ``returns``, against each by its name;
        ``measures``, of all rounds together.
    """
    returns = {name: round(found.value, 4) for name, found in summary.by_counterpart.items()}
    measures = {name: None if x is None else round(x, 5) for name, x in summary.measures.items()}
    score = round(summary.score.value, 2)
    return {
        "score": score,
        "return": round(summary.reward.value, 4),
        "returns": returns,
        "measures": measures,
    }
