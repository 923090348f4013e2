"""A result: what a submission earned, meeting by meeting, in a file that shows when it was edited by hand."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole
from fpg_bench.common.rows import Row
from fpg_bench.common.strict_json import read_object
from fpg_bench.evaluation.record import Record, read_record
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.evaluation.suite import PLANNER, Suite
from fpg_bench.evaluation.summary import Summary, summary_of
from fpg_bench.leaderboard.tracks import PUBLIC
from fpg_bench.leaderboard.transcripts import told as told_of
from fpg_bench.planning import as_planner
from fpg_bench.version import __version__

if TYPE_CHECKING:
    from fpg_bench.leaderboard.submission import Submission

VERIFIED, NOT_VERIFIED = "verified", "not verified"
LARGEST = 4_000_000  # bytes; those of five training seeds in a season are 400,000
_DIGITS = 6
_HEAD = {"kind", "slug", "track", "status", "reason", "fingerprint", "summary", "lines_sha256"}
_TOLD = ("model", "server", "control", "prompt_hash")  # of a language model
Suites = Mapping[str, Suite]  # what a submission plays, by what it says of it


@dataclass(frozen=True)
class Result:
    """A result's file: its first row, and a line per training seed and rival, none if not verified."""

    head: Row
    records: tuple[Record, ...]

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

    def summaries(self, suites: Suites) -> dict[str, Summary]:
        """The summary over each suite, by what it says."""
        return {role: summary_of(self.records, suite) for role, suite in suites.items()}


def fingerprint(submission: Submission, suites: Suites) -> Row:
    """All that decides a result: the version, the protocol, the suites, and what was submitted."""
    found = {
        "version": __version__,
        "protocol": PROTOCOL,
        "suites": {role: [suite.name, suite.hash] for role, suite in suites.items()},
        "policies": {str(policy.seed): policy.sha256 for policy in submission.policies},
        "submission": submission.fingerprint,
    }
    if submission.track == PLANNER:
        found["planner"] = planner_facts(submission, suites[PUBLIC])
    return found


def planner_facts(submission: Submission, suite: Suite) -> Row:
    """What a result's fingerprint tells of a planner: its tier, its matches, and the language model.

    Raises:
        UserError: there is no such planner, or its transcripts do not tell.
    """
    matches = {"matches": suite.matches}
    if submission.script is not None:
        return {"tier": as_planner(submission.script, suite.scenario).tier, **matches}
    about, _ = told_of(submission.folder, suite)
    prompt = Path(about["prompt"]).stem
    runs = {"runs": submission.runs, "season": about["season"]}
    return {"tier": "history", **matches, **runs, "prompt": prompt, **{key: about[key] for key in _TOLD}}


def differing(one: Row, other: Row) -> list[str]:
    """In what two fingerprints differ, the package's version aside: what it changed shows in the rounds."""
    keys = (one.keys() | other.keys()) - {"version"}
    return sorted(key for key in keys if one.get(key) != other.get(key))


def verified_result(slug: str, track: str, printed: Row, records: Sequence[Record], suites: Suites) -> Result:
    """The result of a submission all of whose rounds were played.

    Args:
        slug, track: whose.
        printed: the fingerprint.
        lines: of all its training seeds against all rivals.
        suites: what was played.
    """
    return _result(slug, track, printed, tuple(records), summary(records, suites))


def failed_result(slug: str, track: str, printed: Row, reason: str) -> Result:
    """The result of a submission that could not be played to its end, and why."""
    return _result(slug, track, printed, reason=reason)


def _result(
    slug: str,
    track: str,
    printed: Row,
    records: tuple[Record, ...] = (),
    told: Row | None = None,
    reason: str | None = None,
) -> Result:
    head = {
        "kind": "result",
        "slug": slug,
        "track": track,
        "status": VERIFIED if reason is None else NOT_VERIFIED,
        "reason": reason,
        "fingerprint": printed,
        "summary": told,
        "lines_sha256": _sha256(records),
    }
    return Result(head, records)


def summary(records: Sequence[Record], suites: Suites) -> Row:
    """What the lines come to: per suite the score and the worst, and the measures over the known suite.

    Args:
        lines: of one submission.
        suites: what was played.
    """
    found = {role: summary_of(records, suite) for role, suite in suites.items()}
    known = found[PUBLIC]
    return {
        "training_seeds": known.training_seeds,
        "rounds": sum(of.pooled.rounds for of in found.values()),
        "lost": sum(of.pooled.lost for of in found.values()),
        "scores": {role: interval_row(of.score) | {"over": of.over} for role, of in found.items()},
        "worst": {
            role: {"against": of.worst, "return": rounded(of.by_rival[of.worst].value)}
            for role, of in found.items()
        },
        "measures": {name: rounded(value) for name, value in known.measures.items()},
    }


