"""View models of an entry's page and badge."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from fpg_bench.evaluation.statistics import Interval
from fpg_bench.products.leaderboard.board import Board, BoardEntry, BoardSuite, BoardTrack, Figures
from fpg_bench.products.leaderboard.site.views import (
    NONE,
    ROLES,
    Axis,
    ExploitedView,
    exploited_view,
    format_number,
    format_rank,
    lost_text,
    ordered_suites,
    safe_link,
    same_policies_text,
    scale_text,
)
from fpg_bench.products.leaderboard.tracks import PUBLIC, UNSEEN

_T = TypeVar("_T")
_SPECIAL = re.compile(r"([&%$#_{}])")


@dataclass(frozen=True)
class FiguresView:
    """Figures of a verified entry, ready for its page.

    Attributes:
        role: label of the suite that its score is over.
        axis: of all scores on the page.
        scores, by_rival: suites with the score over each, and with the score against each rival.
        by_seed: the score of each training seed, without an interval.
        first_rounds: of the first round against each rival, its return and the command that plays it again,
            by role and rival.
        facts: names and values of further figures of a planner.
        fingerprint: names and values.
    """

    role: str
    axis: Axis
    exploited: ExploitedView | None
    lost: str
    same_policies: str
    scores: list[tuple[BoardSuite, Interval]]
    by_rival: list[tuple[BoardSuite, Mapping[str, Interval]]]
    by_seed: Mapping[int, Interval]
    first_rounds: Mapping[str, Mapping[str, tuple[float, str]]]
    facts: list[tuple[str, str]]
    fingerprint: list[tuple[str, str]]


@dataclass(frozen=True)
class EntryView:
    """An entry's page.

    Attributes:
        ranked_by: label of the suite that ranks the track.
        shown: its figures; None where it is not verified.
        reference: a link, if the entry has a safe one.
        commands: descriptions and command lines.
        badge: file of its badge.
        unseen: the suite of rivals that it cannot have trained on, if there is one.
    """

    track: BoardTrack
    entry: BoardEntry
    ranked_by: str
    scale: str
    shown: FiguresView | None
    reference: str | None
    commands: list[tuple[str, str]]
    bibtex: str
    badge: str
    unseen: BoardSuite | None


def entry_view(board: Board, track: BoardTrack, entry: BoardEntry) -> EntryView:
    """Return the view of an entry's page."""
    figures = entry.figures
    is_late = figures is not None and figures.is_late
    return EntryView(
        track=track,
        entry=entry,
        ranked_by=ROLES[track.ranked_by].label.lower(),
        scale=scale_text(track),
        shown=None if figures is None else _figures_view(board, track, entry, figures),
        reference=safe_link(entry.reference),
        commands=commands(track, entry),
        bibtex=bibtex(board, track, entry),
        badge=badge_file(track, entry),
        unseen=next((suite for suite in track.suites if suite.role == UNSEEN and not is_late), None),
    )


def _figures_view(board: Board, track: BoardTrack, entry: BoardEntry, figures: Figures) -> FiguresView:
    role = track.ranked_by if track.ranked_by in figures.scores else PUBLIC
    planner = figures.planner
    charted = [*figures.scores.values()]
    charted += [score for scores in figures.by_rival.values() for score in scores.values()]
    by_seed = {seed: Interval(value) for seed, value in figures.by_seed.items()}
    charted += by_seed.values()
    charted += [] if planner is None else planner.curve
    return FiguresView(
        role=ROLES[role].label.lower(),
        axis=Axis.of_scores(charted),
        exploited=exploited_view(board, track, figures),
        lost=lost_text(figures),
        same_policies=same_policies_text(figures),
        scores=_by_suite(ordered_suites(track, without=()), figures.scores),
        by_rival=_by_suite(ordered_suites(track), figures.by_rival),
        by_seed=by_seed,
        first_rounds={
            suite.role: {
                rival: (
                    figures.first_rounds[suite.role][rival],
                    f"fpg-bench play --{track.side} {entry.player} {options}",
                )
                for rival, options in suite.play.items()
                if entry.player is not None
            }
            for suite in track.suites
            if suite.role in figures.first_rounds
        },
        facts=_planner_facts(figures),
        fingerprint=_flat(figures.fingerprint),
    )


