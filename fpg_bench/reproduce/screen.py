"""A scripted screen: do the paper's patterns show between players that do not learn, reading by reading?

Scripts need seconds where MADDPG needs hours, so every combination of settings can be looked at. What a
claim says of learned policies is asked of scripts that stand for them:

* D1, D4: the opponent ``adaptive`` on paths planned by the ``interceptor``, on fixed ones, and flying itself.
* D2: both sides at random stand for the beginning of training, ``expert`` and ``adaptive`` for its end.
* D3, D4: the ally plays the script that earns most, for each jamming type; with the knowledge base it is
  chosen among those that ask it, without among those that do not.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import ttest_ind

from fpg_bench.envs.two_sided import TwoSided
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.game.measures import measures, pool, spectrum_overlap
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.state import TALLY
from fpg_bench.jobs.job import Job, check_all_done
from fpg_bench.jobs.run import run_jobs
from fpg_bench.players.naming import as_player
from fpg_bench.reproduce.conditions import FIXED_PATHS
from fpg_bench.reproduce.readings import Reading
from fpg_bench.rows import Row, RowFile

ASKING = ("expert", "expert-spread")  # allies that ask the knowledge base
NOT_ASKING = ("idle", "reactive", "always-hop")
FINE = 30  # bins of a finer histogram, into which the jammer's centre falls as it is
_HOP_GATE, _KNOWLEDGE_GATE = 0, 4
_PLANNED: Mapping[str, Any] = {"planner": "interceptor"}


@dataclass(frozen=True)
class Part:
    """One atomic claim under a reading.

    Attributes:
        claim: ``D1`` to ``D4``.
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
    """What a pair of players came to.

    Attributes:
        ally, opponent: ``(games,)`` rewards a step of each match.
        overlap, success: ``(games,)`` shares of the steps.
        histograms: ``(2, points)`` steps per frequency point, and ``(2, 30)`` per finer bin.
    """

    ally: np.ndarray
    opponent: np.ndarray
    overlap: np.ndarray
    success: np.ndarray
    histograms: tuple[np.ndarray, np.ndarray]


def play_pair(
    reading: Reading, ally: str, opponent: str, games: int, rounds: int = 1, **options: Any
) -> Played:
    """Play the first rounds of as many matches as there are games; the same seeds for every pair.

    Args:
        reading: of the rules.
        ally, opponent: scripts by name.
        games, rounds: how many matches at once, and rounds of each.
        **options: those of :func:`fpg_bench.envs.duel.make_duel`.
    """
    scenario = reading.scenario()
    core = TwoSided(games, scenario=scenario, **options)
    players: list[Any] = [as_player(ally, "ally", scenario), as_player(opponent, "opponent", scenario)]
    core.reset(seeds=np.array(evaluation_seeds(games)))
    state, arena = core.duel.arena.games, core.duel.arena
    total = np.zeros(games, TALLY)
    coarse, fine = np.zeros((2, scenario.frequency_points)), np.zeros((2, FINE))
    edges = np.linspace(scenario.band_low_mhz, scenario.band_high_mhz, FINE + 1)
    for number in range(rounds):
        if number:
            core.reset(np.ones(games, bool))
        memories, starts = [None, None], np.ones(games, bool)
        for _ in range(scenario.steps_per_round):
            seen = np.split(core.observations, 2, axis=1)
            acts = []
            for side, player in enumerate(players):
                actions, memories[side] = player.predict(
                    np.ascontiguousarray(seen[side]), memories[side], starts
                )
                acts.append(actions)
            if reading.always_hops:
                _hop(acts[0], ally)
            core.step(np.concatenate(acts, axis=1))
            starts = np.zeros(games, bool)
            for line, name in zip(fine, ("frequency_mhz", "jamming_mhz"), strict=True):
                line += np.histogram(np.clip(state[name], edges[0], edges[-1]), edges)[0]
        for name in TALLY.names or ():
            total[name] += arena.tallies[name]
        coarse += arena.histograms.sum(axis=0)
    found = [measures(pool(each), arena.histograms[0]) for each in total[:, None]]
    steps = rounds * scenario.steps_per_round
    return Played(
        total["ally_return"] / steps,
        total["opponent_return"] / steps,
        np.array([each["overlap_ratio"] for each in found], float),
        np.array([each["jamming_success_rate"] for each in found], float),
        (coarse, fine),
    )


