"""Suites: frozen, hashed lists of rivals, and their YAML files."""

from __future__ import annotations

import functools
import hashlib
import json
import re
import string
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
import pydantic

from fpg_bench.common.checks import check_keys, of_kind
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import read_yaml
from fpg_bench.common.ids import other_side, policy_env
from fpg_bench.common.imports import SUITE, check_allowed, code_fingerprint, is_code, names_object
from fpg_bench.common.schema import Items, PositiveInt, Strict, Word, parse
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.evaluation.seeds import SEASON
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.game.spec import GameSpec, OtherGame, game_product, other_game
from fpg_bench.players.agent import read_card, shipped_files
from fpg_bench.players.player import Player, PlayerSpec
from fpg_bench.players.remote import is_remote

MOST_ROUNDS = 1_000_000  # per rival
PLANNER = "planner"  # the side of suites whose entries plan the opponent's path
_SAME_FOR_ALL = ("steps_per_round", "rounds_per_match", "frequency_points")  # so that sums can be pooled
# Names of scripts and agents of the package: neither code (a:b) nor paths that lead out of it.
SHIPPED = re.compile(r"^[\w-][\w.-]*(/[\w-][\w.-]*)*\Z", re.ASCII)
Rewards = TypeVar("Rewards", float, np.ndarray)


@dataclass(frozen=True)
class Scale:
    """Linear scale of scores: random play scores 0 and a mean reward per step of ``top`` scores 100.

    ``Scale()``, the scale of a suite that names none, makes the score the reward per step.

    Attributes:
        zero: what random play earns on the public suite; with ``top`` it decides what a lost round returns.
        top: the upper bound.
        random: what random play earns on this suite, outside its hash; None: ``zero``.
    """

    zero: float = 0.0
    top: float = 100.0
    random: float | None = None

    @property
    def random_play(self) -> float:
        """The reward per step that scores 0."""
        return self.zero if self.random is None else self.random

    def score(self, reward: Rewards) -> Rewards:
        """Return the score of a reward per step, or of an array of them."""
        return 100 * (reward - self.random_play) / (self.top - self.random_play)

    @property
    def lost(self) -> float:
        """The highest reward per step of a round that was lost by an invalid action."""
        return self.zero - (self.top - self.zero)

    @property
    def description(self) -> str:
        """The scale as text."""
        if self == Scale():
            return "score: the return per step"
        return f"score: 0 = {self.random_play:g} per step (random), 100 = {self.top:g}"


@dataclass(frozen=True)
class Rival:
    """Rival that the entries of a suite meet, and the game in which they meet it.

    Attributes:
        name: its name in records and tables.
        players: the other side's players, one drawn per round; in a suite of planners the allies.
        mates: in a suite of teams the players of the entry's further seats, strangers to it; empty: the entry
            plays all seats of its side.
        scenario: what is played, path included.
        planner: planner of the opponent's path between rounds, if any.
    """

    name: str
    players: tuple[str, ...]
    scenario: Scenario
    planner: str | None = None
    mates: tuple[str, ...] = ()

    @functools.cached_property
    def identities(self) -> tuple[str, ...]:
        """Per player, then per mate, the hash of an agent's policy, or a script's name."""
        return tuple(map(identity, (*self.players, *self.mates)))


