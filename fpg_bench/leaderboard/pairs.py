"""Pairs of the board: an ally's entry and an opponent's, and what became of them in cross-play."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, fields
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.common.checks import is_whole
from fpg_bench.common.parallel import outcome_of
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.evaluation.suite import Scale
from fpg_bench.game.scenario import Scenario
from fpg_bench.leaderboard.cases import Case, make_case, submission_folders
from fpg_bench.leaderboard.playing import Part, parts_of
from fpg_bench.leaderboard.tracks import PUBLIC
from fpg_bench.players.player import SIDES

ROUNDS = 100


@dataclass(frozen=True)
class BoardEntry:
    """A verified entry that plays a side: its name in its track, its parts, its game, scale and season."""

    slug: str
    side: str
    parts: tuple[Part, ...]
    scenario: Scenario
    scale: Scale
    season: str

    @cached_property
    def identity(self) -> list[str]:
        """What decides how it plays."""
        return [part.fingerprint for part in self.parts]

    @cached_property
    def scenario_hash(self) -> str:
        """What its games are: of a pair, those of the opponent."""
        return self.scenario.hash


@dataclass(frozen=True)
class Pair:
    """What became of a pair.

    Attributes:
        ally, opponent: their names in their tracks.
        key: see :func:`pair_key`.
        rounds: how many were played.
        ally_rewards, opponent_rewards: the return a step of each of a side's training seeds.
        jamming_success_rate: over all rounds.
        lost: how many rounds were lost by an answer that is none, ``(ally's, opponent's)``.
    """

    ally: str
    opponent: str
    key: str
    rounds: int
    ally_rewards: tuple[float, ...]
    opponent_rewards: tuple[float, ...]
    jamming_success_rate: float
    lost: tuple[int, int]

    def row(self) -> Row:
        """Its line of the file."""
        return asdict(self)

    def rewards(self, side: str) -> tuple[float, ...]:
        """The return a step of each of a side's training seeds."""
        return self.ally_rewards if side == "ally" else self.opponent_rewards

    def reward(self, side: str) -> float:
        """A side's return a step."""
        return float(np.mean(self.rewards(side)))

    def is_of(self, ally: BoardEntry, opponent: BoardEntry) -> bool:
        """Whether it tells of these two, and of as many training seeds as they have."""
        named = (self.ally, self.opponent) == (ally.slug, opponent.slug)
        seeds = len(self.ally_rewards), len(self.opponent_rewards)
        return named and seeds == (len(ally.parts), len(opponent.parts))


def pair_of(row: Row) -> Pair | None:
    """The pair of a row, from anywhere; None where it is none, or an older protocol's."""
    if row.keys() != {spec.name for spec in fields(Pair)}:
        return None
    rate, lost = row["jamming_success_rate"], row["lost"]
    good = isinstance(rate, int | float) and 0 <= rate <= 1 and is_whole(row["rounds"])
    good &= all(isinstance(row[name], str) for name in ("ally", "opponent", "key"))
    good &= isinstance(lost, list) and len(lost) == len(SIDES) and all(is_whole(one, 0) for one in lost)
    if not good or not all(_are_rewards(row[f"{side}_rewards"]) for side in SIDES):
        return None
    lists = {name: tuple(value) for name, value in row.items() if isinstance(value, list)}
    return Pair(**row | lists)


def _are_rewards(values: Any) -> bool:
    """Whether these are returns a step, one for each training seed."""
    numbers = isinstance(values, list) and bool(values)
    return numbers and all(type(value) in (int, float) and abs(value) < 1e6 for value in values)


def players_of_board(board: Path) -> tuple[list[BoardEntry], list[BoardEntry]]:
    """Allies and opponents of a board whose results are verified, by name; all others are left out."""
    found = []
    for folder in submission_folders(board):
        if folder.parent.name in SIDES:
            case = outcome_of(partial(make_case, board, folder))  # submit verify says what is wrong
            found += [case.result] if case.error is None else []
    return players_of(found)


def players_of(cases: Iterable[Case]) -> tuple[list[BoardEntry], list[BoardEntry]]:
    """Allies and opponents among cases, of those whose results are verified."""
    every = [
        _entry(case)
        for case in cases
        if case.known is not None and case.known.verified and case.submission.track in SIDES
    ]
    return [e for e in every if e.side == "ally"], [e for e in every if e.side == "opponent"]


def _entry(case: Case) -> BoardEntry:
    known, submission = case.suites[PUBLIC], case.submission
    scenario = known.rivals[0].scenario  # an opponent's rivals are all on one path
    parts = tuple(parts_of(submission))
    return BoardEntry(submission.slug, submission.track, parts, scenario, known.scale, known.season)


def pair_key(ally: BoardEntry, opponent: BoardEntry, rounds: int) -> str:
    """What decides a pair's figure, as 16 hexadecimal digits."""
    content = [ally.identity, opponent.identity, opponent.scenario_hash, PROTOCOL, ally.season, rounds]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]


def crossplay_file(board: Path) -> Path:
    """Where the figures of all pairs lie."""
    return board / "results" / "crossplay.jsonl"


@dataclass(frozen=True)
class Pairs:
    """The allies and opponents of a board, by name, and the pairs of them whose figures are there.

    Attributes:
        known: the figures, by :func:`pair_key`.
        whole: whether the file holds no line beside them.
        rounds: of each pair.
    """

    allies: list[BoardEntry]
    opponents: list[BoardEntry]
    known: dict[str, Pair]
    whole: bool = True
    rounds: int = ROUNDS

    def every(self) -> Iterator[tuple[str, BoardEntry, BoardEntry]]:
        """All pairs with their keys, ally by ally."""
        for ally in self.allies:
            for opponent in self.opponents:
                yield pair_key(ally, opponent, self.rounds), ally, opponent


def read_pairs(
    board: Path,
    players: tuple[list[BoardEntry], list[BoardEntry]],
    rounds: int = ROUNDS,
    say: Callable[[str], None] = lambda record: None,
) -> Pairs:
    """The figures that are there of pairs of these players; what is none is left out.

    Args:
        board: the leaderboard's folder.
        players: allies and opponents.
        rounds: of each pair.
        say: told how many lines are left out, and of which file.

    Raises:
        UserError: the file cannot be read.
    """
    file, bad = crossplay_file(board), list[str]()
    rows = RowFile(file).read(bad.append)
    sound = [pair for pair in map(pair_of, rows) if pair is not None]
    if count := len(bad) + len(rows) - len(sound):
        say(f"{file}: {count} lines are no pair's, or an older protocol's, and left out")
    wanted = {key: (a, o) for key, a, o in Pairs(*players, {}, rounds=rounds).every()}
    known = {pair.key: pair for pair in sound if pair.key in wanted and pair.is_of(*wanted[pair.key])}
    return Pairs(*players, known, not bad and len(known) == len(rows), rounds)


def fully_played(pairs: Pairs) -> tuple[list[BoardEntry], list[BoardEntry]]:
    """The players left once whoever lacks the largest share of pairs is taken out, until none lacks any."""
    allies, opponents = list(pairs.allies), list(pairs.opponents)
    keys = [[pair_key(a, o, pairs.rounds) for o in opponents] for a in allies]
    there = np.array([[key in pairs.known for key in record] for record in keys], bool)
    while not there.all():
        of_ally, of_opponent = there.mean(axis=1), there.mean(axis=0)
        axis = 0 if of_ally.min() <= of_opponent.min() else 1
        worst = int((of_ally, of_opponent)[axis].argmin())
        (allies, opponents)[axis].pop(worst)
        there = np.delete(there, worst, axis)
    return allies, opponents