def interval_row(interval: Interval) -> Row:
    """An interval, rounded."""
    return {name: rounded(getattr(interval, name)) for name in ("value", "low", "high")}


def rounded(value: float | None) -> float | None:
    """To six digits that count; None where there is no finite number."""
    return None if value is None or not math.isfinite(value) else float(f"{value:.{_DIGITS}g}")


def write_result(path: Path, result: Result) -> None:
    """Write a result's file, whole."""
    write_whole(path, _text([result.head]) + _text([record.row() for record in result.records]))


def read_result(path: Path, suites: Suites) -> Result:
    """The result in a file, which must be just as it was written.

    Args:
        path: the file.
        suites: what it should have been played on; a result on others is read, but not summed up anew.

    Raises:
        UserError: it can't be read, is no result, is of an older protocol, or was edited: its lines are not
            those that it was written with, or its summary does not follow from them.
    """
    head, *rows = _rows(path)
    if head.keys() != _HEAD or head["kind"] != "result" or head["status"] not in (VERIFIED, NOT_VERIFIED):
        raise UserError(f"result {path}: its first line is not that of a result")
    if not isinstance(head["fingerprint"], dict):
        raise UserError(f"result {path}: fingerprint: expected a mapping")
    if (head["track"], head["slug"]) != (path.parent.name, path.stem):
        raise UserError(f"result {path}: is the result of {head['track']}/{head['slug']}")
    if head["fingerprint"].get("protocol") != PROTOCOL or "suites" not in head["fingerprint"]:
        raise UserError(
            f"result {path}: of another protocol than this version's, {PROTOCOL!r}; play it again"
        )
    records = tuple(read_record(row, f"result {path}: line {number}") for number, row in enumerate(rows, 2))
    found = Result(head, records)
    if head["lines_sha256"] != _sha256(records):
        raise UserError(f"result {path}: edited by hand: its lines are not those it was written with")
    if head["fingerprint"].get("suites") == {role: [of.name, of.hash] for role, of in suites.items()}:
        check_records(found, suites, path)
    return found


def check_records(result: Result, suites: Suites, path: Path) -> None:
    """Raise UserError where lines are not those of the suites, or the summary is not what they say."""
    if not result.verified:
        if result.records or result.head["summary"] is not None or not isinstance(result.head["reason"], str):
            raise UserError(
                f"result {path}: edited by hand: not verified, but with lines or without a reason"
            )
        return
    rounds = {suite.hash[:16]: suite.rounds for suite in suites.values()}
    if any(len(record.returns) != rounds.get(record.suite_hash) for record in result.records):
        raise UserError(f"result {path}: holds a line of another suite, or of another number of rounds")
    policies = result.fingerprint.get("policies")
    seeds = sorted(policies) if isinstance(policies, dict) and policies else ["None"]
    expected = sorted(
        (result.slug, seed, suite.name, suite.hash[:16], rival.name)
        for seed in seeds
        for suite in suites.values()
        for rival in suite.rivals
    )
    there = sorted(
        (record.entry, str(record.training_seed), record.suite, record.suite_hash, record.rival)
        for record in result.records
    )
    if there != expected:
        raise UserError(f"result {path}: its lines are not one per training seed and rival")
    if not _alike(summary(result.records, suites), result.head["summary"]):
        raise UserError(f"result {path}: edited by hand: its summary does not follow from its lines")


def _alike(one: Any, other: Any) -> bool:
    """Whether two summaries are the same, but for the last digit that another machine may round otherwise."""
    if isinstance(one, dict):
        return (
            isinstance(other, dict)
            and one.keys() == other.keys()
            and all(_alike(one[key], other[key]) for key in one)
        )
    if isinstance(one, float) and isinstance(other, int | float):
        return math.isclose(one, other, rel_tol=1e-5, abs_tol=1e-9)
    return bool(one == other)


def _rows(path: Path) -> list[Row]:
    """The rows of a file from anywhere: no more than so large, and strict JSON."""
    try:
        if not path.is_file() or path.is_symlink():
            raise UserError(f"result {path}: not a file; run fpg-bench submit verify")
        if path.stat().st_size > LARGEST:
            raise UserError(f"result {path}: larger than {LARGEST} bytes")
        records = path.read_bytes().removesuffix(b"\n").split(b"\n")
        rows = [read_object(record) for record in records]
    except OSError as error:
        raise UserError(f"result {path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        if isinstance(error, UserError):
            raise
        raise UserError(f"result {path}: not lines of JSON: {error}") from error
    return rows


def _text(rows: Sequence[Row]) -> str:
    return "".join(json.dumps(row, separators=(",", ":"), allow_nan=False) + "\n" for row in rows)


def _sha256(records: Sequence[Record]) -> str:
    return hashlib.sha256(_text([record.row() for record in records]).encode()).hexdigest()
