"""The game of two teams, as one value that can be written down."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import pydantic

from fpg_bench.common.checks import check_keys, mapping, of_kind, one_of
from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import EnvConfig, action_modes, plain_id
from fpg_bench.common.schema import NonNegativeInt, Strict, parse
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.game.spec import GameSpec, Options, OtherGame
from fpg_bench.products.teams.rules import (
    MATES,
    SIDES,
    TEAM_ID,
    TEAM_OBSERVATION_SIZE,
    TEAM_REWARDS,
    TEAM_SCRIPTS,
    TeamRules,
)

_LACKING = ("planner", "observation", "history")
_RULES = tuple(each.name for each in dataclasses.fields(TeamRules))
_DEFAULTS = {
    "actions": dict.fromkeys(SIDES, "continuous"),
    "mates": dict.fromkeys(SIDES, "full"),
    "reward": {"ally": "own", "opponent": "team"},
}


_Ends = Annotated[list[NonNegativeInt], pydantic.Field(min_length=2, max_length=2)]


class _Seats(Strict):
    allies: _Ends
    jammers: _Ends


class _Skills(Strict):
    """Skills of a card: the fewest and most allies and jammers, and what mates must tell."""

    seats: _Seats
    mates: Literal["none", "place", "full"]


@dataclass(frozen=True)
class TeamSpec(TeamRules, OtherGame):
    """Specification of a game of teams: that of a game, the rules of teams, and these.

    >>> spec = TeamSpec.of(allies=2, side="ally", against="watchful", mates="none")
    >>> spec.to_dict()
    {'id': 'FPG/team_v0', 'opponent': 'watchful', 'allies': 2, 'mates': 'none', 'side': 'ally'}
    >>> GameSpec.from_dict(spec.to_dict()) == spec
    True

    Of the options of games it lacks ``planner``, ``observation`` and ``history``. The scenario is ``link`` or
    one of its variants. ``actions``, ``mates`` and ``reward`` are those of the side that the caller plays, or
    of both; a mapping from ``ally`` and ``opponent`` has one for each.

    Attributes:
        reward: ``own`` or ``team``; None: ``own`` of allies, ``team`` of jammers. See
            :meth:`fpg_bench.products.teams.batch.TeamBatch.rewards`.
        mates: what seats observe of their mates, ``none``, ``place`` or ``full``; None: ``full``.
        side: the side that the caller plays; None: both. The other side's players, ``opponent`` or ``ally``,
            are then by default the scripts of teams, of which each round draws one for all seats.
        is_by_seat: of several players of the other side, player k plays seat k instead.

    Raises:
        UserError: a value of another kind, or options that exclude each other.
    """

    sees = "team"
    samples = True  # equal policies that play their mode choose equal points
    observation_size = TEAM_OBSERVATION_SIZE
    scripts = TEAM_SCRIPTS

    id: str = TEAM_ID
    scenario: Scenario | str = "link"
    mates: str | Mapping[str, str] | None = None
    side: str | None = None
    is_by_seat: bool = False

    def __post_init__(self) -> None:
        TeamRules.__post_init__(self)
        GameSpec.__post_init__(self)

    def _checked(self) -> Options:
        one_of(plain_id(self.id), "game", [TEAM_ID])
        self._check_lacks(_LACKING, "teams do not have it")
        of_kind(self.is_by_seat, "is_by_seat", "true or false", bool)
        if self.side is not None:
            one_of(self.side, "side", SIDES)
            if getattr(self, self.side) is not None:
                raise UserError(f"{self.side}: you play this side; name the {self.config.other_side}")
        elif self.ally is not None or self.opponent is not None:
            raise self._sideless()
        for side in SIDES:
            known = {"actions": action_modes(side), "mates": MATES, "reward": TEAM_REWARDS}
            for name, words in known.items():
                one_of(self.of_side(name, side), f"{name} of the {side}", words)
        return {}

    @classmethod
    def of(cls, game: str | GameSpec = TEAM_ID, **options: Any) -> TeamSpec:
        """Return the specification as :meth:`GameSpec.of`."""
        one_of(plain_id(game) if isinstance(game, str) else game.id, "game", [TEAM_ID])
        spec = GameSpec.of(game, **options)
        assert isinstance(spec, TeamSpec)
        return spec

    @property
    def is_duel(self) -> bool:
        """True if the caller plays both sides."""
        return self.side is None

    @property
    def config(self) -> EnvConfig:
        """Configuration of an id of one side; raises UserError if the caller plays both sides."""
        if self.side is None:
            raise self._sideless()
        return EnvConfig(TEAM_ID, self.side, "", scripted=False)

    def _sideless(self) -> UserError:
        return UserError("against: say which side you play, side='ally' or side='opponent'")

    @property
    def others(self) -> tuple[Any, ...]:
        """The other side's players; none if the caller plays both sides."""
        if self.side is None:
            return ()
        players: tuple[Any, ...] | None = getattr(self, self.config.other_side)
        return TEAM_SCRIPTS[self.config.other_side] if players is None else players

    @property
    def team(self) -> TeamRules:
        """The rules of teams alone."""
        return TeamRules(**{name: getattr(self, name) for name in _RULES})

    def of_side(self, name: str, side: str) -> str:
        """Return ``actions``, ``mates`` or ``reward`` of one side."""
        value = getattr(self, name)
        if isinstance(value, str):
            value = {each: value for each in SIDES if self.side in (None, each)}
        given = mapping({} if value is None else value, name)
        check_keys(given, SIDES, name)
        return str(given.get(side, _DEFAULTS[name][side]))

    @property
    def action_mode(self) -> str:
        """The action mode of the caller's side: that of the allies where it plays both."""
        return self.of_side("actions", self.side or "ally")

    def like(self, other: GameSpec) -> TeamSpec:
        """Return the game with the rules of teams of another one, as a suite plays it for a training."""
        return dataclasses.replace(self, **{name: getattr(other, name) for name in _RULES})

    @property
    def suite(self) -> str:
        """Name of the public suite that the caller's side is measured on."""
        return f"team-{self.config.side}-link-v1"

    @property
    def skills(self) -> JsonObject:
        """The sizes of teams in which an agent was trained, and what its mates told it."""
        seats = {name: list(ends) for name, ends in zip(("allies", "jammers"), self.counts, strict=True)}
        return {"seats": seats, "mates": self.of_side("mates", self.side or "ally")}

    @property
    def hash(self) -> str:
        """SHA-256 of the game, 64 hexadecimal digits: as of others, and of all rules of teams."""
        content = [super().hash, dataclasses.asdict(self.team)]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    @classmethod
    def check_skills(cls, skills: JsonObject) -> None:
        """Raise UserError unless skills are the sizes of teams, and what mates tell."""
        parse(_Skills, skills, "skills")

    def resolve(self) -> Scenario:
        """Return the scenario that is played."""
        changes = {"knowledge": self.knowledge, "jamming_types": self.jamming_types}
        return as_scenario(self.scenario or "link", opponent_path=self.path, **changes)
