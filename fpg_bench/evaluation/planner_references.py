"""A panel of planners in the form of any panel: its allies as entries, and what earns 0 and 100 on each."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fpg_bench import __version__
from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import Entry, Panel, Reference, panel_file, scores_file
from fpg_bench.evaluation.planner_panel import PlannerPanel, load_planner_panel
from fpg_bench.evaluation.planner_runner import pairing_rounds
from fpg_bench.evaluation.planner_summary import Scale
from fpg_bench.files import read_json, write_whole
from fpg_bench.planning import as_planner


class AllyEntry(Entry):
    """An ally that a planner's opponent flies after."""

    @property
    def name(self) -> str:
        """What rows and tables call it."""
        return self.other


@dataclass(frozen=True)
class PlannerTable(Panel):
    """A panel of planners as a panel of its allies, with reference scores; ``rounds`` are those of an ally.

    Attributes:
        played: the panel of planners.
    """

    played: PlannerPanel | None = None

    @property
    def planners(self) -> PlannerPanel:
        """The panel of planners."""
        assert self.played is not None
        return self.played

    @property
    def hash(self) -> str:
        """That of the panel of planners."""
        return self.planners.hash

    def scale(self) -> Scale:
        """What makes scores of the returns ``(allies, matches, rounds)`` of a planner.

        Raises:
            UserError: there are no reference scores, or the planners of 0 and 100 do not differ.
        """
        if self.references is None:
            raise UserError(f"panel {self.name}: has no reference scores; run fpg-bench measure-panel first")
        return self._scale

    @cached_property
    def _scale(self) -> Scale:
        assert self.references is not None
        kept = [self.references[entry.name] for entry in self.entries]
        return Scale(self.by_match(kept, "random"), self.by_match(kept, "reference"), self.planners)

    def by_match(self, of: list[Reference], what: str) -> np.ndarray:
        """``(allies, matches, rounds)`` returns of the one planner or the other."""
        return np.array([getattr(kept, what) for kept in of]).reshape(len(of), -1, self.planners.rounds)


def load_planner_table(name: str = "planner-v1", matches: int | None = None) -> PlannerTable:
    """A panel of planners with the returns that are kept beside it.

    Args:
        name: the panel's name or YAML file.
        matches: how many of each ally are played, the first ones; None: the panel's.

    Raises:
        UserError: no such panel, more matches than it has, or returns of another panel.
    """
    whole = load_planner_panel(name)
    count = whole.matches if matches is None else matches
    if not 1 <= count <= whole.matches:
        raise UserError(f"matches: from 1 to {whole.matches} on panel {name}, got {count}")
    panel = dataclasses.replace(whole, matches=count)
    return PlannerTable(
        name=panel.name,
        side=panel.side,
        scenario=panel.scenario,
        rounds=panel.matches * panel.rounds,
        reference=panel.bound,
        entries=tuple(AllyEntry(ally, "waypoints") for ally in panel.allies),
        season=panel.season,
        references=_references(name, whole, panel.matches * panel.rounds),
        played=panel,
    )


def measure_planner_panel(
    name: str, progress: Callable[[str, str], None] = lambda planner, ally: None
) -> None:
    """Play the planners that earn 0 and 100 against a panel's allies; their returns are kept beside its file.

    Args:
        name: the panel's name or YAML file.
        progress: called with the planner and the ally before they are played.

    Raises:
        UserError: no such panel.
    """
    panel = load_planner_panel(name)
    entries = {}
    for ally in panel.allies:
        earned = {}
        for key, planner in (("random", panel.zero), ("reference", panel.bound)):
            progress(planner, ally)
            earned[key] = _returns(planner, ally, panel)
        entries[ally] = earned
    content = {"panel_hash": panel.hash, "version": __version__, "entries": entries}
    write_whole(scores_file(panel_file(name)), json.dumps(content))


def _returns(planner: str, ally: str, panel: PlannerPanel) -> list[float]:
    """The returns of a planner against an ally, in the order of match and round."""
    played = pairing_rounds(as_planner(planner, panel.scenario), ally, panel)
    by_round = [duel.arena.tallies[f"{panel.side}_return"].round(3) for duel in played]
    found: list[float] = np.array(by_round).T.ravel().tolist()
    return found


def _references(name: str, panel: PlannerPanel, rounds: int) -> dict[str, Reference] | None:
    """The first returns that are kept beside a panel's file, None where none are."""
    file = scores_file(panel_file(name))
    if not file.is_file():
        return None
    content = read_json(file, "reference scores")
    if content.get("panel_hash") != panel.hash:
        raise UserError(f"{file}: measured for another panel; run fpg-bench measure-panel {name} first")
    return {
        ally: Reference(*(tuple(kept[key][:rounds]) for key in ("random", "reference")))
        for ally, kept in content["entries"].items()
    }
