"""Cross-play: every ally of the board against every opponent, on the same chance, by both sides' returns."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import random
import shutil
from collections.abc import Callable, Collection, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.envs.duel import Duel
from fpg_bench.evaluation.field import Scale
from fpg_bench.evaluation.play import LOST_SCORE
from fpg_bench.evaluation.seeds import PROTOCOL, evaluation_seeds
from fpg_bench.files import write_whole
from fpg_bench.game.scenario import Scenario
from fpg_bench.jobs.folders import folder_job
from fpg_bench.jobs.job import attempt, outcome_of
from fpg_bench.jobs.run import run_jobs
from fpg_bench.leaderboard.cases import Case, at_work, make_case, submission_folders, work_folder
from fpg_bench.leaderboard.playing import FAILED, Part, parts_of, seated
from fpg_bench.leaderboard.result import rounded
from fpg_bench.leaderboard.team import Team
from fpg_bench.leaderboard.tracks import KNOWN
from fpg_bench.matches.rounds import play_round
from fpg_bench.matches.rounds import seated as table_of
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.players.naming import as_player
from fpg_bench.players.player import SIDES
from fpg_bench.rows import Row, RowFile

ROUNDS = 100
WITHIN = 0.005  # of a rate, and of the distance from 0 to 100, when it is played again
_ROW = {
    "ally",
    "opponent",
    "key",
    "rounds",
    "jamming_success_rate",
    "lost",
    "ally_rewards",
    "opponent_rewards",
}


@dataclass(frozen=True)
class Entrant:
    """Who plays: its name in its track, its parts, what it plays in, its track's scale, and the season."""

    slug: str
    side: str
    parts: tuple[Part, ...]
    scenario: Scenario
    scale: Scale
    season: str

    @cached_property
    def identity(self) -> list[str]:
        """What decides how it plays."""
        return [part.plays if isinstance(part.plays, str) else part.plays.sha256 for part in self.parts]

    @cached_property
    def scenario_hash(self) -> str:
        """What its games are: of a pair, those of the opponent."""
        return self.scenario.hash


def entrants(board: Path) -> tuple[list[Entrant], list[Entrant]]:
    """Allies and opponents of a board whose results are verified, by name; all others are left out."""
    found = []
    for folder in submission_folders(board):
        if folder.parent.name in SIDES:
            case = outcome_of(partial(make_case, board, folder))  # submit verify says what is wrong
            found += [case.result] if case.error is None else []
    return entrants_of(found)


def entrants_of(cases: Iterable[Case]) -> tuple[list[Entrant], list[Entrant]]:
    """Allies and opponents among cases, of those whose results are verified."""
    every = [
        _entrant(case)
        for case in cases
        if case.known is not None and case.known.verified and case.submission.track in SIDES
    ]
    return [e for e in every if e.side == "ally"], [e for e in every if e.side == "opponent"]


def _entrant(case: Case) -> Entrant:
    known, submission = case.fields[KNOWN], case.submission
    scenario = known.counterparts[0].scenario  # an opponent's counterparts are all on one path
    parts = tuple(parts_of(submission))
    return Entrant(submission.slug, submission.track, parts, scenario, known.scale, known.season)


def pair_key(ally: Entrant, opponent: Entrant, rounds: int) -> str:
    """What decides a pair's figure, as 16 hexadecimal digits."""
    content = [ally.identity, opponent.identity, opponent.scenario_hash, PROTOCOL, ally.season, rounds]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]


def crossplay_file(board: Path) -> Path:
    """Where the figures of all pairs lie."""
    return board / "results" / "crossplay.jsonl"


