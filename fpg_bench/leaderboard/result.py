"""A result: what a submission earned, meeting by meeting, in a file that shows when it was edited by hand."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fpg_bench.errors import UserError
from fpg_bench.evaluation.field import PLANNER, Field
from fpg_bench.evaluation.line import Line, read_line
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.evaluation.summary import Summary, summary_of
from fpg_bench.files import write_whole
from fpg_bench.leaderboard.tracks import KNOWN
from fpg_bench.leaderboard.transcripts import told as told_of
from fpg_bench.plain_json import read_object
from fpg_bench.planning import as_planner
from fpg_bench.rows import Row
from fpg_bench.version import __version__

if TYPE_CHECKING:
    from fpg_bench.leaderboard.submission import Submission

VERIFIED, NOT_VERIFIED = "verified", "not verified"
LARGEST = 4_000_000  # bytes; those of five training seeds in a season are 400,000
_DIGITS = 6
_HEAD = {"kind", "slug", "track", "status", "reason", "fingerprint", "summary", "lines_sha256"}
_TOLD = ("model", "server", "control", "prompt_hash")  # of a language model
Fields = Mapping[str, Field]  # what a submission plays, by what it says of it


@dataclass(frozen=True)
class Result:
    """A result's file: its first row, and a line per training seed and counterpart, none if not verified."""

    head: Row
    lines: tuple[Line, ...]

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

    def summaries(self, fields: Fields) -> dict[str, Summary]:
        """The summary over each field, by what it says."""
        return {role: summary_of(self.lines, field) for role, field in fields.items()}


def fingerprint(submission: Submission, fields: Fields) -> Row:
    """All that decides a result: the version, the protocol, the fields, and what was submitted."""
    found = {
        "version": __version__,
        "protocol": PROTOCOL,
        "fields": {role: [field.name, field.hash] for role, field in fields.items()},
        "policies": {str(policy.seed): policy.sha256 for policy in submission.policies},
        "submission": submission.fingerprint,
    }
    if submission.track == PLANNER:
        found["planner"] = planner_facts(submission, fields[KNOWN])
    return found


def planner_facts(submission: Submission, field: Field) -> Row:
    """What a result's fingerprint tells of a planner: its tier, its matches, and the language model.

    Raises:
        UserError: there is no such planner, or its transcripts do not tell.
    """
    matches = {"matches": field.matches}
    if submission.script is not None:
        return {"tier": as_planner(submission.script, field.scenario).tier, **matches}
    about, _ = told_of(submission.folder, field)
    prompt = Path(about["prompt"]).stem
    runs = {"runs": submission.runs, "season": about["season"]}
    return {"tier": "history", **matches, **runs, "prompt": prompt, **{key: about[key] for key in _TOLD}}


def differing(one: Row, other: Row) -> list[str]:
    """In what two fingerprints differ, the package's version aside: what it changed shows in the rounds."""
    keys = (one.keys() | other.keys()) - {"version"}
    return sorted(key for key in keys if one.get(key) != other.get(key))


def verified_result(slug: str, track: str, printed: Row, lines: Sequence[Line], fields: Fields) -> Result:
    """The result of a submission all of whose rounds were played.

    Args:
        slug, track: whose.
        printed: the fingerprint.
        lines: of all its training seeds against all counterparts.
        fields: what was played.
    """
    return _result(slug, track, printed, tuple(lines), summary(lines, fields))


def failed_result(slug: str, track: str, printed: Row, reason: str) -> Result:
    """The result of a submission that could not be played to its end, and why."""
    return _result(slug, track, printed, reason=reason)


def _result(
    slug: str,
    track: str,
    printed: Row,
    lines: tuple[Line, ...] = (),
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
        "lines_sha256": _sha256(lines),
    }
    return Result(head, lines)


def summary(lines: Sequence[Line], fields: Fields) -> Row:
    """What the lines come to: per field the score and the worst, and the measures over the known field.

    Args:
        lines: of one submission.
        fields: what was played.
    """
    found = {role: summary_of(lines, field) for role, field in fields.items()}
    known = found[KNOWN]
    return {
        "training_seeds": known.training_seeds,
        "rounds": sum(of.pooled.rounds for of in found.values()),
        "lost": sum(of.pooled.lost for of in found.values()),
        "scores": {role: interval_row(of.score) | {"over": of.over} for role, of in found.items()},
        "worst": {
            role: {"against": of.worst, "return": rounded(of.by_counterpart[of.worst].value)}
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
    write_whole(path, _text([result.head]) + _text([line.row() for line in result.lines]))


def read_result(path: Path, fields: Fields) -> Result:
    """The result in a file, which must be just as it was written.

    Args:
        path: the file.
        fields: what it should have been played on; a result on others is read, but not summed up anew.

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
    if head["fingerprint"].get("protocol") != PROTOCOL or "fields" not in head["fingerprint"]:
        raise UserError(
            f"result {path}: of another protocol than this version's, {PROTOCOL!r}; play it again"
        )
    lines = tuple(read_line(row, f"result {path}: line {number}") for number, row in enumerate(rows, 2))
    found = Result(head, lines)
    if head["lines_sha256"] != _sha256(lines):
        raise UserError(f"result {path}: edited by hand: its lines are not those it was written with")
    if head["fingerprint"].get("fields") == {role: [of.name, of.hash] for role, of in fields.items()}:
        check_lines(found, fields, path)
    return found


def check_lines(result: Result, fields: Fields, path: Path) -> None:
    """Raise UserError where lines are not those of the fields, or the summary is not what they say."""
    if not result.verified:
        if result.lines or result.head["summary"] is not None or not isinstance(result.head["reason"], str):
            raise UserError(
                f"result {path}: edited by hand: not verified, but with lines or without a reason"
            )
        return
    rounds = {field.hash[:16]: field.rounds for field in fields.values()}
    if any(len(line.returns) != rounds.get(line.field_hash) for line in result.lines):
        raise UserError(f"result {path}: holds a line of another field, or of another number of rounds")
    policies = result.fingerprint.get("policies")
    seeds = sorted(policies) if isinstance(policies, dict) and policies else ["None"]
    expected = sorted(
        (result.slug, seed, field.name, field.hash[:16], counterpart.name)
        for seed in seeds
        for field in fields.values()
        for counterpart in field.counterparts
    )
    there = sorted(
        (line.entry, str(line.training_seed), line.field, line.field_hash, line.counterpart)
        for line in result.lines
    )
    if there != expected:
        raise UserError(f"result {path}: its lines are not one per training seed and counterpart")
    if not _alike(summary(result.lines, fields), result.head["summary"]):
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
        lines = path.read_bytes().removesuffix(b"\n").split(b"\n")
        rows = [read_object(line) for line in lines]
    except OSError as error:
        raise UserError(f"result {path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        if isinstance(error, UserError):
            raise
        raise UserError(f"result {path}: not lines of JSON: {error}") from error
    return rows


def _text(rows: Sequence[Row]) -> str:
    return "".join(json.dumps(row, separators=(",", ":"), allow_nan=False) + "\n" for row in rows)


def _sha256(lines: Sequence[Line]) -> str:
    return hashlib.sha256(_text([line.row() for line in lines]).encode()).hexdigest()
