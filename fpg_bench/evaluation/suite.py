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

from fpg_bench.common.checks import check_keys, whole
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import read_json, read_yaml
from fpg_bench.common.ids import DUEL, find_env, policy_env
from fpg_bench.evaluation.seeds import SEASON
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.planning import as_planner
from fpg_bench.players.agent import agent_folder, suites_folder
from fpg_bench.players.player import SIDES
from fpg_bench.players.registry import as_player

PLANNER = "planner"  # the side of suites whose entries plan the opponent's path


@dataclass(frozen=True)
class Scale:
    """What makes a score of a return a step: ``zero`` scores 0 and ``top`` scores 100.

    ``Scale()``, that of a suite which names none, leaves returns as they are.
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
class Rival:
    """Whom entries meet, and in which game.

    Attributes:
        name: what lines and tables call it.
        players: the other side's players, one drawn per round; in a suite of planners the allies.
        scenario: what is played, path included.
        planner: who plans the opponent's path between rounds, if anybody does.
    """

    name: str
    players: tuple[str, ...]
    scenario: Scenario
    planner: str | None = None


@dataclass(frozen=True)
class Suite:
    """A list of rivals, all met over the same matches.

    Attributes:
        name: the suite's.
        side: who is measured: ``ally``, ``opponent``, or ``planner``, which flies the opponent.
        scenario: what is played unless a rival changes it; it says how many rounds a match has.
        matches: how many an entry's training seed plays against each rival.
        rivals: at least one.
        scale: what makes scores.
        opponent: who jams, in a suite of planners.
        last_rounds: how many rounds at a match's end count for the score; None: all.
        season: the season of the evaluation seeds.
    """

    name: str
    side: str
    scenario: Scenario
    matches: int
    rivals: tuple[Rival, ...]
    scale: Scale = Scale()
    opponent: str = "adaptive"
    last_rounds: int | None = None
    season: str = SEASON

    @property
    def other_side(self) -> str:
        """The side that the rivals play."""
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
        """How many rounds are played against each rival."""
        return self.matches * self.rounds_per_match

    @property
    def counted(self) -> slice:
        """The rounds of a match that the score is made of."""
        return slice(self.rounds_per_match - (self.last_rounds or self.rounds_per_match), None)

    @functools.cached_property
    def hash(self) -> str:
        """SHA-256 of everything that decides a result under this field, as 64 hexadecimal digits."""
        rivals = [
            [c.name, [identity(player) for player in c.players], c.scenario.hash, c.planner]
            for c in self.rivals
        ]
        content = [self.side, self.matches, self.season, self.opponent, self.last_rounds, rivals]
        return hashlib.sha256(json.dumps([*content, self.scale.zero, self.scale.top]).encode()).hexdigest()

    def named(self, name: str) -> Rival:
        """The rival of this name; raises UserError where there is none."""
        for rival in self.rivals:
            if rival.name == name:
                return rival
        names = [rival.name for rival in self.rivals]
        raise UserError(f"suite {self.name}: no rival {name!r}{nearest(name, names)}")

    def rewards(self, returns: Any) -> np.ndarray:
        """Returns a step ``(matches,)`` over the rounds that count, from those of all rounds in order."""
        by_match = np.asarray(returns, float).reshape(-1, self.rounds_per_match)
        found: np.ndarray = by_match[:, self.counted].mean(axis=1) / self.scenario.steps_per_round
        return found


def identity(player: str) -> str:
    """What decides how a named player plays: the hash of an agent's policy, or its name."""
    if player.startswith("suite:"):
        raise UserError(f"rival {player!r}: name a suite's members by their folders, NAME/SIDE/MEMBER")
    if ":" in player or "/" not in player:
        return player
    return str(read_json(agent_folder(player) / "agent.json", "agent").get("policy_sha256"))


_KEYS = {"side", "scenario", "matches", "rivals"}
_OPTIONAL = {"rounds_per_match", "last_rounds", "opponent", "scale", "season"}
_SAME_FOR_ALL = ("steps_per_round", "rounds_per_match", "frequency_points")  # or sums could not be pooled
_SHIPPED = re.compile(r"[\w-][\w.-]*(/[\w-][\w.-]*)*", re.ASCII)
_RIVAL = {"name", "ally", "opponent", "path", "planner", "changes"}


def suite_of(env_id: str, options: dict[str, Any], side: str | None = None) -> str:
    """The name of the public suite that an id's players are measured on, with the options of its games.

    Args:
        env_id: the id.
        options: what its games are made with.
        side: which side of the duel; None: that of the view.

    Raises:
        UserError: no such id.
    """
    if side is None or env_id != DUEL:
        view = find_env(env_id)
        if view.planner is not None:
            return "ally-planner-v1"
        side = view.side
    learned = side == "opponent" and options.get("path") == "learned"
    return "opponent-learned-v1" if learned else f"{side}-v1"


def side_suite(side: str, scenario: Scenario) -> Suite:
    """The public suite of a side, played in a scenario; an opponent that flies itself has one of its own."""
    path = "learned" if "learned" in scenario.paths else "pursuit"
    return load_suite(suite_of(policy_env(side).id, {"path": path}))