@dataclass(frozen=True)
class Suite:
    """Suite: a list of rivals, all met over the same matches.

    Attributes:
        name: its name.
        side: the side that is measured: ``ally``, ``opponent``, or ``planner``, which flies the opponent.
        scenario: what is played unless a rival changes it; it says how many rounds a match has.
        matches: matches per training seed of an entry and rival.
        rivals: the rivals, at least one.
        scale: scale of the scores.
        opponent: the jamming player, in a suite of planners.
        last_rounds: number of rounds at a match's end that count for the score; None: all.
        season: season of the evaluation seeds.
        game: the game of another kind that is played, without its players; None: the duel.
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
    game: OtherGame | None = None

    def __post_init__(self) -> None:
        parse(Word, self.name, "name")  # no record could hold another
        for number, rival in enumerate(self.rivals):
            parse(Word, rival.name, f"rivals[{number}]: name")
        if self.rounds > MOST_ROUNDS:
            raise UserError(
                f"matches: {self.matches:,} of {self.rounds_per_match:,} rounds; at most {MOST_ROUNDS:,} "
                "rounds per rival are allowed"
            )

    @property
    def other_side(self) -> str:
        """The side that the rivals play."""
        return other_side(self.side)

    @property
    def return_name(self) -> str:
        """The tally whose sum is an entry's return."""
        return "ally_return" if self.side == "ally" else "opponent_return"

    @property
    def rounds_per_match(self) -> int:
        """Number of rounds of a match."""
        return self.scenario.rounds_per_match

    @property
    def rounds(self) -> int:
        """Number of rounds against each rival."""
        return self.matches * self.rounds_per_match

    @property
    def counted_rounds(self) -> slice:
        """The rounds of a match that count for the score."""
        return slice(self.rounds_per_match - (self.last_rounds or self.rounds_per_match), None)

    @functools.cached_property
    def hash(self) -> str:
        """SHA-256 of everything that decides a result under this suite, as 64 hexadecimal digits."""
        rivals = [[c.name, c.identities, c.scenario.hash, c.planner] for c in self.rivals]
        content = [self.side, self.matches, self.season, self.opponent, self.last_rounds, rivals]
        if self.game is not None:
            content += [self.game.hash, [len(c.mates) for c in self.rivals]]
        if self.code:
            content.append([code_fingerprint(name) for name in self.code])
        return hashlib.sha256(json.dumps([*content, self.scale.zero, self.scale.top]).encode()).hexdigest()

    @property
    def code(self) -> list[str]:
        """The names of the rivals, planners and mates that are code, ``package.module:object``."""
        named = [(*c.players, *c.mates, c.planner or "") for c in self.rivals]
        return sorted(filter(is_code, {self.opponent, *(name for names in named for name in names)}))

    def is_of(self, scenario: Scenario) -> bool:
        """Return True if a scenario is the suite's but for the path and the rounds of a match."""
        kept = {name: getattr(self.scenario, name) for name in ("opponent_path", "rounds_per_match")}
        return as_scenario(scenario, **kept).hash == self.scenario.hash

    def check_scenario(self, scenario: Scenario) -> None:
        """Raise UserError for a scenario that is not the suite's."""
        if not self.is_of(scenario):
            own, other = (s.name or "a scenario of its own" for s in (self.scenario, scenario))
            raise UserError(
                f"suite {self.name}: plays {own}, the run {other}; name one of its scenario, or none: "
                "then the public rivals play the run's"
            )

    def as_player(self, spec: PlayerSpec, side: str, scenario: Scenario) -> Player:
        """Return a player of the suite's game; see :func:`seated_player`."""
        return seated_player(spec, side, scenario, self.game)

    def named(self, name: str) -> Rival:
        """Return the rival of this name; raises UserError for an unknown one."""
        for rival in self.rivals:
            if rival.name == name:
                return rival
        names = [rival.name for rival in self.rivals]
        raise UserError(f"suite {self.name}: no rival {name!r}{nearest(name, names)}")

    def rewards(self, returns: Sequence[float] | np.ndarray) -> np.ndarray:
        """Return the mean rewards per step ``(matches,)`` of the counted rounds, from all rounds' returns."""
        by_match = np.asarray(returns, float).reshape(-1, self.rounds_per_match)
        return np.asarray(by_match[:, self.counted_rounds].mean(axis=1) / self.scenario.steps_per_round)


def seated_player(spec: PlayerSpec, side: str, scenario: Scenario, game: OtherGame | None = None) -> Player:
    """Return a player of a side of the duel, or of its seats in a game of several.

    Raises:
        UserError: as :func:`fpg_bench.players.registry.as_player`, or that of the game's players.
    """
    from fpg_bench.players.registry import as_player  # here, so that reading a suite does not load the game

    if game is None:
        return as_player(spec, side, scenario)
    player: Player = game_product(game.id).make_player(spec, side, scenario, game)
    return player


def identity(name: str) -> str:
    """Return the hash of a named agent's policy, or the name of any other player."""
    if name.startswith(SUITE):
        raise UserError(f"rival {name!r}: name a suite's members by their folders, NAME/SIDE/MEMBER")
    if not is_remote(name) and (names_object(name) or not {"/", "\\"} & set(name)):
        return name
    return read_card(name).policy_sha256


