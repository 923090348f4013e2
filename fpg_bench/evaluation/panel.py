"""Panels: fixed, versioned lists of pairings under which players are compared."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from collections.abc import Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.errors import UserError, nearest
from fpg_bench.evaluation.seeds import SEASON
from fpg_bench.files import read_json, read_yaml
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.ids import DUEL, find_view
from fpg_bench.planning import as_planner
from fpg_bench.players.player import SIDES

PANEL_FOLDER = Path(__file__).with_name("panels")
STANDARD_ERRORS = 10.0
PLANNER_SIDE = "planner"  # what a panel of planners says instead of a side
_KEYS = {"side", "scenario", "rounds", "reference", "entries"}
_OPTIONAL = {"rounds_per_match"}


@dataclass(frozen=True)
class Reference:
    """What normalises an entry: round returns of the random player (0) and of the reference (100).

    Both are kept round by round, in the order of the chance seeds: what a round's chance is worth to
    anybody (a path that is easy to jam, a start far away) is then taken off, not left as noise.
    """

    random: tuple[float, ...]
    reference: tuple[float, ...]

    def scores(self, returns: np.ndarray) -> np.ndarray:
        """The normalised scores of round returns ``(n,)`` in the order of the chance seeds.

        Raises:
            UserError: more rounds than were measured.
        """
        n = len(returns)
        if n > len(self.random):
            raise UserError(f"{n} rounds of an entry, but its reference scores hold {len(self.random)}")
        random, reference = np.array(self.random[:n]), np.array(self.reference[:n])
        return 100 * (returns - random) / (reference.mean() - random.mean())

    @property
    def standard_errors(self) -> float:
        """By how many standard errors of their paired difference the reference lies above random."""
        difference = np.subtract(self.reference, self.random)
        error = difference.std(ddof=1) / np.sqrt(len(difference))
        return float(difference.mean() / error) if error > 0 else 0.0


@dataclass(frozen=True)
class Entry:
    """One pairing: the other side's player, and how the opponent flies, or who plans that between rounds."""

    other: str
    path: str
    planner: str | None = None

    @property
    def name(self) -> str:
        """What rows and tables call it."""
        return f"{self.other}/{self.planner or self.path}"


@dataclass(frozen=True)
class Panel:
    """A named list of pairings, with the scores that normalise each (None before they are measured)."""

    name: str
    side: str
    scenario: Scenario
    rounds: int
    reference: str
    entries: tuple[Entry, ...]
    season: str = SEASON
    references: dict[str, Reference] | None = None

    @property
    def other_side(self) -> str:
        """The side that the entries name."""
        return "opponent" if self.side == "ally" else "ally"

    def entry_scenario(self, entry: Entry) -> Scenario:
        """The scenario of an entry: the panel's, on the entry's path."""
        return as_scenario(self.scenario, opponent_path=entry.path)

    @functools.cached_property
    def hash(self) -> str:
        """SHA-256 of everything that decides a result under this panel, as 64 hexadecimal digits."""
        entries = [
            [entry.other, self.entry_scenario(entry).hash, *([entry.planner] if entry.planner else [])]
            for entry in self.entries
        ]
        content = [self.side, self.rounds, self.season, self.reference, entries]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def panel_of(view_id: str, options: dict[str, Any], side: str | None = None) -> str:
    """The name of the panel that an id's players are measured on, with the options of its games.

    Args:
        view_id: the id.
        options: what its games are made with.
        side: which side of the duel; None: that of the view.

    Raises:
        UserError: no such id.
    """
    if side is None or view_id != DUEL:
        view = find_view(view_id)
        if view.planner is not None:
            return "ally-planner-v1"
        side = view.side
    learned = side == "opponent" and options.get("path") == "learned"
    return "opponent-learned-v1" if learned else f"{side}-v1"


