"""Suites: frozen, hashed lists of rivals, and their YAML files."""

from __future__ import annotations

import functools
import hashlib
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.checks import check_keys, whole
from fpg_bench.errors import UserError, nearest
from fpg_bench.evaluation.seeds import SEASON
from fpg_bench.files import read_json, read_yaml
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.ids import DUEL, find_view, policy_view
from fpg_bench.planning import as_planner
from fpg_bench.players.agent import agent_folder, fields_folder
from fpg_bench.players.naming import as_player
from fpg_bench.players.player import SIDES

PLANNER = "planner"  # the side of fields whose entries plan the opponent's path


@dataclass(frozen=True)
class Scale:
    """What makes a score of a return a step: ``zero`` scores 0 and ``top`` scores 100.

    ``Scale()``, that of a field which names none, leaves returns as they are.
    """

    zero: float = 0.0
    top: float = 100.0

    def score(self, reward: Any) -> Any:
        """The score of a return a step, or of an array of them."""
        return 100 * (reward - self.zero) / (self.top - self.zero)

    def reward(self, score: float) -> float:
        """The return a step of a score."""
        return self.zero + score / 100 * (self.top - self.zero)

    @property
    def told(self) -> str:
        """The scale in words."""
        if self == Scale():
            return "score: the return a step"
        return f"score: 0 = {self.zero:g} a step (random), 100 = {self.top:g}"


@dataclass(frozen=True)
class Counterpart:
    """Whom entries meet, and in which game.

    Attributes:
        name: what lines and tables call it.
        players: the other side's players, one drawn per round; in a field of planners the allies.
        scenario: what is played, path included.
        planner: who plans the opponent's path between rounds, if anybody does.
    """

    name: str
    players: tuple[str, ...]
    scenario: Scenario
    planner: str | None = None


@dataclass(frozen=True)
class Field:
    """A list of counterparts, all met over the same matches.

    Attributes:
        name: the field's.
        side: who is measured: ``ally``, ``opponent``, or ``planner``, which flies the opponent.
        scenario: what is played unless a counterpart changes it; it says how many rounds a match has.
        matches: how many an entry's training seed plays against each counterpart.
        counterparts: at least one.
        scale: what makes scores.
        opponent: who jams, in a field of planners.
        last_rounds: how many rounds at a match's end count for the score; None: all.
        season: the season of the evaluation seeds.
    """

    name: str
    side: str
    scenario: Scenario
    matches: int
    counterparts: tuple[Counterpart, ...]
    scale: Scale = Scale()
    opponent: str = "adaptive"
    last_rounds: int | None = None
    season: str = SEASON

    @property
    def other_side(self) -> str:
        """The side that the counterparts play."""
        return "opponent" if self.side == "ally" else "ally"

    @property
    def returned(self) -> str:
        """The tally whose sum is an entry's return."""
        return "ally_return" if self.side == "ally" else "opponent_return"

    @property
    def rounds_per_match(self) -> int:
        """How many rounds a match has."""
        return self.scenario.rounds_per_match

    @property
    def rounds(self) -> int:
        """How many rounds are played against each counterpart."""
        return self.matches * self.rounds_per_match

    @property
    def counted(self) -> slice:
        """The rounds of a match that the score is made of."""
        return slice(self.rounds_per_match - (self.last_rounds or self.rounds_per_match), None)

    @functools.cached_property
    def hash(self) -> str:
        """SHA-256 of everything that decides a result under this field, as 64 hexadecimal digits."""
        counterparts = [
            [c.name, [identity(player) for player in c.players], c.scenario.hash, c.planner]
            for c in self.counterparts
        ]
        content = [self.side, self.matches, self.season, self.opponent, self.last_rounds, counterparts]
        return hashlib.sha256(json.dumps([*content, self.scale.zero, self.scale.top]).encode()).hexdigest()

    def named(self, name: str) -> Counterpart:
        """The counterpart of this name; raises UserError where there is none."""
        for counterpart in self.counterparts:
            if counterpart.name == name:
                return counterpart
        names = [counterpart.name for counterpart in self.counterparts]
        raise UserError(f"field {self.name}: no counterpart {name!r}{nearest(name, names)}")

    def rewards(self, returns: Any) -> np.ndarray:
        """Returns a step ``(matches,)`` over the rounds that count, from those of all rounds in order."""
        by_match = np.asarray(returns, float).reshape(-1, self.rounds_per_match)
        found: np.ndarray = by_match[:, self.counted].mean(axis=1) / self.scenario.steps_per_round
        return found


