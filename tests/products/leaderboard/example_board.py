"""A made-up board for the tests of the site: any number of entries, and texts that try to become markup."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from typing import Any
from unittest import mock

import numpy as np

from fpg_bench.evaluation.statistics import Interval
from fpg_bench.evaluation.suite import Scale
from fpg_bench.products.leaderboard.about import SubmissionFile, Training
from fpg_bench.products.leaderboard.board import (
    CROSSPLAY,
    Board,
    BoardEntry,
    BoardSuite,
    BoardTrack,
    CrossPlay,
    Figures,
    NashMixture,
)
from fpg_bench.products.leaderboard.exploited import RESPONSE, Attack, Exploited
from fpg_bench.products.leaderboard.site import page_data
from fpg_bench.products.leaderboard.tracks import PUBLIC, SHIFTED, UNSEEN

HOSTILE = (
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(2)>',
    "</script><script>alert(3)</script>",
    "{{ 7 * 7 }} {% raw %}",
    "javascript:alert(4)",
    "' onmouseover='alert(5)",
)
TRACKS = {
    "ally": ("Allies", "ally", ["tone", "comb", "adaptive"]),
    "opponent-pursuit": ("Opponents in pursuit", "opponent", ["idle", "expert"]),
}
CHANGED_RULES = ("checks every 3 s", "slower ally")
SEEDS = "training seeds and matches"


@contextmanager
def small_zoo() -> Iterator[None]:
    """Two agents of the zoo, so that sites are built quickly."""
    agents = dict(islice(page_data.zoo_policies().items(), 2))
    with mock.patch.object(page_data, "zoo_policies", return_value=agents):
        yield


def example_board(
    entries: int = 6, hostile: bool = False, rivals: int | None = None, season: int | None = 1
) -> Board:
    """Return a board of two tracks: so many entries, and two; season None: none is closed."""
    rng = np.random.default_rng(0)
    tracks = []
    for number, (key, (title, side, others)) in enumerate(TRACKS.items()):
        names = [f"{other}/pursuit" for other in (others if rivals is None else range(rivals))]
        suites = _suites(side, names, season)
        rows = [_entry(rng, key, index, suites, hostile) for index in range(2 if number else entries)]
        ordered = sorted((r for r in rows if r.figures), key=lambda r: -r.figures.score.value)
        ranked = [
            dataclasses.replace(
                row,
                figures=dataclasses.replace(
                    row.figures,
                    rank=(place // 2 * 2 + 1, place // 2 * 2 + 2),
                    may_be_best=place < 2,
                    improvement=_score(0.25, 0.125, SEEDS) if place and row.kind != "script" else None,
                    behind=_score(row.figures.score.value - ordered[0].figures.score.value, 4),
                ),
            )
            for place, row in enumerate(ordered)
        ]
        tracks.append(
            BoardTrack(
                key=key,
                title=title,
                side=side,
                ranked_by=suites[-2].role if season else PUBLIC,
                suites=suites,
                scale=Scale(-5.66, 22.0),
                checks={"halves agree": True, "kinds agree": False} if number else {},
                entries=(*ranked, *(row for row in rows if row.figures is None)),
                student={suite.role: 3.25 for suite in suites},
            )
        )
    return Board(
        "0.1.0", "2", season, "2026-01-01", tuple(tracks), {"standard": _crossplay(rng, tracks, season)}
    )


def with_link(board: Board, season: int) -> Board:
    """Return a board with its tracks and cross-play in ``link``, too; an ally is missing there."""

    def renamed(entry: BoardEntry) -> BoardEntry:
        return dataclasses.replace(entry, slug=f"{entry.slug}-link", name=f"{entry.name} on a link")

    tracks = tuple(
        dataclasses.replace(track, key=f"{track.side}-link", entries=tuple(map(renamed, track.entries)))
        for track in board.tracks
    )
    crossplay = board.crossplay["standard"]
    allies, opponents = (
        tuple(f"{slug}-link" for slug in slugs) for slugs in (crossplay.allies, crossplay.opponents)
    )
    link = dataclasses.replace(
        crossplay,
        season=season,
        allies=allies,
        opponents=opponents,
        missing={"ally": (allies[1],), "opponent": ()},
        nash=NashMixture({allies[0]: 1.0}, {opponents[0]: 1.0}, 0.5),
    )
    both = {"standard": crossplay, "link": link}
    return dataclasses.replace(board, tracks=(*board.tracks, *tracks), crossplay=both)


def with_entry(board: Board, name: str, **changes: Any) -> Board:
    """Return a board with another version of one entry of the first track."""
    first, *others = board.tracks
    entries = tuple(dataclasses.replace(e, **changes) if e.slug == name else e for e in first.entries)
    return dataclasses.replace(board, tracks=(dataclasses.replace(first, entries=entries), *others))


def with_figures(board: Board, slug: str, **figures: Any) -> Board:
    """Return a board with other figures of one entry of the first track."""
    (entry,) = (entry for entry in board.tracks[0].entries if entry.slug == slug)
    return with_entry(board, slug, figures=dataclasses.replace(entry.figures, **figures))


def _suites(side: str, public: list[str], season: int | None) -> tuple[BoardSuite, ...]:
    """Return the public suite alone before a season is closed, all that there can be after it."""
    rivals = {PUBLIC: (f"{side}-v2", public)}
    if season is not None:
        rivals[UNSEEN] = f"{side}-season-{season}", [f"trained-{k}" for k in range(3)]
        rivals[SHIFTED] = f"{side}-shifted-v1", [f"{public[0]}, {change}" for change in CHANGED_RULES]
    return tuple(
        BoardSuite(
            role,
            name,
            "0" * 64,
            100,
            tuple(names),
            trained={names[0]: "TD3, trained against expert"} if role == UNSEEN else {},
            play={} if role == SHIFTED else {names[0]: f"--opponent {names[0]} --path pursuit --seed 7"},
        )
        for role, (name, names) in rivals.items()
    )


def _score(value: float, half: float, over: str = "") -> Interval:
    return Interval(value, value - half, value + half, over)


def _entry(
    rng: np.random.Generator, key: str, index: int, suites: tuple[BoardSuite, ...], hostile: bool
) -> BoardEntry:
    kind = ("script", "zoo", "submitted")[index % 3]
    text = HOSTILE[index % len(HOSTILE)] if hostile else ""
    is_verified = key != "ally" or index != 0
    figures = _figures(rng, index, kind, suites, text)
    about = SubmissionFile.model_construct(
        authors=(f"Author {index}", text) if text else (f"Author {index}",),
        algorithm=f"PPO {text}".strip(),
        reference=text or "https://example.org/paper?a=1&b=2",
        licence=text or "MIT",
        training=None if kind == "script" else Training(steps=2_000_000, hours=1.5, seeds=(0, 1, 2, 3, 4)),
        saw=text or "the adaptive opponent in pursuit",
        unable=text or "nothing that we know of",
        description=text,
        script=("idle", "tone")[key != "ally"] if kind == "script" else None,
        zoo="no-such/agent" if kind == "zoo" else None,
    )
    return BoardEntry(
        slug=f"player-{index}",
        name=f"Player {index} {text}".strip(),
        about=about,
        actions=() if kind == "script" else ("discrete",),
        player="idle" if kind == "script" else f"no-such/agent/seed_0{text}",
        command=f"fpg-bench train{text}" if kind == "zoo" else None,
        reason=None if is_verified else f"seed_0: outran the limit {text}".strip(),
        figures=figures if is_verified else None,
        offline=(f"fpg/ally-mixed-v0{text}",) if kind == "submitted" else (),
    )


def _figures(
    rng: np.random.Generator, index: int, kind: str, suites: tuple[BoardSuite, ...], text: str
) -> Figures:
    scores = {suite.role: float(rng.uniform(20, 130)) for suite in suites}
    by_rival = {
        suite.role: {name: _score(scores[suite.role] + float(rng.normal(0, 15)), 9) for name in suite.rivals}
        for suite in suites
    }
    score = scores.get(UNSEEN, scores[PUBLIC])
    return Figures(
        rank=None,
        may_be_best=False,
        behind=None,
        improvement=None,
        score=_score(score, 6, SEEDS),
        scores={role: _score(value, 6, SEEDS) for role, value in scores.items()},
        exploited=_exploited(index, kind, text),
        by_rival=by_rival,
        first_rounds={role: dict.fromkeys(scores, 1234.5) for role, scores in by_rival.items()},
        units=_units(by_rival),
        by_seed={} if kind == "script" else {k: score + k - 2 for k in range(5)},
        training_seeds=0 if kind == "script" else 5,
        has_few_seeds=index % 4 == 1,
        is_late=index == 1,
        same_policies=("ally/player-9",) if index == 6 else (),
        measures=_measures(rng),
        histograms={side: tuple(rng.integers(0, 900, 15).tolist()) for side in ("ally", "jam")},
        lost=1234 if index == 4 else 0,
        rounds=5000,
        records=50,
        planner=None,
        fingerprint={"version": "0.1.0", "policies": {"0": "ab" * 32}, "submission": text or "cd" * 32},
    )


def _units(by_rival: dict[str, dict[str, Interval]]) -> dict[str, tuple[tuple[float, ...], ...]]:
    """Return ten matches around each score."""
    return {
        role: tuple(tuple(score.value + k for k in (-1, 0, 1) * 3 + (0,)) for score in scores.values())
        for role, scores in by_rival.items()
    }


def _exploited(index: int, kind: str, text: str) -> Exploited:
    """Return the lowest known return; the first training seed of the third entry was answered by somebody."""
    rival = Attack("player-1", CROSSPLAY, Interval(-13.96), 3)
    seeds = [None] if kind == "script" else list(range(5))
    if index != 2:
        return Exploited.of(rival, (), seeds)
    attack = Attack("breaker-1", RESPONSE, _score(-14.65, 0.35, "matches"), 0, f"Breaker {text}".strip())
    attack = dataclasses.replace(attack, authors=(f"A. Name {text}".strip(),), seconds=1200.0)
    attack = dataclasses.replace(attack, steps=1_500_000, against=(0,))
    return Exploited.of(rival, (attack, dataclasses.replace(attack, rival="breaker-2")), seeds)


def _measures(rng: np.random.Generator) -> dict[str, float | None]:
    shares = (
        "overlap_ratio",
        "jamming_success_rate",
        "spectrum_overlap",
        "outage",
        "hop_rate",
        "spread_ratio",
    )
    return {name: float(rng.uniform(0, 0.5)) for name in shares} | {
        "return": float(rng.uniform(-5, 22)),
        "ally_return": float(rng.uniform(-500, 4000)),
        "capacity_mbit_s": 90.0,
        "snr_db": 61.25,
        "spread_ratio": 0.25,
        "near_ratio": None,
    }


def _crossplay(rng: np.random.Generator, tracks: list[BoardTrack], season: int | None) -> CrossPlay:
    allies, opponents = (tuple(sorted((e.slug for e in t.entries), key=_number)) for t in tracks)
    shape = len(allies), len(opponents)
    half = [[None if k % 3 == 0 else 1.25 for k in range(len(opponents))] for _ in allies]
    return CrossPlay(
        season=season,
        allies=allies,
        opponents=opponents,
        same_player={},
        missing={"ally": (), "opponent": ()},
        returns={side: rng.uniform(-10, 22, shape).tolist() for side in ("ally", "opponent")},
        half={"ally": half, "opponent": half},
        jamming_success_rate=rng.uniform(0, 0.4, shape).tolist(),
        rounds=100,
        nash=NashMixture({allies[0]: 0.25, allies[-1]: 0.75}, {opponents[0]: 1.0}, -1.5),
    )


def _number(slug: str) -> int:
    return int(slug.partition("-")[2])