def load_panel(name: str, references: bool = True) -> Panel:
    """A panel by its name (``ally-v1``) or from a YAML file of the same form.

    Args:
        name: the panel's name or file.
        references: whether to read the scores that normalise it, too.

    Raises:
        UserError: no such panel or file, or an entry or value that cannot be played.
    """
    path = panel_file(name)
    content = read_yaml(path, "panel")
    if content.get("side") == PLANNER_SIDE:
        raise UserError(f"panel {name}: compares planners; write fpg-bench plan compare --panel {name}")
    check_keys(content, _KEYS, path, _OPTIONAL)
    if content["side"] not in SIDES:
        raise UserError(f"panel {path}: side: expected ally or opponent, got {content['side']!r}")
    other = "opponent" if content["side"] == "ally" else "ally"
    panel = Panel(
        name=path.stem,
        side=content["side"],
        scenario=_scenario(content, path),
        rounds=whole_number(content, "rounds", path),
        reference=str(content["reference"]),
        entries=_entries(content["entries"], other, path),
    )
    try:
        for entry in panel.entries:
            scenario = panel.entry_scenario(entry)
            if entry.planner is not None:
                as_planner(entry.planner, scenario)
    except UserError as error:
        raise UserError(f"panel {path}: {error}") from error
    return dataclasses.replace(panel, references=_references(path, panel)) if references else panel


def compares_planners(name: str) -> bool:
    """Whether a panel's name or YAML file is one of planners; raises UserError where there is none."""
    return read_yaml(panel_file(name), "panel").get("side") == PLANNER_SIDE


def panel_file(name: str) -> Path:
    """The YAML file of a panel's name, or the file that is named itself, which may not be there.

    Raises:
        UserError: no such panel.
    """
    if name.endswith((".yml", ".yaml")):
        return Path(name)
    path = PANEL_FOLDER / f"{name}.yml"
    if not path.is_file():
        raise UserError(
            f"unknown panel {name!r}{nearest(name, [p.stem for p in PANEL_FOLDER.glob('*.yml')])}"
        )
    return path


def check_keys(content: dict[str, Any], keys: Set[str], path: Path, optional: Set[str] = frozenset()) -> None:
    """Raise UserError for a key that a panel's file must not hold, or lacks."""
    for key in content:
        if key not in keys | optional:
            raise UserError(f"panel {path}: unknown key {key!r}{nearest(str(key), keys | optional)}")
    if missing := sorted(keys - set(content)):
        raise UserError(f"panel {path}: lacks {', '.join(missing)}")


def whole_number(content: dict[str, Any], key: str, path: Path) -> int:
    """The whole number above 0 that a panel's file holds under a key; raises UserError for all else."""
    value = content[key]
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise UserError(f"panel {path}: {key}: expected a whole number above 0, got {value!r}")
    return value


def scores_file(path: Path) -> Path:
    """Where a panel's reference scores lie: beside it."""
    return path.with_suffix(".scores.json")


def _scenario(content: dict[str, Any], path: Path) -> Scenario:
    """What a panel plays; in a panel with planners, whole matches of several rounds."""
    rounds = whole_number(content, "rounds_per_match", path) if "rounds_per_match" in content else None
    return as_scenario(content["scenario"], rounds_per_match=rounds)


def _entries(content: Any, other: str, path: Path) -> tuple[Entry, ...]:
    if not isinstance(content, list) or not content:
        raise UserError(f"panel {path}: entries: expected a list, got {content!r}")
    for item in content:
        if not isinstance(item, dict) or set(item) not in ({other, "path"}, {other, "planner"}):
            raise UserError(f"panel {path}: expected entries with {other} and path or planner, got {item!r}")
    return tuple(_entry(str(item[other]), item) for item in content)


def _entry(other: str, item: dict[str, Any]) -> Entry:
    """One pairing of a panel's file: it names a path, or a planner, which flies waypoints."""
    if "planner" in item:
        return Entry(other, "waypoints", str(item["planner"]))
    return Entry(other, str(item["path"]))


def _references(path: Path, panel: Panel) -> dict[str, Reference] | None:
    """The scores measured for just this panel, None where there are none."""
    file = scores_file(path)
    if not file.is_file():
        return None
    content = read_json(file, "reference scores")
    if content["panel_hash"] != panel.hash:
        raise UserError(f"{file}: measured for another panel; run fpg-bench measure-panel {path} first")
    return {
        name: Reference(tuple(scores["random"]), tuple(scores["reference"]))
        for name, scores in content["entries"].items()
    }
