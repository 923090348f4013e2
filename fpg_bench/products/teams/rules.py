"""Rules of teams beside the scenario: how many allies and jammers there are, and how they fly and share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fpg_bench.common.checks import of_kind, one_of
from fpg_bench.common.errors import UserError, shown
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.state import OBSERVATION_SIZE, TYPES

MOST_ALLIES, MOST_JAMMERS = 5, 3
MOST = {"allies": MOST_ALLIES, "jammers": MOST_JAMMERS}
FORMATIONS = ("convoy", "separate")
MATES = ("none", "place", "full")
TEAM_ID = "FPG/team_v0"
SIDES = ("ally", "opponent")
TEAM_REWARDS = ("own", "team")
ALLIES_OF_TEAMS = (
    "random-hops", "allotment", "listen", "cdma", "greedy-blind", "greedy", "greedy-own-points"
)  # fmt: skip
JAMMERS_OF_TEAMS = ("split-band", "assign", "herd-pair", "combs")
TEAM_SCRIPTS = {
    "ally": ALLIES_OF_TEAMS,
    "opponent": ("tone", "watchful", *JAMMERS_OF_TEAMS),
}  # two of the duel

# Blocks of an observation behind the duel's numbers: an ally's of further jammers and of mates, a jammer's of
# further allies and of mates. There is room for the largest teams, and both sides have the same width.
FURTHER_JAMMERS, FURTHER_ALLIES = MOST_JAMMERS - 1, MOST_ALLIES - 1
RIVAL_SIZE, MATE_SIZE = 6 + TYPES, 8
FOUND_SIZE, JAMMER_MATE_SIZE = 7, 8 + TYPES
TEAM_OBSERVATION_SIZE = OBSERVATION_SIZE + FURTHER_JAMMERS * RIVAL_SIZE + FURTHER_ALLIES * MATE_SIZE
assert FURTHER_ALLIES * (MATE_SIZE - FOUND_SIZE) == FURTHER_JAMMERS * (JAMMER_MATE_SIZE - RIVAL_SIZE), (
    "teams: an ally and a jammer must observe equally many numbers; change RIVAL_SIZE, MATE_SIZE, "
    "FOUND_SIZE or JAMMER_MATE_SIZE in fpg_bench/products/teams/rules.py"
)
PATHS_OF_TEAMS = ("pursuit", "learned")

# What ally i knows of jammer j, the last second's, and the fading of the path between them.
SENSED = np.dtype([("type", "i8"), ("mhz", "f8"), ("fading", "f8")], align=True)
# What jammer j found of ally i: dB over the noise, frequency, and seconds since; -1 for never.
FOUND = np.dtype([("level_db", "f8"), ("mhz", "f8"), ("age_s", "i8")], align=True)
# The rules as the kernel reads them.
TEAM = np.dtype(
    [
        ("allies", "i8", (2,)),  # fewest and most
        ("jammers", "i8", (2,)),
        ("convoy", "b1"),
        ("spacing", "f8"),
        ("overlap_of_codes", "f8"),  # share of a mate's power that orthogonal codes let through
        ("share_power", "b1"),
    ],
    align=True,
)


@dataclass(frozen=True)
class TeamRules:
    """Rules that teams add to a scenario, and their sizes; the defaults are 3 v 2 in convoy.

    >>> TeamRules(allies=5, jammers=(1, 3)).most
    (5, 3)

    Attributes:
        allies: number of allies, 1 to 5; of two numbers, each round draws one between them.
        jammers: number of jammers, 1 to 3, or two numbers.
        formation: ``convoy``: all allies fly the first one's curve; ``separate``: each has its own.
        spacing_m: distance along the curve at which each ally of a convoy starts ahead of the one before it.
        code_orthogonality: share of a mate's power that a despreader removes if both spread at one point,
            0 to 1. Codes of one mast are orthogonal but for what arrives late, by echoes; the default, as
            of one echo 12 dB below a path in line of sight, is an assumption.
        share_power: whether mates whose beams overlap share the power of one beam, in equal parts.

    Raises:
        UserError: a value of another kind, or out of range.
    """

    allies: int | tuple[int, int] = 3
    jammers: int | tuple[int, int] = 2
    formation: str = "convoy"
    spacing_m: float = 40.0
    code_orthogonality: float = 0.94
    share_power: bool = True

    def __post_init__(self) -> None:
        for name, most in MOST.items():
            object.__setattr__(self, name, _checked_count(name, getattr(self, name), most))
        one_of(self.formation, "formation", FORMATIONS)
        for name, high in (("spacing_m", 1e4), ("code_orthogonality", 1.0)):
            object.__setattr__(self, name, _checked_number(name, getattr(self, name), high))
        of_kind(self.share_power, "share_power", "true or false", bool)

    @property
    def counts(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """The fewest and the most allies, and jammers."""
        allies, jammers = (
            value if isinstance(value, tuple) else (value, value) for value in (self.allies, self.jammers)
        )
        return allies, jammers

    @property
    def most(self) -> tuple[int, int]:
        """The most allies and jammers: the seats of a game."""
        (_, allies), (_, jammers) = self.counts
        return allies, jammers

    def record(self) -> np.ndarray:
        """Return the rules as a one-element record array of dtype ``TEAM``."""
        team = np.zeros(1, TEAM)
        row = team[0]
        row["allies"], row["jammers"] = self.counts
        row["convoy"], row["spacing"] = self.formation == "convoy", self.spacing_m
        row["overlap_of_codes"] = 1 - self.code_orthogonality
        row["share_power"] = self.share_power
        return team


def told(side: str, mates: str) -> np.ndarray:
    """Return ``(67,)`` bool, the numbers of an observation that a seat sees if its mates tell so much."""
    first, size, count = (
        (FURTHER_JAMMERS * RIVAL_SIZE, MATE_SIZE, FURTHER_ALLIES)
        if side == "ally"
        else (FURTHER_ALLIES * FOUND_SIZE, JAMMER_MATE_SIZE, FURTHER_JAMMERS)
    )
    of_mate = np.full(size, mates != "none")
    of_mate[3:-2] = mates == "full"  # beside place, order and presence
    return np.concatenate([np.ones(OBSERVATION_SIZE + first, bool), np.tile(of_mate, count)])


def check_playable(scenario: Scenario) -> None:
    """Raise UserError for a scenario that teams cannot play; the message names the field and the reason."""
    s = scenario
    reasons = {
        f"snr_model {s.snr_model!r}: powers of several senders add in mW, and it has none; use 'link'": (
            s.snr_model != "link"
        ),
        f"detection {s.detection!r}: jammers of a team find allies by 'radiometer' alone": (
            s.detection != "radiometer"
        ),
        "channel: a measured channel has no directions, by which mates differ; leave it out": (
            s.channel is not None
        ),
        "variants: games of teams are played by one scenario; name one": bool(s.variants),
        f"opponent_path {s.opponent_path!r}: jammers of a team fly {' or '.join(PATHS_OF_TEAMS)}": bool(
            set(s.paths) - set(PATHS_OF_TEAMS)
        ),
    }
    if refused := next((reason for reason, is_refused in reasons.items() if is_refused), None):
        raise UserError(f"teams: {refused}")


def _checked_count(name: str, value: object, most: int) -> int | tuple[int, int]:
    ends = tuple(value) if isinstance(value, list | tuple) else (value, value)
    is_whole = len(ends) == 2 and all(isinstance(n, int) and not isinstance(n, bool) for n in ends)
    if not is_whole or not 1 <= ends[0] <= ends[1] <= most:
        raise UserError(
            f"{name}: expected a whole number from 1 to {most}, or two that do not fall, got {shown(value)}"
        )
    return ends[0] if ends[0] == ends[1] else ends


def _checked_number(name: str, value: object, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= high:
        raise UserError(f"{name}: expected a number from 0 to {high:g}, got {shown(value)}")
    return float(value)
