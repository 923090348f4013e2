"""A panel on tuning seeds: what scores a policy while it is trained or tuned, far from evaluation."""

from __future__ import annotations

from typing import Any

import numpy as np

from fpg_bench.evaluation.panel import Entry, Panel, Reference, load_panel
from fpg_bench.evaluation.runner import play_entry
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.evaluation.statistics import iqm
from fpg_bench.ids import find_view


def panel_of(view_id: str, options: dict[str, Any]) -> str:
    """The name of the panel that an id's players are measured on, with the options of its games.

    Raises:
        UserError: no such id.
    """
    view = find_view(view_id)
    if view.planner is not None:
        return "ally-planner-v1"
    return "opponent-learned-v1" if options.get("path") == "learned" else f"{view.side}-v1"


class TuningPanel:
    """A panel's pairings on tuning seeds, normalised by what random and reference get on the same seeds.

    Args:
        name: the panel's name or YAML file.
        rounds: per entry; whole matches are played.

    Raises:
        UserError: no such panel.
    """

    def __init__(self, name: str, rounds: int) -> None:
        self.panel: Panel = load_panel(name, references=False)
        self._rounds = rounds
        self._references = [
            Reference(*(tuple(self._returns(spec, entry)) for spec in ("random", self.panel.reference)))
            for entry in self.panel.entries
        ]

    def scores(self, player: Any) -> np.ndarray:
        """``(entries, matches)`` normalised scores of a player: 0 is random, 100 the panel's reference."""
        found = [
            reference.scores(self._returns(player, entry))
            for entry, reference in zip(self.panel.entries, self._references, strict=True)
        ]
        return np.stack(found).reshape(len(found), -1, self.panel.scenario.rounds_per_match).mean(axis=2)

    def score(self, player: Any) -> float:
        """The interquartile mean over the entries of a player's normalised scores."""
        return float(iqm(self.scores(player).mean(axis=1)))

    def _returns(self, spec: Any, entry: Entry) -> np.ndarray:
        """The panel side's round returns, in the order of seeds and rounds."""
        rows = [
            row for batch in play_entry(spec, self.panel, entry, self._rounds, tuning_seeds) for row in batch
        ]
        rows.sort(key=lambda row: (row["seed"], row["round"]))
        return np.array([row[f"{self.panel.side}_return"] for row in rows])
