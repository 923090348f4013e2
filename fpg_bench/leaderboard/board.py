"""The board: all that the site shows, as one structure that is ready for JSON."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench import __version__
from fpg_bench.errors import UserError, nearest
from fpg_bench.evaluation.panel import Panel, load_panel
from fpg_bench.evaluation.planner_references import PlannerTable
from fpg_bench.evaluation.seeds import PROTOCOL, SEASON
from fpg_bench.evaluation.statistics import FEW_SEEDS, Interval
from fpg_bench.jobs.job import outcome_of
from fpg_bench.leaderboard.cases import Case, case_of, result_file, submission_folders
from fpg_bench.leaderboard.crossplay import ROUNDS, entrants_of, fully_played, pair_key, read_pairs
from fpg_bench.leaderboard.folder import brief
from fpg_bench.leaderboard.nash import nash
from fpg_bench.leaderboard.planner_ranking import planner_standing
from fpg_bench.leaderboard.planner_track import TRACK
from fpg_bench.leaderboard.ranking import (
    Standing,
    improvements,
    lead_shares,
    profiles,
    rank_ranges,
    standing,
)
from fpg_bench.leaderboard.result import Result, rounded
from fpg_bench.leaderboard.submission import PANELS, TRACKS, Submission, load_submission
from fpg_bench.leaderboard.transcripts import entered_table
from fpg_bench.players.player import SIDES
from fpg_bench.rows import Row, RowFile

# The tables that rounds decide: key, track, path, title.
TABLES = (
    ("ally", "ally", None, "Allies"),
    ("opponent-pursuit", "opponent", "pursuit", "Opponents in pursuit"),
    ("opponent-learned", "opponent", "learned", "Opponents that fly themselves"),
    ("planner", TRACK, None, "Planners of the opponent's path"),
)
EXPLOIT = "exploit.jsonl"
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
    shown = _shown(folder, say)
    return {
        "version": __version__,
        "protocol": PROTOCOL,
        "season": SEASON,
        "built": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "tracks": [_table(folder, shown, *table) for table in TABLES],
        "crossplay": _crossplay(folder, [case for _, case, _ in shown if case is not None]),
    }


def _shown(board: Path, say: Callable[[str], None]) -> list[tuple[Submission, Case | None, str | None]]:
    """Every readable submission that has a result: its case, or why the result does not count."""
    found: list[tuple[Submission, Case | None, str | None]] = []
    for path in sorted((board / "submissions").glob("[!.]*/")):
        if path.name not in TRACKS:
            say(f"submissions/{path.name}: left out: is no track{nearest(path.name, TRACKS)}")
    for folder in submission_folders(board):
        name = f"{folder.parent.name}/{folder.name}"
        if not result_file(board, folder.parent.name, folder.name).exists():
            say(f"{name}: left out: has no result; make it: fpg-bench submit run {brief(folder)}")
            continue
        read = outcome_of(partial(load_submission, folder, contract=False))
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


def _table(board: Path, shown: Iterable[Any], key: str, track: str, path: str | None, title: str) -> Row:
    """One table: its rows from best to worst, those that are not verified last."""
    name = PANELS[track, path]
    panel = entered_table(name, asks=False) if track == TRACK else load_panel(name)
    mine = [item for item in shown if (item[0].track, item[0].path) == (track, path)]
    scored = [
        (submission, case.known, _standing(case.known, case.panel))
        for submission, case, _ in mine
        if case is not None and case.known is not None
    ]
    scored.sort(key=lambda item: (-item[2].value, item[0].slug))
    standings = [item[2] for item in scored]
    ranks, leads = rank_ranges(standings), lead_shares(standings)
    exploited = _best_responses(board, track)
    rows = [
        _texts(submission)
        | _figures(result, entry, panel, exploited.get(submission.slug))
        | {"rank": list(rank), "lead": _short(lead)}
        for (submission, result, entry), rank, lead in zip(scored, ranks, leads, strict=True)
    ]
    rows += [_texts(submission) | _blank(why) for submission, _, why in mine if why is not None]
    return {
        "key": key,
        "title": title,
        "side": track,
        "panel": panel.name,
        "panel_hash": panel.hash,
        "rounds": panel.rounds,
        "reference": panel.reference,
        "entries": [entry.name for entry in panel.entries],
        "rows": rows,
        "improvement": _improvement(standings),
        "profiles": _profiles(standings),
    }


def _standing(result: Result, panel: Panel) -> Standing:
    """The standing of a verified result, on just the matches that it played."""
    return planner_standing(result, panel) if isinstance(panel, PlannerTable) else standing(result, panel)


def _texts(submission: Submission) -> Row:
    """What a submission says of itself."""
    kind = "script" if submission.script is not None else "zoo" if submission.zoo is not None else "submitted"
    training = submission.training
    return {
        "slug": submission.slug,
        "name": submission.name,
        "authors": list(submission.authors),
        "algorithm": submission.algorithm,
        "reference": submission.reference,
        "licence": submission.licence,
        "kind": kind,
        "training": None if training is None else {**asdict(training), "seeds": list(training.seeds)},
        "saw": submission.saw,
        "unable": submission.unable,
        "description": submission.description,
        "replays": [],
    }


def _figures(result: Result, entry: Standing, panel: Panel, exploited: Row | None) -> Row:
    """What a verified result says."""
    entries = {e.name: _interval(entry.entry(k)) for k, e in enumerate(panel.entries)}
    worst = min(entries, key=lambda name: float(entries[name]["value"]))
    summary = result.head["summary"]
    seeds = sorted({str(line["training_seed"]) for line in result.lines if entry.trained})  # as scores are
    return {
        "status": result.head["status"],
        "reason": None,
        "training_seeds": summary["training_seeds"],
        "few_seeds": 0 < summary["training_seeds"] < FEW_SEEDS,
        "score": _interval(entry.interval) | {"over": entry.interval.over},
        "mean": _short(entry.scores.mean()),
        "worst": {"entry": worst, "value": entries[worst]["value"]},
        "entries": entries,
        "seeds": {k: _short(value) for k, value in zip(seeds, entry.per_seed, strict=entry.trained)},
        "measures": {"return": summary["measures"][f"{panel.side}_return"], **summary["measures"]},
        "best_response": exploited,
        "lost": summary["lost"],
        "rounds": summary["rounds"],
        "planner": _planner(result) if isinstance(panel, PlannerTable) else None,
        "histograms": {"ally": _points(result, "ally_points"), "jam": _points(result, "jam_points")},
        "fingerprint": result.fingerprint,
    }


def _planner(result: Result) -> Row:
    """What is told of planners alone: what they know, how they learn, and how a language model answered."""
    names = ("score_all", "curve", "valid", "statuses", "tokens")
    return {**result.fingerprint["planner"], **{name: result.head["summary"][name] for name in names}}


def _blank(why: str) -> Row:
    """What is shown of a result that is not verified, or does not count."""
    empty: Row = dict.fromkeys(
        ("rank", "lead", "score", "mean", "worst", "best_response", "planner", "histograms", "fingerprint")
    )
    return empty | {
        "status": "not verified",
        "reason": why,
        "training_seeds": 0,
        "few_seeds": False,
        "entries": {},
        "seeds": {},
        "measures": {},
        "lost": 0,
        "rounds": 0,
    }


def _points(result: Result, key: str) -> list[float | None]:
    """The share of steps at each frequency point."""
    total = np.sum([line[key] for line in result.lines], axis=0)
    return [_short(share) for share in total / max(total.sum(), 1)]


def _best_responses(board: Path, track: str) -> dict[str, Row]:
    """By name, the lowest and highest score against best responses, where there are any; the newest of each.

    Raises:
        UserError: a line without its figures.
    """
    file, found = RowFile(board / "results" / EXPLOIT), {}
    for number, row in enumerate(file.read(), 1):
        scores: Any = row.get("scores")
        sound = isinstance(scores, list) and scores and all(isinstance(x, int | float) for x in scores)
        if not {"track", "slug"} <= row.keys() or not sound:
            raise UserError(f"{file.path}: line {number} lacks track, slug or scores")
        if row["track"] == track:
            low, high = _short(min(scores)), _short(max(scores))
            found[str(row["slug"])] = {"value": low, "low": low, "high": high}
    return found


def _improvement(standings: Sequence[Standing]) -> Row:
    table = improvements(standings)

    def each(name: str) -> list[list[float | None]]:
        return [[None if cell is None else _short(getattr(cell, name)) for cell in row] for row in table]

    names = [entry.slug for entry in standings]
    return {"names": names, "value": each("value"), "low": each("low"), "high": each("high")}


def _profiles(standings: Sequence[Standing]) -> Row:
    thresholds, shares = profiles(standings)
    return {
        "thresholds": [_short(value) for value in thresholds],
        "share": {
            entry.slug: [_short(value) for value in row] for entry, row in zip(standings, shares, strict=True)
        },
    }


def _crossplay(board: Path, cases: list[Case]) -> Row | None:
    """The matrix of those who have all played each other, and its Nash mixtures; None where nobody has."""
    every = entrants_of(cases)
    known = read_pairs(board, *every, ROUNDS)
    allies, opponents = fully_played(*every, known)
    if not allies or not opponents:
        return None
    rates = [[known[pair_key(a, o, ROUNDS)]["jamming_success_rate"] for o in opponents] for a in allies]
    found = nash(np.array(rates))
    return {
        "allies": [a.slug for a in allies],
        "opponents": [o.slug for o in opponents],
        "missing": {
            side: [entrant.slug for entrant in entrants if entrant not in shown]
            for side, entrants, shown in zip(SIDES, every, (allies, opponents), strict=True)
        },
        "jamming_success_rate": rates,
        "rounds": ROUNDS,
        "nash": {
            "ally": {a.slug: _short(p) for a, p in zip(allies, found.rows, strict=True)},
            "opponent": {o.slug: _short(p) for o, p in zip(opponents, found.columns, strict=True)},
            "value": _short(found.value),
        },
    }


def _interval(interval: Interval) -> Row:
    return {name: _short(getattr(interval, name)) for name in ("value", "low", "high")}


def _short(value: Any) -> float | None:
    return rounded(float(value))