def _by_suite(suites: Iterable[BoardSuite], figures: Mapping[str, _T]) -> list[tuple[BoardSuite, _T]]:
    return [(suite, figures[suite.role]) for suite in suites if suite.role in figures]


def _planner_facts(figures: Figures) -> list[tuple[str, str]]:
    planner = figures.planner
    if planner is None:
        return []
    facts = [
        ("Knowledge", planner.tier),
        ("Score over all rounds", format_number(planner.score_all.value)),
        ("Valid plans", format_number(planner.valid, "share")),
        ("Valid but useless", format_number(planner.valid_but_useless, "share")),
        ("Recorded runs, including this one", format_number(planner.runs, "whole")),
        ("Recorded after season", format_number(planner.season, "whole")),
        ("Tokens per plan", format_number(planner.tokens, "whole")),
    ]
    return [(name, text) for name, text in facts if text != NONE]


def _flat(content: Mapping[str, object]) -> list[tuple[str, str]]:
    """Return the names and values of a fingerprint; the names of nested mappings are joined."""
    rows = []
    for key, value in content.items():
        name = str(key).replace("_", " ")
        if isinstance(value, Mapping):
            rows += [(f"{name} {inner}", text) for inner, text in _flat(value)]
        else:
            rows.append((name, NONE if value is None else str(value)))
    return rows


def commands(track: BoardTrack, entry: BoardEntry) -> list[tuple[str, str]]:
    """Return the commands that play an entry again and, where the package trained it, train it again."""
    rows = [("Play it again and compare", f"fpg-bench leaderboard verify {track.side}/{entry.slug}")]
    if entry.kind == "zoo" and entry.plays is not None:
        group = entry.plays.partition("/")[0]
        is_champion = not {"champion", "rule"}.isdisjoint(group.split("-"))  # of champions.yml
        script = f"train_champions.py --only {group}" if is_champion else f"train_zoo.py --only {entry.plays}"
        rows.append(("Train it again", f"python scripts/{script}"))
    return rows


def bibtex(board: Board, track: BoardTrack, entry: BoardEntry) -> str:
    """Return the entry as BibTeX."""
    season = "" if board.season is None else f", season {board.season}"
    fields = {
        "author": " and ".join(f"{{{_escaped(name)}}}" for name in entry.authors),
        "title": f"{{{_escaped(entry.name)}}}: entry of the fpg-bench leaderboard",
        "year": board.built[:4],
        "note": _escaped(f"Entry {track.key}/{entry.slug}, protocol {board.protocol}{season}"),
        "url": safe_link(entry.reference) or "",
    }
    lines = [f"  {name} = {{{value}}}," for name, value in fields.items() if value]
    return "\n".join([f"@misc{{fpg-bench-{track.key}-{entry.slug},", *lines, "}"])


def _escaped(text: str) -> str:
    """Return text as BibTeX takes it, on one line."""
    return _SPECIAL.sub(r"\\\1", " ".join(text.replace("\\", " ").split()))


def badge_file(track: BoardTrack, entry: BoardEntry) -> str:
    """Return the file of an entry's badge in the site."""
    return f"badges/{track.key}/{entry.slug}.svg"


def badge_text(track: BoardTrack, entry: BoardEntry) -> str:
    """Return an entry's rank and score, for its badge."""
    figures = entry.figures
    score = f"score {NONE if figures is None else format_number(figures.score.value)}"
    if figures is None or figures.rank is None:
        return score
    return f"rank {format_rank(figures.rank)} of {track.n_ranked}, {score}"