def read_pairs(
    board: Path,
    allies: list[Entrant],
    opponents: list[Entrant],
    rounds: int,
    say: Callable[[str], None] = lambda line: None,
) -> dict[str, Row]:
    """The figures that are there of pairs of these players, by their keys; what is none is left out.

    Args:
        board: the leaderboard's folder.
        allies, opponents: the players.
        rounds: of each pair.
        say: told how many lines are left out, and of which file.

    Raises:
        UserError: the file cannot be read.
    """
    wanted = {pair_key(a, o, rounds): (a, o) for a in allies for o in opponents}
    bad: list[str] = []
    rows = RowFile(crossplay_file(board)).read(bad.append)
    sound = [row for row in rows if _is_pair(row)]
    if count := len(bad) + len(rows) - len(sound):
        say(f"{crossplay_file(board)}: {count} lines are no pair's, or an older protocol's, and left out")
    found = {}
    for row in sound:
        ally, opponent = wanted.get(row["key"], (None, None))
        if ally is not None and opponent is not None and _is_of(row, ally, opponent):
            found[row["key"]] = row
    return found


def fully_played(
    allies: list[Entrant], opponents: list[Entrant], known: Container[str], rounds: int = ROUNDS
) -> tuple[list[Entrant], list[Entrant]]:
    """The players left once whoever lacks the largest share of pairs is taken out, until none lacks any.

    Args:
        allies, opponents: the players.
        known: the keys of the pairs that were played.
        rounds: of each pair.
    """
    allies, opponents = list(allies), list(opponents)
    there = np.array([[pair_key(a, o, rounds) in known for o in opponents] for a in allies], bool)
    while not there.all():
        of_ally, of_opponent = there.mean(axis=1), there.mean(axis=0)
        axis = 0 if of_ally.min() <= of_opponent.min() else 1
        worst = int((of_ally, of_opponent)[axis].argmin())
        (allies, opponents)[axis].pop(worst)
        there = np.delete(there, worst, axis)
    return allies, opponents


def _is_pair(row: Row) -> bool:
    rate, words = row.get("jamming_success_rate"), [row.get(name) for name in ("ally", "opponent", "key")]
    good = isinstance(rate, int | float) and 0 <= rate <= 1 and all(isinstance(word, str) for word in words)
    lost = row.get("lost")
    good &= isinstance(lost, list) and len(lost) == len(SIDES) and all(type(one) is int for one in lost)
    return good and row.keys() == _ROW and all(_are_rewards(row[f"{side}_rewards"]) for side in SIDES)


def _is_of(row: Row, ally: Entrant, opponent: Entrant) -> bool:
    """Whether a row tells of these two, and of as many training seeds as they have."""
    named = (row["ally"], row["opponent"]) == (ally.slug, opponent.slug)
    return named and all(
        len(row[f"{side}_rewards"]) == len(who.parts)
        for side, who in zip(SIDES, (ally, opponent), strict=True)
    )


def _are_rewards(values: Any) -> bool:
    """Whether these are returns a step, one for each training seed."""
    numbers = isinstance(values, list) and bool(values)
    return numbers and all(type(value) in (int, float) and abs(value) < 1e6 for value in values)


def reward_of(row: Row, side: str) -> float:
    """A side's return a step in a pair."""
    return float(np.mean(row[f"{side}_rewards"]))


def play_missing(
    board: str | Path,
    *,
    rounds: int = ROUNDS,
    trusted: Collection[Row] | None = None,
    jobs: int = 1,
    backend: str = "loky",
    address: str | None = None,
    say: Callable[[str], None] = print,
) -> list[str]:
    """Play the pairs of a board that have no figure yet; those of players that are gone are dropped.

    Args:
        board: the leaderboard's folder.
        rounds: of each pair, dealt out evenly to the training seeds of both.
        trusted: the rows that are believed; all others are played again and replaced. None: all are.
        jobs: how many allies play at once.
        backend, address: see :func:`fpg_bench.jobs.run.run_jobs`.
        say: told how it goes.

    Returns:
        What could not be played, and which untrusted rows did not hold, one line each.
    """
    board = Path(board)
    allies, opponents = entrants(board)
    claimed = read_pairs(board, allies, opponents, rounds, say)
    known = {key: row for key, row in claimed.items() if trusted is None or row in trusted}
    missing = [(a, o) for a in allies for o in opponents if pair_key(a, o, rounds) not in known]
    say(f"crossplay: {len(missing)} of {len(allies) * len(opponents)} pairs to play")
    with at_work(board):
        played, failed = _play(board, missing, rounds, jobs, backend, address)
    known |= {row["key"]: row for row in played}
    for row in (row for row in played if row["key"] in claimed):
        scales = {"ally": allies[0].scale, "opponent": opponents[0].scale}
        failed += [
            f"{line}; replaced, commit this one" for line in _differing(row, claimed[row["key"]], scales)
        ]
    bad: list[str] = []
    rows = RowFile(crossplay_file(board)).read(bad.append)
    if missing or bad or len(known) != len(rows):
        _write(board, [known[k] for a in allies for o in opponents if (k := pair_key(a, o, rounds)) in known])
    return failed