def _hop(actions: np.ndarray, ally: str) -> None:
    """Let an ally hop in every step, by the knowledge base if it is one that asks it, else anywhere."""
    actions[:, _HOP_GATE] = 1
    if ally in ASKING:
        actions[:, _KNOWLEDGE_GATE] = 1


def screen(reading: Reading, games: int) -> Row:
    """What the scripts say of each claim under a reading.

    Args:
        reading: of the rules.
        games: matches of each pair; planned paths have a quarter of them, and all rounds.

    Returns:
        A row: the reading, its parts, and the levels of Fig. 4.
    """
    pair = partial(play_pair, reading, games=games)
    best = {kind: _best(pair, kind, (*ASKING, *NOT_ASKING)) for kind in JAMMING_TYPES}
    rounds = reading.scenario().rounds_per_match
    planned = play_pair(reading, "expert", "adaptive", max(games // 4, 2), rounds, **_PLANNED)
    begun = pair("random", "random", path="circle")
    parts = [
        *_of_paths(pair, planned),
        *_over_training(begun, planned),
        *_of_types(best),
        _difference(
            "D4",
            "ally's reward: best script with - without knowledge base",
            *(_best(pair, "adaptive", allies).ally for allies in (ASKING, NOT_ASKING)),
        ),
    ]
    return {
        "reading": reading.name,
        "games": games,
        "parts": [asdict(part) for part in parts],
        "overlap": [round(float(each.overlap.mean()), 5) for each in (begun, planned)],
        "spectrum overlap": [
            [round(spectrum_overlap(each) or 0.0, 5) for each in played.histograms]
            for played in (begun, planned)
        ],
    }


def _best(pair: Any, opponent: str, allies: Iterable[str]) -> Played:
    """The ally's best script against an opponent on the circle: what it plays is told by its own reward."""
    found: list[Played] = [pair(ally, opponent, path="circle") for ally in allies]
    return max(found, key=lambda played: float(played.ally.mean()))


def _of_paths(pair: Any, planned: Played) -> Iterator[Part]:
    for path in FIXED_PATHS:
        fixed = pair("expert", "adaptive", path=path)
        yield _difference("D1", f"opponent's reward: planned - {path}", planned.opponent, fixed.opponent)
    flown = pair("expert", "adaptive", path="learned")
    yield _difference("D4", "opponent's reward: planned - learned path", planned.opponent, flown.opponent)


def _over_training(begun: Played, ended: Played) -> Iterator[Part]:
    yield _difference("D2", "overlap ratio: early - late", begun.overlap, ended.overlap)
    yield _difference("D2", "jamming success rate: late - early", ended.success, begun.success)


def _of_types(best: Mapping[str, Played]) -> Iterator[Part]:
    for kind, played in best.items():
        yield _difference("D3", f"{kind} alone: ally's - opponent's reward", played.ally, played.opponent)
    for more, less in (*((kind, "tone") for kind in JAMMING_TYPES[1:]), *_BELOW_BROADBAND):
        statement = f"opponent's reward: {more} - {less}"
        yield _difference("D3", statement, best[more].opponent, best[less].opponent)


_BELOW_BROADBAND = (("broadband", "narrowband"), ("broadband", "comb"))


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
        **where: ``workers``, ``backend``, ``address`` and ``say``; see :func:`fpg_bench.jobs.run.run_jobs`.

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
        some = [missing[start : start + _AT_ONCE] for start in range(0, len(missing), _AT_ONCE)]
        listed_jobs = [
            Job(f"{part[0].name} and {len(part) - 1} more", partial(_several, part, games), rows.append)
            for part in some
        ]
        check_all_done(run_jobs(listed_jobs, **where))
        found = {row["reading"]: row for row in rows.read() if row["games"] == games}
    return [found[reading.name] for reading in listed]


_AT_ONCE = 8  # readings of a job


def _several(readings: Iterable[Reading], games: int) -> list[Row]:
    return [screen(reading, games) for reading in readings]
