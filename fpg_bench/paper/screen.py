"""A scripted screen: do the paper's patterns show between players that do not learn, reading by reading?

Scripts need seconds where MADDPG needs hours, so every combination of settings can be looked at. What a
claim says of learned policies is asked of scripts that stand for them:

* D1, D4: the opponent ``adaptive`` on paths planned by the ``interceptor``, on fixed ones, and flying itself.
* D2: both sides at random stand for the beginning of training, ``expert`` and ``adaptive`` for its end.
* D3, D4: the ally plays the script that earns most, for each jamming type; with the knowledge base it is
  chosen among those that ask it, without among those that do not, in a game that has none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import ttest_ind

from fpg_bench.common.parallel import Job, check_all_done, run_jobs
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.envs.core import JointGame
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.game.measures import spectrum_overlap
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.paper.claims import STRONGER
from fpg_bench.paper.conditions import FIXED_PATHS
from fpg_bench.paper.readings import REMEMBERED, Reading
from fpg_bench.players.registry import as_player

ASKING = ("expert", "expert-spread")  # allies that ask the knowledge base
NOT_ASKING = ("idle", "reactive", "always-hop")
FINE = 30  # bins of a finer histogram, into which the jammer's centre falls as it is
_SUMS = {  # of a round, by what they are made of
    "ally": "ally_return",
    "opponent": "opponent_return",
    "overlap": "overlap",
    "success": "jammed",
    "hops": "hops",
}
_LONGEST = max(REMEMBERED.values())
_PLANNED: Mapping[str, Any] = {"planner": "interceptor"}


@dataclass(frozen=True)
class Part:
    """One atomic claim under a reading.

    Attributes:
        claim: of :data:`fpg_bench.paper.claims.ASPECTS`.
        statement: what is claimed to be positive.
        mean, low, high: the difference and its 95 % interval (Welch).
        p: two-sided.
    """

    claim: str
    statement: str
    mean: float
    low: float
    high: float
    p: float


@dataclass(frozen=True)
class Played:
    """What a pair of players came to, round by round of some matches.

    Attributes:
        ally, opponent: ``(rounds, games)`` rewards a step.
        overlap, success, hops: ``(rounds, games)`` shares of the steps.
        histograms: ``(rounds, 2, points)`` steps per frequency point, and ``(rounds, 2, 30)`` per finer bin.
    """

    ally: np.ndarray
    opponent: np.ndarray
    overlap: np.ndarray
    success: np.ndarray
    hops: np.ndarray
    histograms: tuple[np.ndarray, np.ndarray]

    def matches(self, name: str) -> np.ndarray:
        """``(games,)``: one of the first four, a match's mean."""
        return getattr(self, name).mean(axis=0)

    def first(self, rounds: int) -> Played:
        """The first rounds of each match."""
        cut = {name: getattr(self, name)[:rounds] for name in _SUMS}
        coarse, fine = (each[:rounds] for each in self.histograms)
        return replace(self, **cut, histograms=(coarse, fine))


def play_pair(
    reading: Reading, ally: str, opponent: str, games: int, rounds: int = 1, **options: Any
) -> Played:
    """Play the first rounds of as many matches as there are games; the same seeds for every pair.

    Scripts do not see what a hop costs, and the first rounds of a match are the same however many follow.
    So readings that differ in these points alone share what is played.

    Args:
        reading: of the rules.
        ally, opponent: scripts by name.
        games, rounds: how many matches at once, and rounds of each.
        **options: those of :func:`fpg_bench.envs.two_player.make_duel`.
    """
    free = reading.but(hop_cost="0", memory="for-ever")
    found = _play_free(free, ally, opponent, games, rounds, tuple(options.items()))
    return replace(found, ally=found.ally - reading.scenario().hop_cost * found.hops)


@lru_cache(maxsize=128)
def _play_free(
    reading: Reading, ally: str, opponent: str, games: int, rounds: int, options: tuple[tuple[str, Any], ...]
) -> Played:
    scenario = reading.scenario()
    core = JointGame(games, scenario=scenario, **dict(options))
    players: list[Any] = [as_player(ally, "ally", scenario), as_player(opponent, "opponent", scenario)]
    core.reset(seeds=np.array(evaluation_seeds(games)))
    tallies, coarse, fine = [], [], []
    for number in range(rounds):
        if number:
            core.reset(np.ones(games, bool))
        fine.append(_play_round(core, players, games))
        tallies.append(core.duel.batch.tallies.copy())
        coarse.append(core.duel.batch.histograms.sum(axis=0))
    sums = np.stack(tallies)
    shares: dict[str, Any] = {name: sums[of] / sums["steps"] for name, of in _SUMS.items()}
    return Played(**shares, histograms=(np.stack(coarse), np.stack(fine)))


def _play_round(core: JointGame, players: Sequence[Any], games: int) -> np.ndarray:
    """Play a round; gives how often both centre frequencies fell into each of the finer bins."""
    scenario, state = core.scenario, core.duel.batch.games
    memories: list[Any] = [None, None]
    starts, counts = np.ones(games, bool), np.zeros((2, FINE))
    for _ in range(scenario.steps_per_round):
        acts = []
        for side, (player, seen) in enumerate(
            zip(players, np.split(core.observations, 2, axis=1), strict=True)
        ):
            actions, memories[side] = player.predict(np.ascontiguousarray(seen), memories[side], starts)
            acts.append(actions)
        core.step(np.concatenate(acts, axis=1))
        starts = np.zeros(games, bool)
        for line, name in zip(counts, ("frequency_mhz", "jamming_mhz"), strict=True):
            share = (state[name] - scenario.band_low_mhz) / (scenario.band_high_mhz - scenario.band_low_mhz)
            line += np.bincount((share * FINE).astype(int).clip(0, FINE - 1), minlength=FINE)
    return counts


