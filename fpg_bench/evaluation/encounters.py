"""A player against others that no panel names, on a scale that is the same against all of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import Entry, Panel, Reference, load_panel, panel_of
from fpg_bench.evaluation.references import round_returns
from fpg_bench.evaluation.runner import Seeds, play_entry
from fpg_bench.evaluation.summary import pooled_measures
from fpg_bench.game.scenario import Scenario
from fpg_bench.ids import policy_view
from fpg_bench.rows import Row

ROUNDS = 100
# The entry of each panel whose random player is worth 0 here, and whose reference 100.
_ENTRIES = {
    "ally-v1": "adaptive/pursuit",
    "opponent-v1": "expert/pursuit",
    "opponent-learned-v1": "expert/learned",
}


@dataclass(frozen=True)
class Scale:
    """What a return is worth, whoever it was earned against.

    Attributes:
        panel: the panel of the side, in the scenario that is played.
        entry: its entry that tells what 0 and 100 are.
        reference: the returns of the random player and of the panel's reference there.
        seeds: those of the rounds; None: the evaluation seeds.
    """

    panel: Panel
    entry: Entry
    reference: Reference
    seeds: Seeds | None = None


def scale_of(side: str, scenario: Scenario, rounds: int = ROUNDS, seeds: Seeds | None = None) -> Scale:
    """The scale of a side; the panel's kept scores where they are of these seeds and rules.

    Args:
        side: ``ally`` or ``opponent``.
        scenario: what is played; the opponent's scale depends on whether it flies itself.
        rounds: how many will be played.
        seeds: see :class:`Scale`.

    Raises:
        UserError: the panel's reference earns no more than the random player in this scenario.
    """
    path = "learned" if "learned" in scenario.paths else "pursuit"
    panel = load_panel(panel_of(policy_view(side).id, {"path": path}))
    entry = next(entry for entry in panel.entries if entry.name == _ENTRIES[panel.name])
    played = dataclasses.replace(panel, scenario=scenario)
    same_rules = played.entry_scenario(entry).hash == panel.entry_scenario(entry).hash
    if panel.references is not None and same_rules and seeds is None:
        return Scale(played, entry, panel.references[entry.name])
    reference = Reference(
        *(round_returns(spec, played, entry, rounds, seeds) for spec in ("random", panel.reference))
    )
    if not np.mean(reference.reference) > np.mean(reference.random):
        raise UserError(f"scenario: {panel.reference} earns no more than random, so nothing scales a score")
    return Scale(played, entry, reference, seeds)


def meet(spec: Any, others: Mapping[str, Any], scale: Scale, rounds: int = ROUNDS) -> Row:
    """Play a player against each of several others.

    Args:
        spec: the player.
        others: those of the other side, by the names that they are told by.
        scale: what is played, and what it is worth.
        rounds: against each.

    Returns:
        ``scores``, by the others' names, ``score``, their mean, and ``measures``, of all rounds together.

    Raises:
        UserError: no such player, or one of the wrong side.
    """
    panel, path = scale.panel, cast(str, scale.panel.scenario.opponent_path)  # or several to draw from
    scores, rows = {}, []
    for name, other in others.items():
        played = [
            row for part in play_entry(spec, panel, Entry(other, path), rounds, scale.seeds) for row in part
        ]
        played.sort(key=lambda row: (row["seed"], row["round"]))
        returns = np.array([row[f"{panel.side}_return"] for row in played])
        scores[name] = round(float(scale.reference.scores(returns).mean()), 2)
        rows += played
    measures = {key: None if x is None else round(x, 5) for key, x in pooled_measures(rows).items()}
    return {"score": round(float(np.mean(list(scores.values()))), 2), "scores": scores, "measures": measures}
