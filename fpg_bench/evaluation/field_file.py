"""Fields as YAML files: read, and checked so far that whoever plays them is not surprised."""

from __future__ import annotations

import functools
import re
from pathlib import Path
from typing import Any

from fpg_bench.checks import check_keys, whole
from fpg_bench.errors import UserError, nearest
from fpg_bench.evaluation.field import PLANNER, Counterpart, Field, Scale, identity
from fpg_bench.evaluation.seeds import SEASON
from fpg_bench.files import read_yaml
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.ids import DUEL, find_view, policy_view
from fpg_bench.planning import as_planner
from fpg_bench.players.agent import fields_folder
from fpg_bench.players.naming import as_player
from fpg_bench.players.player import SIDES

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