def check_pairs(board: str | Path, share: float, seed: int, rounds: int = ROUNDS) -> list[str]:
    """Play some pairs again, drawn at random; what differs, one line each.

    Args:
        board: the leaderboard's folder.
        share: of the pairs; at least one is played.
        seed: of the draw.
        rounds: as they were played.
    """
    board = Path(board)
    allies, opponents = entrants(board)
    known = read_pairs(board, allies, opponents, rounds)
    pairs = [(a, o) for a in allies for o in opponents if pair_key(a, o, rounds) in known]
    drawn = random.Random(seed).sample(pairs, math.ceil(share * len(pairs)))
    with at_work(board):
        played, failed = _play(board, drawn, rounds)
    for row in played:
        scales = {"ally": allies[0].scale, "opponent": opponents[0].scale}
        failed += _differing(row, known[row["key"]], scales)
    return failed


def _differing(now: Row, then: Row, scales: dict[str, Scale]) -> list[str]:
    """What differs of a pair that was played again, one line each."""
    return [
        f"{now['ally']} - {now['opponent']}: {what} {value:.4f}, the figure says {before:.4f}"
        for what, value, before, most in _compared(now, then, scales)
        if abs(value - before) > most
    ]


def _compared(now: Row, then: Row, scales: dict[str, Scale]) -> Iterator[tuple[str, float, float, float]]:
    """What is compared of a pair: its name, both values, and how far they may be apart."""
    yield "jammed", now["jamming_success_rate"], then["jamming_success_rate"], WITHIN
    for side, scale in scales.items():
        yield (
            f"{side}'s return a step",
            reward_of(now, side),
            reward_of(then, side),
            WITHIN * (scale.top - scale.zero),
        )


def _write(board: Path, rows: list[Row]) -> None:
    text = "".join(json.dumps(row, separators=(",", ":")) + "\n" for row in rows)
    write_whole(crossplay_file(board), text)


def _play(
    board: Path,
    pairs: Sequence[tuple[Entrant, Entrant]],
    rounds: int,
    workers: int = 1,
    backend: str = "loky",
    address: str | None = None,
) -> tuple[list[Row], list[str]]:
    """Play pairs, an ally's after one another: their rows, and what failed."""
    work = work_folder(board) / "crossplay"
    jobs, folders = [], []
    for ally in {a.slug: a for a, _ in pairs}.values():
        others = [o for a, o in pairs if a is ally]
        folder = work / ally.slug
        done = partial(_is_done, folder, [pair_key(ally, o, rounds) for o in others])
        jobs.append(folder_job(ally.slug, folder, partial(_fill, ally, others, rounds), done))
        folders.append((folder, {pair_key(ally, o, rounds) for o in others}))
    failed = {}
    if (workers, backend, address) != (1, "loky", None):
        failed = run_jobs(jobs, workers, backend, address, say=lambda line: None)
    else:
        for job in jobs:
            outcome = None if job.done() else attempt(job.run, os.getcwd())
            if outcome is not None and outcome.error is not None:
                failed[job.name] = outcome.error
    rows = [row for folder, keys in folders for row in _rows(folder) if row["key"] in keys]
    shutil.rmtree(work, ignore_errors=True)
    lost = [f"{row['ally']} - {row['opponent']}: {row[FAILED]}" for row in rows if FAILED in row]
    return [row for row in rows if FAILED not in row], lost + [f"{k}: {why}" for k, why in failed.items()]


