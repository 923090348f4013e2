"""A result: what a submission earned, entry by entry, in one file that shows when it was edited by hand."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fpg_bench import __version__
from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import Panel
from fpg_bench.evaluation.planner_references import PlannerTable
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.evaluation.zoo_scores import summarise_lines
from fpg_bench.files import write_whole
from fpg_bench.game.measures import measures
from fpg_bench.game.state import TALLY
from fpg_bench.leaderboard.planner_track import (
    STATUSES,
    TOKENS,
    is_planner_line,
    planner_facts,
    planner_summary,
)
from fpg_bench.plain_json import read_object
from fpg_bench.players.player import SIDES
from fpg_bench.rows import Row

if TYPE_CHECKING:
    from fpg_bench.leaderboard.submission import Submission

VERIFIED, NOT_VERIFIED = "verified", "not verified"
LARGEST = 2_000_000  # bytes; those of five training seeds on ten entries are 130,000
_DIGITS = 6
_ENDLESS = 1e15  # no measure comes near it, and no number that is not finite lies below
_HEAD = {"kind", "slug", "track", "status", "reason", "fingerprint", "summary", "lines_sha256"}
_LINE = {"training_seed", "entry", "n", "returns", "mean", "sd", "rows_sha256", "lost"}
_LINE |= {"ally_points", "jam_points"}
_MEASURES = measures(dict.fromkeys(TALLY.names or (), 0), np.zeros((2, 2))).keys()


@dataclass(frozen=True)
class Result:
    """A result's file: its first row, and one line per training seed and entry, none if not verified."""

    head: Row
    lines: list[Row]

    @property
    def slug(self) -> str:
        """The folder's name of the submission."""
        return str(self.head["slug"])

    @property
    def verified(self) -> bool:
        """Whether it was played to its end; only then it is ranked."""
        return bool(self.head["status"] == VERIFIED)

    @property
    def fingerprint(self) -> Row:
        """What was run."""
        found: Row = self.head["fingerprint"]
        return found


def fingerprint(submission: Submission, panel: Panel) -> Row:
    """All that decides a result: the version, the game, the protocol, and what was submitted."""
    planner = planner_facts(submission, panel) if isinstance(panel, PlannerTable) else None
    return {
        "version": __version__,
        "scenario": panel.scenario.hash,
        "panel": panel.name,
        "panel_hash": panel.hash,
        "protocol": PROTOCOL,
        "season": panel.season,
        "rounds": panel.rounds,
        "policies": {str(policy.seed): policy.sha256 for policy in submission.policies},
        "submission": submission.fingerprint,
        **({} if planner is None else {"planner": planner}),
    }


def differing(one: Row, other: Row) -> list[str]:
    """In what two fingerprints differ, the package's version aside: what it changed shows in the rounds."""
    keys = (one.keys() | other.keys()) - {"version"}
    return sorted(key for key in keys if one.get(key) != other.get(key))


def verified_result(slug: str, track: str, printed: Row, lines: list[Row], panel: Panel) -> Result:
    """The result of a submission all of whose rounds were played.

    Args:
        slug, track: whose.
        printed: the fingerprint.
        lines: of all its training seeds on all entries.
        panel: what was played.
    """
    head = _head(slug, track, VERIFIED, None, printed, summary_of(lines, panel), lines)
    return Result(head, lines)


def failed_result(slug: str, track: str, printed: Row, reason: str) -> Result:
    """The result of a submission that could not be played to its end, and why."""
    return Result(_head(slug, track, NOT_VERIFIED, reason, printed, None, []), [])


def _head(
    slug: str,
    track: str,
    status: str,
    reason: str | None,
    printed: Row,
    summary: Row | None,
    lines: list[Row],
) -> Row:
    return {
        "kind": "result",
        "slug": slug,
        "track": track,
        "status": status,
        "reason": reason,
        "fingerprint": printed,
        "summary": summary,
        "lines_sha256": _sha256(_text(lines)),
    }


def summary_of(lines: list[Row], panel: Panel) -> Row:
    """What the lines come to: the score with its interval, and the measures.

    Args:
        lines: of one submission, on all entries.
        panel: what was played, with its reference scores.
    """
    if isinstance(panel, PlannerTable):
        found: Row = all_rounded(planner_summary(lines, panel))
        return found
    (summary,) = summarise_lines([line | {"algorithm": ""} for line in lines], panel)
    score = summary.score
    return {
        "score": {
            "value": rounded(score.value),
            "low": rounded(score.low),
            "high": rounded(score.high),
            "over": score.over,
        },
        "mean": rounded(summary.mean),
        "training_seeds": summary.training_seeds,
        "rounds": summary.rounds,
        "lost": sum(line["lost"] for line in lines),
        "measures": {name: rounded(value) for name, value in summary.measures.items()},
    }


def rounded(value: float | None) -> float | None:
    """To six digits that count; None where there is no finite number."""
    return None if value is None or not math.isfinite(value) else float(f"{value:.{_DIGITS}g}")


