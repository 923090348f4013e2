"""View models of an entry's page and badge."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from fpg_bench.evaluation.statistics import Interval
from fpg_bench.products.leaderboard.board import Board, BoardEntry, BoardTrack, Figures
from fpg_bench.products.leaderboard.site.views import (
    NONE,
    ROLES,
    Axis,
    exploited_view,
    format_number,
    format_rank,
    ordered_suites,
    safe_link,
    scale_text,
)
from fpg_bench.products.leaderboard.tracks import PUBLIC, UNSEEN

_SPECIAL = re.compile(r"([&%$#_{}])")


def entry_view(board: Board, track: BoardTrack, entry: BoardEntry) -> dict[str, Any]:
    """Return what an entry's page shows beside the entry and its track.

    ``unseen`` is the suite of rivals that it cannot have trained on, if there is one; ``role`` the label of
    the suite that its score is over, and ``axis`` that of all scores on the page.
    """
    figures = entry.figures
    is_late = figures is not None and figures.is_late
    return {
        "track": track,
        "entry": entry,
        "figures": figures,
        "suites": ordered_suites(track),
        "ranked_by": ROLES[track.ranked_by].label.lower(),
        "scale": scale_text(track),
        "reference": safe_link(entry.about.reference),
        "commands": commands(track, entry),
        "bibtex": bibtex(board, track, entry),
        "badge_file": badge_file(track, entry),
        "unseen": next((suite for suite in track.suites if suite.role == UNSEEN and not is_late), None),
        "exploited": exploited_view(board, track, figures),
        **({} if figures is None else _figures_view(track, figures)),
    }


def _figures_view(track: BoardTrack, figures: Figures) -> dict[str, Any]:
    by_seed = {seed: Interval(value) for seed, value in figures.by_seed.items()}
    charted = [*figures.scores.values(), *by_seed.values()]
    charted += [score for scores in figures.by_rival.values() for score in scores.values()]
    charted += [] if figures.planner is None else figures.planner.curve
    return {
        "role": ROLES[track.ranked_by if track.ranked_by in figures.scores else PUBLIC].label.lower(),
        "axis": Axis.of_scores(charted),
        "by_seed": by_seed,
        "facts": _planner_facts(figures),
        "fingerprint": _flat(figures.fingerprint),
    }


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
    if entry.command is not None:
        rows.append(("Train its first seed again", entry.command))
    return rows


def bibtex(board: Board, track: BoardTrack, entry: BoardEntry) -> str:
    """Return the entry as BibTeX."""
    season = "" if board.season is None else f", season {board.season}"
    fields = {
        "author": " and ".join(f"{{{_escaped(name)}}}" for name in entry.about.authors),
        "title": f"{{{_escaped(entry.name)}}}: entry of the fpg-bench leaderboard",
        "year": board.built[:4],
        "note": _escaped(f"Entry {track.key}/{entry.slug}, protocol {board.protocol}{season}"),
        "url": safe_link(entry.about.reference) or "",
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