def _rows(folder: Path) -> list[Row]:
    return RowFile(folder / "pairs.jsonl").read()


def _is_done(folder: Path, keys: list[str]) -> bool:
    return set(keys) <= {row["key"] for row in _rows(folder)}


def _fill(ally: Entrant, opponents: list[Entrant], rounds: int, folder: Path) -> None:
    """Play an ally against opponents into a folder, a line each as it ends."""
    from fpg_bench.leaderboard.host import PolicyFailed

    there = {row["key"] for row in _rows(folder)}
    for opponent in opponents:
        key = pair_key(ally, opponent, rounds)
        if key in there:
            continue
        head = {"ally": ally.slug, "opponent": opponent.slug, "key": key}
        try:
            row = head | play_pair(ally, opponent, rounds)
        except PolicyFailed as error:
            row = head | {FAILED: str(error)}
        RowFile(folder / "pairs.jsonl").append([row])


def play_pair(ally: Entrant, opponent: Entrant, rounds: int = ROUNDS) -> Row:
    """Play one pair: all combinations of both sides' training seeds, equally often.

    A round that a side loses by an answer that is none counts as jammed throughout where it is the ally's,
    and as never jammed where it is the opponent's; its return is that of a lost round in its track.

    Returns:
        ``rounds``; ``ally_rewards`` and ``opponent_rewards``, the return a step of each of a side's training
        seeds; ``jamming_success_rate``; and how many rounds were ``lost``, ``[ally's, opponent's]``.
    """
    games = np.arange(rounds)
    of_ally = games % len(ally.parts)
    of_opponent = games // len(ally.parts) % len(opponent.parts)
    duel = Duel(opponent.scenario, rounds)
    with _team(ally, of_ally, duel) as one, _team(opponent, of_opponent, duel) as other:
        play_round(table_of(duel, one, other), seeds=np.array(evaluation_seeds(rounds, ally.season)))
        lost = one.invalid.copy(), other.invalid.copy()
    rates = duel.arena.tallies["jammed"] / duel.arena.tallies["steps"]
    rates[lost[0] & ~lost[1]], rates[lost[1] & ~lost[0]] = 1.0, 0.0
    rate = rounded(float(rates.mean()))
    rewards = {
        f"{who.side}_rewards": _rewards(duel, who, gone, seats)
        for who, gone, seats in ((ally, lost[0], of_ally), (opponent, lost[1], of_opponent))
    }
    return {
        "rounds": rounds,
        **rewards,
        "jamming_success_rate": rate,
        "lost": [int(side.sum()) for side in lost],
    }


def _rewards(duel: Duel, who: Entrant, lost: np.ndarray, seats: np.ndarray) -> list[float | None]:
    """The return a step of each of a side's parts."""
    found = duel.arena.tallies[f"{who.side}_return"] / duel.arena.tallies["steps"]
    worst = who.scale.zero + LOST_SCORE / 100 * (who.scale.top - who.scale.zero)
    found[lost] = min([worst, *found[~lost]])
    return [rounded(float(found[seats == k].mean())) for k in range(len(who.parts))]


@contextlib.contextmanager
def _team(who: Entrant, seats: np.ndarray, duel: Duel) -> Iterator[Team]:
    with contextlib.ExitStack() as stack:
        plays = [stack.enter_context(_player(part)) for part in who.parts]
        yield Team([as_player(player, who.side, duel.scenario) for player in plays], seats)


def _player(part: Part) -> contextlib.AbstractContextManager[Any]:
    """A part as a player; what the package ships needs no process of its own, which saves time."""
    if part.shipped and not isinstance(part.plays, str):
        return contextlib.nullcontext(OnnxPlayer(part.plays.model, part.plays.about))
    return seated(part.plays)