def suite_file(name: str) -> Path:
    """The YAML file of a suite's name, or the file that is named itself, which may not be there.

    Raises:
        UserError: no such suite.
    """
    if name.endswith((".yml", ".yaml")):
        return Path(name)
    path = suites_folder() / f"{name}.yml"
    if not path.is_file():
        known = sorted(p.stem for p in suites_folder().glob("*.yml"))
        raise UserError(f"unknown suite {name!r}{nearest(name, known)}; there are {', '.join(known)}")
    return path


def load_suite(name: str, side: str | None = None, shipped: bool = False) -> Suite:
    """A suite by its name (``ally-v1``) or from a YAML file of the same form.

    Args:
        name: the suite's name or file.
        side: the side that it must measure; None: any.
        shipped: whether it may name nothing but scripts and agents of the package, which its hash covers.

    Raises:
        UserError: no such suite or file, one of another side, or a value that cannot be played.
    """
    path = suite_file(name)
    content = read_yaml(path, "suite")
    check_keys(content, _KEYS | _OPTIONAL, f"suite {path}", sorted(_KEYS))
    if content["side"] not in (*SIDES, PLANNER):
        raise UserError(f"suite {path}: side: expected ally, opponent or planner, got {content['side']!r}")
    if side not in (None, content["side"]):
        verb = "plan compare" if content["side"] == PLANNER else "evaluate"
        raise UserError(
            f"suite {name}: measures the {content['side']}, not the {side}; write fpg-bench {verb}"
        )
    try:
        suite = _suite(path.stem, content)
        for rival in suite.rivals:
            if shipped:
                _check_shipped(suite, rival)
            _check(suite, rival)
    except UserError as error:
        raise UserError(f"suite {path}: {error}") from error
    return suite


def _suite(name: str, content: dict[str, Any]) -> Suite:
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
    items = content["rivals"]
    if not isinstance(items, list) or not items:
        raise UserError(f"rivals: expected a list, got {items!r}")
    rivals = tuple(_rival(item, content["side"], scenario) for item in items)
    names = [rival.name for rival in rivals]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise UserError(f"rivals: {twice!r} stands there twice; give one a name of its own")
    if (counts["last_rounds"] or 1) > scenario.rounds_per_match:
        raise UserError(f"last_rounds: at most the match's {scenario.rounds_per_match} rounds")
    return Suite(
        name,
        content["side"],
        scenario,
        counts["matches"] or 1,
        rivals,
        scale=_scale(content.get("scale")),
        opponent=str(content.get("opponent", "adaptive")),
        last_rounds=counts["last_rounds"],
        season=str(content.get("season", SEASON)),
    )


def _rival(item: Any, side: str, scenario: Scenario) -> Rival:
    other = "opponent" if side == "ally" else "ally"
    if not isinstance(item, dict) or other not in item:
        raise UserError(f"rivals: expected mappings with {other}, got {item!r}")
    check_keys(item, _RIVAL, "rivals")
    if "path" in item and "planner" in item:
        raise UserError(f"rivals: {item!r}: say path or planner, not both")
    players = tuple(map(str, item[other])) if isinstance(item[other], list) else (str(item[other]),)
    planned = "planner" in item or side == PLANNER
    path = "waypoints" if planned else item.get("path")
    path = tuple(path) if isinstance(path, list) else path
    changes = item.get("changes") or {}
    check_keys(changes, Scenario.__dataclass_fields__, "rivals: changes")
    played = _changed(as_scenario(scenario, opponent_path=path), changes)
    flown = str(item.get("planner", item.get("path", "")))
    name = str(item.get("name") or "/".join(filter(None, ("+".join(players), flown))))
    return Rival(name, players, played, str(item["planner"]) if "planner" in item else None)


def _changed(scenario: Scenario, changes: dict[str, Any]) -> Scenario:
    if same := [key for key in _SAME_FOR_ALL if key in changes]:
        raise UserError(f"changes: {same[0]} is the same for all rivals of a suite; say it in the scenario")
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


def _check_shipped(suite: Suite, rival: Rival) -> None:
    """Raise UserError where a rival is named by code of its own (``a:b``), or by a path leading out."""
    for name in (*rival.players, rival.planner or "none", suite.opponent):
        if not _SHIPPED.fullmatch(name):
            raise UserError(f"{name!r}: a board plays scripts and agents of the package alone; name one")


def _check(suite: Suite, rival: Rival) -> None:
    """Raise UserError where a rival names a player or planner that can't be had."""
    fliers = (suite.opponent,) if suite.side == PLANNER else ()
    of = tuple(map(identity, (*rival.players, *fliers)))
    _check_players(suite.other_side, rival, fliers, of)


@functools.lru_cache(maxsize=512)
def _check_players(side: str, rival: Rival, fliers: tuple[str, ...], of: tuple[str, ...]) -> None:
    """Load all players once; ``of``: what they were then, as a board reads the same suites many times."""
    for player in rival.players:
        as_player(player, side, rival.scenario)
    for player in fliers:
        as_player(player, "opponent", rival.scenario)
    if rival.planner is not None:
        as_planner(rival.planner, rival.scenario)
