"""Panels of planners: against which allies, over how many matches, and between which two scores."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import PLANNER_SIDE, check_keys, panel_file, whole_number
from fpg_bench.evaluation.seeds import SEASON
from fpg_bench.files import read_yaml
from fpg_bench.game.scenario import Scenario, as_scenario

_KEYS = {"side", "scenario", "rounds_per_match", "matches", "opponent", "allies", "last_rounds"}
_KEYS |= {"zero", "bound"}


@dataclass(frozen=True)
class PlannerPanel:
    """How planners are compared.

    Attributes:
        name: the panel's.
        scenario: what is played, on planned paths; it says how many rounds a match has.
        matches: how many each ally plays, each with its own path of the ally and start of the opponent.
        opponent: who jams, whoever plans the path.
        allies: who is flown after.
        last_rounds: how many rounds at a match's end count as what a planner has learned.
        zero, bound: the planners that earn the scores 0 and 100.
        season: the season of the evaluation seeds.
    """

    name: str
    scenario: Scenario
    matches: int
    opponent: str
    allies: tuple[str, ...]
    last_rounds: int
    zero: str
    bound: str
    season: str = SEASON

    @property
    def side(self) -> str:
        """Whose returns count."""
        return "opponent"

    @property
    def rounds(self) -> int:
        """How many rounds a match has."""
        return self.scenario.rounds_per_match

    @property
    def hash(self) -> str:
        """SHA-256 of everything that decides a result under this panel, as 64 hexadecimal digits."""
        played = [PLANNER_SIDE, self.scenario.hash, self.matches, self.season, self.opponent, self.allies]
        content = [*played, self.last_rounds, self.zero, self.bound]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def load_planner_panel(name: str) -> PlannerPanel:
    """A panel of planners by its name (``planner-v1``) or from a YAML file of the same form.

    Raises:
        UserError: no such panel or file, one of players, or a value that cannot be played.
    """
    path = panel_file(name)
    content = read_yaml(path, "panel")
    if content.get("side") != PLANNER_SIDE:
        raise UserError(f"panel {name}: does not compare planners; write fpg-bench evaluate --panel {name}")
    check_keys(content, _KEYS, path)
    panel = PlannerPanel(
        name=path.stem,
        scenario=_scenario(content, path),
        matches=whole_number(content, "matches", path),
        opponent=str(content["opponent"]),
        allies=_allies(content["allies"], path),
        last_rounds=whole_number(content, "last_rounds", path),
        zero=str(content["zero"]),
        bound=str(content["bound"]),
    )
    if panel.last_rounds > panel.rounds:
        raise UserError(f"panel {path}: last_rounds: at most the match's {panel.rounds} rounds")
    if panel.zero == panel.bound:
        raise UserError(f"panel {path}: zero and bound are both {panel.zero!r}; name two planners")
    return panel


def _scenario(content: dict[str, Any], path: Path) -> Scenario:
    rounds = whole_number(content, "rounds_per_match", path)
    try:
        return as_scenario(content["scenario"], rounds_per_match=rounds, opponent_path="waypoints")
    except UserError as error:
        raise UserError(f"panel {path}: {error}") from error


def _allies(content: Any, path: Path) -> tuple[str, ...]:
    is_list = isinstance(content, list) and content and all(isinstance(name, str) for name in content)
    if not is_list or len(set(content)) < len(content):
        raise UserError(f"panel {path}: allies: expected a list of different names, got {content!r}")
    return tuple(content)