def screen(reading: Reading, games: int) -> Row:
    """What the scripts say of each claim under a reading.

    Args:
        reading: of the rules.
        games: matches of each pair; planned paths have a third of them, and all rounds.

    Returns:
        A row: the reading, its parts, and the levels of Fig. 4.
    """
    pair = partial(play_pair, reading, games=games)
    best = {kind: _best(pair, kind, (*ASKING, *NOT_ASKING)) for kind in JAMMING_TYPES}
    most = max(2, games // 3)
    planned = play_pair(reading, "expert", "adaptive", most, _LONGEST, **_PLANNED).first(reading.rounds)
    begun = pair("random", "random", path="circle")
    parts = [
        *_of_paths(pair, planned),
        *_over_training(begun, planned),
        *_of_types(best),
        _difference(
            "D4 knowledge",
            "ally's reward: best script with - without knowledge base",
            _best(pair, "adaptive", ASKING).matches("ally"),
            _best(pair, "adaptive", NOT_ASKING, knowledge="none").matches("ally"),
        ),
    ]
    return {
        "reading": reading.name,
        "games": games,
        "parts": [asdict(part) for part in parts],
        "overlap": [round(float(each.overlap.mean()), 5) for each in (begun, planned)],
        "spectrum overlap": [
            [round(spectrum_overlap(each.sum(axis=0)) or 0.0, 5) for each in played.histograms]
            for played in (begun, planned)
        ],
    }


def _best(pair: Any, opponent: str, allies: Iterable[str], **options: Any) -> Played:
    """The ally's best script against an opponent on the circle: what it plays is told by its own reward."""
    found: list[Played] = [pair(ally, opponent, path="circle", **options) for ally in allies]
    return max(found, key=lambda played: float(played.ally.mean()))


def _of_paths(pair: Any, planned: Played) -> Iterator[Part]:
    for path in FIXED_PATHS:
        fixed = pair("expert", "adaptive", path=path)
        yield _earned("D1", f"planned - {path}", planned, fixed)
    yield _earned("D4 planner", "planned - learned path", planned, pair("expert", "adaptive", path="learned"))


def _over_training(begun: Played, ended: Played) -> Iterator[Part]:
    for statement, name, more, less in (
        ("overlap ratio: early - late", "overlap", begun, ended),
        ("jamming success rate: late - early", "success", ended, begun),
    ):
        yield _difference("D2", statement, more.matches(name), less.matches(name))


def _of_types(best: Mapping[str, Played]) -> Iterator[Part]:
    for kind, played in best.items():
        statement = f"{kind} alone: ally's - opponent's reward"
        yield _difference("D3 level", statement, played.matches("ally"), played.matches("opponent"))
    for more, less in STRONGER:
        yield _earned("D3 order", f"{more} - {less}", best[more], best[less])


def _earned(claim: str, what: str, more: Played, less: Played) -> Part:
    """A difference of the opponent's rewards."""
    return _difference(
        claim, f"opponent's reward: {what}", more.matches("opponent"), less.matches("opponent")
    )


def _difference(claim: str, statement: str, more: np.ndarray, less: np.ndarray) -> Part:
    mean = float(more.mean() - less.mean())
    if more.std() == less.std() == 0:  # nothing varies
        return Part(claim, statement, mean, mean, mean, 0.0 if mean else 1.0)
    test = ttest_ind(more, less, equal_var=False)
    low, high = test.confidence_interval()
    return Part(claim, statement, *(float(f"{x:.5g}") for x in (mean, low, high, test.pvalue)))


def screen_all(readings: Iterable[Reading], file: Path, games: int = 96, **where: Any) -> list[Row]:
    """Screen readings, a row each as they finish; rows that are there are not made again.

    Args:
        readings: which.
        file: of the rows.
        games: see :func:`screen`.
        **where: ``workers``, ``backend``, ``address`` and ``say``; see :func:`.run_jobs`.

    Returns:
        The rows, in the order of the readings.

    Raises:
        UserError: rows that are none, or that failed (the others are kept).
    """
    rows = RowFile(file, {"reading": str, "games": int, "parts": list})
    listed = list(readings)
    with rows.locked():
        there = {row["reading"] for row in rows.read() if row["games"] == games}
        missing = [reading for reading in listed if reading.name not in there]
        listed_jobs = [
            Job(f"{part[0].name} and {len(part) - 1} more", partial(_several, part, games), rows.append)
            for part in _together(missing)
        ]
        check_all_done(run_jobs(listed_jobs, **where))
        found = {row["reading"]: row for row in rows.read() if row["games"] == games}
    return [found[reading.name] for reading in listed]


def _together(readings: Iterable[Reading]) -> list[list[Reading]]:
    """Readings that share what is played: a job for each such group."""
    groups: dict[Reading, list[Reading]] = {}
    for reading in readings:
        groups.setdefault(reading.but(hop_cost="0", memory="for-ever"), []).append(reading)
    return list(groups.values())


def _several(readings: Iterable[Reading], games: int) -> list[Row]:
    return [screen(reading, games) for reading in readings]