def all_rounded(value: Any) -> Any:
    """The same mapping or list, with all of its numbers rounded so."""
    if isinstance(value, dict):
        return {key: all_rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [all_rounded(item) for item in value]
    return rounded(value) if isinstance(value, float) else value


def write_result(path: Path, result: Result) -> None:
    """Write a result's file, whole."""
    write_whole(path, _text([result.head]) + _text(result.lines))


def read_result(path: Path, panel: Panel) -> Result:
    """The result in a file, which must be just as it was written.

    Args:
        path: the file.
        panel: what it was played on; a result of another panel is read, but not summed up anew.

    Raises:
        UserError: it can't be read, is no result, or was edited: its lines are not those that it was
            written with, or its summary does not follow from them.
    """
    head, *lines = _rows(path)
    if head.keys() != _HEAD or head["kind"] != "result" or head["status"] not in (VERIFIED, NOT_VERIFIED):
        raise UserError(f"result {path}: its first line is not that of a result")
    if not isinstance(head["fingerprint"], dict):
        raise UserError(f"result {path}: fingerprint: expected a mapping")
    if (head["track"], head["slug"]) != (path.parent.name, path.stem):
        raise UserError(f"result {path}: is the result of {head['track']}/{head['slug']}")
    found = Result(head, lines)
    if head["lines_sha256"] != _sha256(_text(lines)):
        raise UserError(f"result {path}: edited by hand: its lines are not those it was written with")
    if head["fingerprint"].get("panel_hash") == panel.hash:
        check_lines(found, panel, path)
    return found


def check_lines(result: Result, panel: Panel, path: Path) -> None:
    """Raise UserError where lines are not those of a panel's players, or the summary is not what they say."""
    if not result.verified:
        if result.lines or result.head["summary"] is not None or not isinstance(result.head["reason"], str):
            raise UserError(
                f"result {path}: edited by hand: not verified, but with lines or without a reason"
            )
        return
    for number, line in enumerate(result.lines, 2):
        if not _is_line(line, panel):
            raise UserError(f"result {path}: line {number} is not that of an entry of {panel.name}")
    policies = result.fingerprint.get("policies")
    seeds = sorted(policies) if isinstance(policies, dict) and policies else ["None"]
    expected = [(seed, entry.name) for seed in seeds for entry in panel.entries]
    if sorted((str(line["training_seed"]), line["entry"]) for line in result.lines) != sorted(expected):
        raise UserError(f"result {path}: its lines are not one per training seed and entry of {panel.name}")
    if not _alike(summary_of(result.lines, panel), result.head["summary"]):
        raise UserError(f"result {path}: edited by hand: its summary does not follow from its lines")


def _is_line(line: Row, panel: Panel) -> bool:
    """Whether a line has the form that scores are made of."""
    expected = _LINE | {STATUSES, TOKENS} if isinstance(panel, PlannerTable) else _LINE
    if line.keys() != expected or line["entry"] not in [entry.name for entry in panel.entries]:
        return False
    if line["training_seed"] is not None and type(line["training_seed"]) is not int:
        return False
    points, whole = panel.scenario.frequency_points, isinstance(line["lost"], int)
    return (
        line["n"] == panel.rounds
        and _are_numbers(line["returns"], panel.rounds)
        and _are_numbers(line["ally_points"], points)
        and _are_numbers(line["jam_points"], points)
        and _are_measures(line["mean"], {f"{side}_return" for side in SIDES})
        and (whole and 0 <= line["lost"] <= panel.rounds)
        and (not isinstance(panel, PlannerTable) or is_planner_line(line, panel))
    )


def _are_numbers(values: Any, count: int) -> bool:
    return isinstance(values, list) and len(values) == count and all(map(_is_number, values))


def _are_measures(found: Any, always: set[str]) -> bool:
    """Whether these are all measures, with a number or None each, and those that are always there."""
    return (
        isinstance(found, dict)
        and found.keys() == _MEASURES
        and all(value is None or _is_number(value) for value in found.values())
        and all(found[name] is not None for name in always)
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < _ENDLESS


def _alike(one: Any, other: Any) -> bool:
    """Whether two summaries are the same, but for the last digit that another machine may round otherwise."""
    if isinstance(one, dict):
        return (
            isinstance(other, dict)
            and one.keys() == other.keys()
            and all(_alike(one[key], other[key]) for key in one)
        )
    if isinstance(one, list):
        return isinstance(other, list) and len(one) == len(other) and all(map(_alike, one, other))
    if isinstance(one, float) and _is_number(other):
        return math.isclose(one, other, rel_tol=1e-5, abs_tol=1e-9)
    return bool(one == other)


def _rows(path: Path) -> list[Row]:
    """The rows of a file from anywhere: no more than so large, and strict JSON."""
    try:
        if not path.is_file() or path.is_symlink():
            raise UserError(f"result {path}: not a file; run fpg-bench submit verify")
        if path.stat().st_size > LARGEST:
            raise UserError(f"result {path}: larger than {LARGEST} bytes")
        lines = path.read_bytes().removesuffix(b"\n").split(b"\n")
        rows = [read_object(line) for line in lines]
    except OSError as error:
        raise UserError(f"result {path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        if isinstance(error, UserError):
            raise
        raise UserError(f"result {path}: not lines of JSON: {error}") from error
    return rows


def _text(rows: list[Row]) -> str:
    return "".join(json.dumps(row, separators=(",", ":"), allow_nan=False) + "\n" for row in rows)


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
