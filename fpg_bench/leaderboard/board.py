"""The board: all that the site shows, as one structure that is ready for JSON."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.errors import nearest
from fpg_bench.evaluation.seeds import PROTOCOL, current_season
from fpg_bench.evaluation.statistics import rank_ranges, student_half
from fpg_bench.evaluation.summary import Summary
from fpg_bench.jobs.job import outcome_of
from fpg_bench.leaderboard.board_rows import (
    blank,
    figures,
    had_access,
    place,
    scored,
    seeds_gaps,
    short,
    texts,
    told_field,
    worst,
)
from fpg_bench.leaderboard.cases import Case, case_of, entered, result_file, submission_folders
from fpg_bench.leaderboard.crossplay import WITHIN
from fpg_bench.leaderboard.fields import TRACKS as FOLDERS
from fpg_bench.leaderboard.folder import brief
from fpg_bench.leaderboard.pairs import (
    BoardEntry,
    Pair,
    Pairs,
    fully_played,
    pair_key,
    players_of,
    read_pairs,
)
from fpg_bench.leaderboard.ranking import improvements, nash, profiles
from fpg_bench.leaderboard.submission import Submission
from fpg_bench.leaderboard.tracks import TRACKS, Track, ranked_by
from fpg_bench.players.player import SIDES
from fpg_bench.rows import Row
from fpg_bench.version import __version__

_LONGEST_REASON = 300


def make_board(folder: str | Path = "leaderboard", say: Callable[[str], None] = lambda line: None) -> Row:
    """Everything that the site shows: tables with ranks, and cross-play.

    Figures come from results alone, texts from what was submitted. A submission whose result is missing is
    left out; one whose result does not fit it is shown as not verified.

    Args:
        folder: the leaderboard's.
        say: told a line per submission that is left out or not verified, and why.

    Raises:
        UserError: no such folder, or a file of it that can't be read as what it is.
    """
    folder = Path(folder)
    shown, season = _shown(folder, say), current_season()
    cases = [case for _, case, _ in shown if case is not None]
    pairs = read_pairs(folder, players_of(cases), say=say)
    return {
        "version": __version__,
        "protocol": PROTOCOL,
        "season": None if season is None else season.number,
        "built": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "tracks": [_table(shown, track, list(pairs.known.values())) for track in TRACKS.values()],
        "crossplay": _crossplay(pairs),
    }


def _shown(board: Path, say: Callable[[str], None]) -> list[tuple[Submission, Case | None, str | None]]:
    """Every readable submission that has a result: its case, or why the result does not count."""
    found: list[tuple[Submission, Case | None, str | None]] = []
    for path in sorted((board / "submissions").glob("[!.]*/")):
        if path.name not in FOLDERS:
            say(f"submissions/{path.name}: left out: is no track{nearest(path.name, FOLDERS)}")
    for folder in submission_folders(board):
        name = f"{folder.parent.name}/{folder.name}"
        if not result_file(board, folder.parent.name, folder.name).exists():
            say(f"{name}: left out: has no result; make it: fpg-bench submit run {brief(folder)}")
            continue
        read = outcome_of(partial(entered, board, folder, contract=False))
        if read.error is not None:
            say(f"{name}: left out: {read.error}")  # nothing of it can be trusted, not even its name
            continue
        submission: Submission = read.result
        case, why = _case(board, submission)
        found.append((submission, case, why))
        if why is not None:
            say(f"{name}: not verified: {why}")
    return found


def _case(board: Path, submission: Submission) -> tuple[Case | None, str | None]:
    """The case of a submission whose result counts; None, and why it does not, of any other."""
    read = outcome_of(partial(case_of, board, submission))
    if read.error is not None:
        return None, read.error
    case: Case = read.result
    if case.known is None or case.known.verified:
        return case, None
    return None, "".join(c if c.isprintable() else " " for c in case.known.head["reason"][:_LONGEST_REASON])


def _table(shown: Iterable[Any], track: Track, pairs: list[Pair]) -> Row:
    """One table: its rows from best to worst, those that are not ranked or not verified last."""
    fields = track.fields()
    mine = [item for item in shown if (item[0].track, item[0].path) == (track.side, track.path)]
    verified = [
        scored(case, case.known, ranked_by(fields))
        for _, case, _ in mine
        if case is not None and case.known is not None and case.known.verified
    ]
    verified.sort(key=place)
    ranked = [entry for entry in verified if entry.ranking is not None]
    ranking = [entry.ranking for entry in ranked if entry.ranking is not None]
    ranks = rank_ranges([summary.samples for summary in ranking])
    by_slug = {entry.result.slug: rank for entry, rank in zip(ranked, ranks, strict=True)}
    gaps = seeds_gaps(verified)
    rows = [
        texts(entry.case.submission)
        | figures(entry, worst(entry.result.slug, track.side, entry.summaries, pairs))
        | {"rank": list(by_slug[slug]) if (slug := entry.result.slug) in by_slug else None}
        | {"seeds_gap": gaps.get(slug), "had_access": had_access(entry.case.submission)}
        for entry in verified
    ]
    rows += [texts(submission) | blank(why) for submission, _, why in mine if why is not None]
    return {
        "key": track.key,
        "title": track.title,
        "side": track.side,
        "ranked_by": ranked_by(fields),
        "fields": [told_field(role, field) for role, field in fields.items()],
        "scale": {"zero": track.field.scale.zero, "top": track.field.scale.top},
        "rows": rows,
        "improvement": _improvement(ranking),
        "profiles": _profiles(ranking),
    }


def _improvement(standings: Sequence[Summary]) -> Row:
    table = improvements(standings)

    def each(name: str) -> list[list[float | None]]:
        return [[None if cell is None else short(getattr(cell, name)) for cell in row] for row in table]

    names = [entry.entry for entry in standings]
    return {"names": names, "value": each("value"), "low": each("low"), "high": each("high")}


def _profiles(standings: Sequence[Summary]) -> Row:
    thresholds, shares = profiles(standings)
    return {
        "thresholds": [short(value) for value in thresholds],
        "share": {
            entry.entry: [short(value) for value in row] for entry, row in zip(standings, shares, strict=True)
        },
    }


def _crossplay(pairs: Pairs) -> Row | None:
    """The matrices of those who have all played each other, and the Nash mixtures of the ally's return.

    None where nobody has.
    """
    allies, opponents = fully_played(pairs)
    if not allies or not opponents:
        return None
    played = [[pairs.known[pair_key(a, o, pairs.rounds)] for o in opponents] for a in allies]
    returns = {side: [[short(pair.reward(side)) for pair in line] for line in played] for side in SIDES}
    half = {side: [[_half(pair, side) for pair in line] for line in played] for side in SIDES}
    found = nash(-np.array(returns["ally"]))  # the ally, who chooses rows, minimises
    return {
        "allies": [a.slug for a in allies],
        "opponents": [o.slug for o in opponents],
        "missing": {
            side: [entry.slug for entry in every if entry not in shown]
            for side, every, shown in (
                ("ally", pairs.allies, allies),
                ("opponent", pairs.opponents, opponents),
            )
        },
        "twins": _twins(opponents, returns["ally"]),
        "returns": returns,
        "half": half,
        "jamming_success_rate": [[pair.jamming_success_rate for pair in line] for line in played],
        "rounds": pairs.rounds,
        "nash": {
            "ally": {a.slug: short(p) for a, p in zip(allies, found.rows, strict=True)},
            "opponent": {o.slug: short(p) for o, p in zip(opponents, found.columns, strict=True)},
            "value": short(-found.value),
        },
    }


def _half(pair: Pair, side: str) -> float | None:
    """Half of the 95 % interval of a side's return over its training seeds; None where it has but one."""
    rewards = np.array(pair.rewards(side))
    return short(student_half(rewards)) if len(rewards) > 1 else None


def _twins(entries: Sequence[BoardEntry], returns: Sequence[Sequence[float | None]]) -> list[list[str]]:
    """Entries that are one player in two tables and fare alike, each group once.

    Args:
        entries: who stands in the columns.
        returns: ``(allies, entries)``, the allies' return a step, another where a player flies otherwise.
    """
    columns = np.array(returns, float).T
    near, groups = WITHIN * np.ptp(columns), list[list[int]]()
    for column, entry in enumerate(entries):
        for group in groups:
            alike = np.abs(columns[column] - columns[group[0]]).max() <= near
            if alike and entry.identity == entries[group[0]].identity:
                group.append(column)
                break
        else:
            groups.append([column])
    return [[entries[column].slug for column in group] for group in groups if len(group) > 1]
