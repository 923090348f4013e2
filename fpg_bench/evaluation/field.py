"""Fields: frozen, hashed lists of counterparts that the entries of one side meet."""

from __future__ import annotations

import functools
import hashlib
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from fpg_bench.errors import UserError, nearest
from fpg_bench.evaluation.seeds import SEASON
from fpg_bench.files import read_json
from fpg_bench.game.scenario import Scenario
from fpg_bench.players.agent import agent_folder

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