def suite_of(game: GameSpec, side: str | None = None) -> str:
    """Return the name of the public suite that a game's players are measured on.

    Players of ``paper`` and ``link`` are measured there, unless they fly or are flown by a planner.

    >>> suite_of(GameSpec("FPG/OpponentVsScripted-v0", path="learned"))
    'opponent-learned-v2'

    Args:
        game: the game.
        side: side of the duel; of another game that of its id.
    """
    if isinstance(game, OtherGame):
        return game.suite
    if side is None or not game.is_duel:
        if game.config.planner is not None:
            return "ally-planner-v1"
        side = game.config.side
    learned = side == "opponent" and game.path == ("learned",)
    scenario = as_scenario(game.scenario).base.name
    if not learned and scenario in ("paper", "link"):
        return f"{side}-{scenario}-v1"
    return "opponent-learned-v2" if learned else f"{side}-v2"


def side_suite(side: str, scenario: Scenario) -> Suite:
    """Return the public suite of a side, played in a scenario; opponents that fly have one of their own."""
    path = "learned" if "learned" in scenario.paths else "pursuit"
    return load_suite(suite_of(GameSpec(policy_env(side).id, path=path)))


def suite_file(name: str) -> Path:
    """Return the YAML file of a suite's name; a name that is a YAML file itself need not exist.

    Raises:
        UserError: no such suite.
    """
    if of_kind(name, "suite", "a name or a YAML file", str).endswith((".yml", ".yaml")):
        return Path(name)
    if (path := _suite_files().get(name)) is None:
        raise UserError(f"unknown suite {name!r}{_instead(name)}")
    return path


def _instead(name: str) -> str:
    """Return the end of the message on an unknown suite: the newest of another number, or the nearest."""
    base, at, _ = name.partition("@")
    kin = [known for known in suite_names() if known.rstrip(string.digits) == base.rstrip(string.digits)]
    if not kin:
        return nearest(base, suite_names())
    seeds = ": a suite has evaluation seeds of its own" if at else ""
    return f"{seeds}; use {(base if base in kin else kin[-1])!r}"


def suite_names() -> list[str]:
    """Return the names of the shipped suites: those in ``baselines/suites``, and those of products."""
    return sorted(_suite_files())


def _suite_files() -> dict[str, Path]:
    return shipped_files("suites")


class _ScaleFile(Strict):
    zero: float
    top: float
    random: float | None = None

    @pydantic.model_validator(mode="after")
    def _check(self) -> _ScaleFile:
        for name, low in (("zero", self.zero), ("random", self.random)):
            if low is not None and self.top <= low:
                raise UserError(f"top must lie above {name}, got {self.top:g} and {low:g}")
        return self


class _RivalFile(Strict):
    name: str | None = None
    ally: str | Items[str] | None = None
    opponent: str | Items[str] | None = None
    path: str | Items[str] | None = None
    planner: str | None = None
    mates: str | Items[str] | None = None
    changes: JsonObject | None = None