def identity(player: str) -> str:
    """What decides how a named player plays: the hash of an agent's policy, or its name."""
    if player.startswith("field:"):
        raise UserError(f"counterpart {player!r}: name a field's members by their folders, NAME/SIDE/MEMBER")
    if ":" in player or "/" not in player:
        return player
    return str(read_json(agent_folder(player) / "agent.json", "agent").get("policy_sha256"))


_KEYS = {"side", "scenario", "matches", "counterparts"}
_OPTIONAL = {"rounds_per_match", "last_rounds", "opponent", "scale", "season"}
_SAME_FOR_ALL = ("steps_per_round", "rounds_per_match", "frequency_points")  # or sums could not be pooled
_SHIPPED = re.compile(r"[\w-][\w.-]*(/[\w-][\w.-]*)*", re.ASCII)
_COUNTERPART = {"name", "ally", "opponent", "path", "planner", "changes"}


def field_of(view_id: str, options: dict[str, Any], side: str | None = None) -> str:
    """The name of the public field that an id's players are measured on, with the options of its games.

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


def side_field(side: str, scenario: Scenario) -> Field:
    """The public field of a side, played in a scenario; an opponent that flies itself has one of its own."""
    path = "learned" if "learned" in scenario.paths else "pursuit"
    return load_field(field_of(policy_view(side).id, {"path": path}))


def field_file(name: str) -> Path:
    """The YAML file of a field's name, or the file that is named itself, which may not be there.

    Raises:
        UserError: no such field.
    """
    if name.endswith((".yml", ".yaml")):
        return Path(name)
    path = fields_folder() / f"{name}.yml"
    if not path.is_file():
        known = sorted(p.stem for p in fields_folder().glob("*.yml"))
        raise UserError(f"unknown field {name!r}{nearest(name, known)}; there are {', '.join(known)}")
    return path


def load_field(name: str, side: str | None = None, shipped: bool = False) -> Field:
    """A field by its name (``ally-v1``) or from a YAML file of the same form.

    Args:
        name: the field's name or file.
        side: the side that it must measure; None: any.
        shipped: whether it may name nothing but scripts and agents of the package, which its hash covers.

    Raises:
        UserError: no such field or file, one of another side, or a value that cannot be played.
    """
    path = field_file(name)
    content = read_yaml(path, "field")
    check_keys(content, _KEYS | _OPTIONAL, f"field {path}", sorted(_KEYS))
    if content["side"] not in (*SIDES, PLANNER):
        raise UserError(f"field {path}: side: expected ally, opponent or planner, got {content['side']!r}")
    if side not in (None, content["side"]):
        verb = "plan compare" if content["side"] == PLANNER else "evaluate"
        raise UserError(
            f"field {name}: measures the {content['side']}, not the {side}; write fpg-bench {verb}"
        )
    try:
        field = _field(path.stem, content)
        for counterpart in field.counterparts:
            if shipped:
                _check_shipped(field, counterpart)
            _check(field, counterpart)
    except UserError as error:
        raise UserError(f"field {path}: {error}") from error
    return field


def _field(name: str, content: dict[str, Any]) -> Field:
    counts: dict[str, int | None] = {
        key: None if content.get(key) is None else whole(content[key], key)
        for key in ("matches", "rounds_per_match", "last_rounds")
    }
    planned = content["side"] == PLANNER
    scenario = as_scenario(
        content["scenario"],
        rounds_per_match=counts["rounds_per_match"],
        opponent_path="waypoints" if planned else None,
    )
    items = content["counterparts"]
    if not isinstance(items, list) or not items:
        raise UserError(f"counterparts: expected a list, got {items!r}")
    counterparts = tuple(_counterpart(item, content["side"], scenario) for item in items)
    names = [counterpart.name for counterpart in counterparts]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise UserError(f"counterparts: {twice!r} stands there twice; give one a name of its own")
    if (counts["last_rounds"] or 1) > scenario.rounds_per_match:
        raise UserError(f"last_rounds: at most the match's {scenario.rounds_per_match} rounds")
    return Field(
        name,
        content["side"],
        scenario,
        counts["matches"] or 1,
        counterparts,
        scale=_scale(content.get("scale")),
        opponent=str(content.get("opponent", "adaptive")),
        last_rounds=counts["last_rounds"],
        season=str(content.get("season", SEASON)),
    )


def _counterpart(item: Any, side: str, scenario: Scenario) -> Counterpart:
    other = "opponent" if side == "ally" else "ally"
    if not isinstance(item, dict) or other not in item:
        raise UserError(f"counterparts: expected mappings with {other}, got {item!r}")
    check_keys(item, _COUNTERPART, "counterparts")
    if "path" in item and "planner" in item:
        raise UserError(f"counterparts: {item!r}: say path or planner, not both")
    players = tuple(map(str, item[other])) if isinstance(item[other], list) else (str(item[other]),)
    planned = "planner" in item or side == PLANNER
    path = "waypoints" if planned else item.get("path")
    path = tuple(path) if isinstance(path, list) else path
    changes = item.get("changes") or {}
    check_keys(changes, Scenario.__dataclass_fields__, "counterparts: changes")
    played = _changed(as_scenario(scenario, opponent_path=path), changes)
    flown = str(item.get("planner", item.get("path", "")))
    name = str(item.get("name") or "/".join(filter(None, ("+".join(players), flown))))
    return Counterpart(name, players, played, str(item["planner"]) if "planner" in item else None)


def _changed(scenario: Scenario, changes: dict[str, Any]) -> Scenario:
    if same := [key for key in _SAME_FOR_ALL if key in changes]:
        raise UserError(
            f"changes: {same[0]} is the same for all counterparts of a field; say it in the scenario"
        )
    return as_scenario(scenario, **changes)


def _scale(content: Any) -> Scale:
    if content is None:
        return Scale()
    numbers = isinstance(content, dict) and content.keys() == {"zero", "top"}
    if not numbers or not all(isinstance(value, int | float) for value in content.values()):
        raise UserError(f"scale: expected zero and top, the returns a step of 0 and 100, got {content!r}")
    if not content["top"] > content["zero"]:
        raise UserError(f"scale: top must lie above zero, got {content!r}")
    return Scale(float(content["zero"]), float(content["top"]))


def _check_shipped(field: Field, counterpart: Counterpart) -> None:
    """Raise UserError where a counterpart is named by code of its own (``a:b``), or by a path leading out."""
    for name in (*counterpart.players, counterpart.planner or "none", field.opponent):
        if not _SHIPPED.fullmatch(name):
            raise UserError(f"{name!r}: a board plays scripts and agents of the package alone; name one")


def _check(field: Field, counterpart: Counterpart) -> None:
    """Raise UserError where a counterpart names a player or planner that can't be had."""
    fliers = (field.opponent,) if field.side == PLANNER else ()
    of = tuple(map(identity, (*counterpart.players, *fliers)))
    _check_players(field.other_side, counterpart, fliers, of)


@functools.lru_cache(maxsize=512)
def _check_players(side: str, counterpart: Counterpart, fliers: tuple[str, ...], of: tuple[str, ...]) -> None:
    """Load all players once; ``of``: what they were then, as a board reads the same fields many times."""
    for player in counterpart.players:
        as_player(player, side, counterpart.scenario)
    for player in fliers:
        as_player(player, "opponent", counterpart.scenario)
    if counterpart.planner is not None:
        as_planner(counterpart.planner, counterpart.scenario)