class _SuiteFile(Strict):
    """Content of a suite's YAML file."""

    side: Literal["ally", "opponent", "planner"]
    scenario: str
    matches: PositiveInt
    rivals: Annotated[Items[_RivalFile], pydantic.Field(min_length=1)]
    rounds_per_match: PositiveInt | None = None
    last_rounds: PositiveInt | None = None
    opponent: str = "adaptive"
    scale: _ScaleFile | None = None
    season: str = SEASON
    game: JsonObject | None = None

    @property
    def names(self) -> list[str]:
        """The names of all players and planners."""
        names = [self.opponent]
        for rival in self.rivals:
            for players in (rival.ally, rival.opponent, rival.mates, rival.planner):
                names += [players] if isinstance(players, str) else players or ()
        return names

    def check_shipped(self) -> None:
        """Refuse names of user code (``a:b``), and paths that lead out of the package."""
        for name in self.names:
            if not SHIPPED.match(name):
                raise UserError(f"{name!r}: a board plays scripts and agents of the package alone; name one")

    def build(self, name: str) -> Suite:
        """Return the suite; raises UserError for a value that cannot be played."""
        scenario = as_scenario(
            self.scenario,
            rounds_per_match=self.rounds_per_match,
            opponent_path="waypoints" if self.side == PLANNER else None,
        )
        rivals = tuple(self._rival(of, scenario, f"rivals[{k}]") for k, of in enumerate(self.rivals))
        names = [rival.name for rival in rivals]
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise UserError(f"rivals: {twice!r} is listed twice; give one a name of its own")
        if (self.last_rounds or 1) > scenario.rounds_per_match:
            raise UserError(f"last_rounds: at most the match's {scenario.rounds_per_match} rounds")
        return Suite(
            name,
            self.side,
            scenario,
            self.matches,
            rivals,
            scale=Scale() if self.scale is None else Scale(**dict(self.scale)),
            opponent=self.opponent,
            last_rounds=self.last_rounds,
            season=self.season,
            game=other_game(None if self.game is None else GameSpec.from_dict(self.game, "game")),
        )

    def _rival(self, file: _RivalFile, scenario: Scenario, where: str) -> Rival:
        other, wrong = ("opponent", "ally") if self.side == "ally" else ("ally", "opponent")
        players = getattr(file, other)
        if not players:
            raise UserError(f"{where}: expected {other}, a player's name or a list of them")
        if getattr(file, wrong) is not None:
            raise UserError(f"{where}: {wrong}: the suite measures it; name the {other} alone")
        if file.mates and self.game is None:
            raise UserError(f"{where}: mates: a duel has none; name the game, such as FPG/team_v0")
        if file.path is not None and file.planner is not None:
            raise UserError(f"{where}: give path or planner, not both")
        players, mates = ((each,) if isinstance(each, str) else each or () for each in (players, file.mates))
        paths = (file.path,) if isinstance(file.path, str) else file.path or ()
        changes = file.changes or {}
        check_keys(changes, Scenario.__dataclass_fields__, f"{where}: changes")
        if same := [key for key in _SAME_FOR_ALL if key in changes]:
            raise UserError(
                f"{where}: changes: {same[0]} is the same for all rivals of a suite; set it in the scenario"
            )
        is_planned = file.planner is not None or self.side == PLANNER
        played = as_scenario(scenario, opponent_path="waypoints" if is_planned else file.path)
        parts = ("+".join(mates), "+".join(players), file.planner or "+".join(paths))
        name = file.name or "/".join(filter(None, parts))
        return Rival(name, players, as_scenario(played, **changes), file.planner, mates)


def read_suite(name: str) -> Suite:
    """Read a suite as :func:`load_suite` does, to describe it: its players are neither loaded nor run."""
    return _read(name)[0]


def load_suite(
    name: str, side: str | None = None, shipped: bool = False, allow: Collection[str] = ()
) -> Suite:
    """Load a suite and its players by its name (``ally-v2``) or from a YAML file of the same form.

    Args:
        name: the suite's name or file.
        side: the side that it must measure; None: any.
        shipped: allow scripts and agents of the package alone, which the suite's hash covers.
        allow: the ``package.module:object`` and agents of the Hub that the file may name; neither is run on a
            file's word.

    Raises:
        UserError: no such suite or file, one of another side, a player that is not allowed, or a value that
            cannot be played.
    """
    suite, file = _read(name, side)
    where = f"suite {suite_file(name)}"
    try:
        if shipped:
            file.check_shipped()  # before any player's file is read
        check_allowed(file.names, allow, "rivals")
        for rival in suite.rivals:
            flier = suite.opponent if suite.side == PLANNER else None
            sides = (suite.side, suite.other_side)
            _check_players(sides, rival, rival.identities, flier, identity(flier or ""), suite.game)
    except UserError as error:
        raise UserError(f"{where}: {error}") from error
    return suite


def _read(name: str, side: str | None = None) -> tuple[Suite, _SuiteFile]:
    """Return a suite and the content of its file; no player is loaded."""
    path = suite_file(name)
    where = f"suite {path}"
    content = parse(_SuiteFile, read_yaml(path, "suite"), where)
    if side not in (None, content.side):
        raise UserError(f"suite {name}: measures the {content.side}, not the {side}; choose another")
    try:
        return content.build(path.stem), content
    except UserError as error:
        raise UserError(f"{where}: {error}") from error


@functools.lru_cache(maxsize=512)
def _check_players(
    sides: tuple[str, str],
    rival: Rival,
    identities: tuple[str, ...],
    flier: str | None,
    flier_identity: str,
    game: OtherGame | None,
) -> None:
    """Load all players and planners once, as a board reads the same suites many times."""
    from fpg_bench.players.planner import as_planner  # here, so that reading a suite does not load the game

    for side, players in zip(sides, (rival.mates, rival.players), strict=True):
        for player in players:
            seated_player(player, side, rival.scenario, game)
    if flier is not None:
        seated_player(flier, "opponent", rival.scenario)
    if rival.planner is not None:
        as_planner(rival.planner, rival.scenario)
