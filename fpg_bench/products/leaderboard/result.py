"""Results of submissions: files of records that show when they were edited by hand."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_bounded, write_whole
from fpg_bench.common.rows import SEAL, Row
from fpg_bench.common.schema import Strict, parse
from fpg_bench.common.strict_json import read_object
from fpg_bench.evaluation.record import Record, read_record
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.evaluation.suite import PLANNER, Suite
from fpg_bench.evaluation.summary import Summary, summary_of
from fpg_bench.players.planner import as_planner
from fpg_bench.products.leaderboard.tracks import PUBLIC
from fpg_bench.products.leaderboard.transcripts import read_recording
from fpg_bench.version import __version__

if TYPE_CHECKING:
    from fpg_bench.products.leaderboard.submission import Submission

VERIFIED, NOT_VERIFIED = "verified", "not verified"
LARGEST = 4_000_000  # bytes; five training seeds in a season take 400,000
_DIGITS = 6
Suites = Mapping[str, Suite]  # the suites that a submission plays, by role


class PlannerFacts(Strict):
    """Facts about a planner in a fingerprint; those from ``runs`` on are of language models only."""

    tier: str
    matches: int
    runs: int | None = None
    season: int | None = None
    prompt: str | None = None
    model: str | None = None
    server: str | None = None
    control: str | None = None
    prompt_hash: str | None = None


class Fingerprint(Strict):
    """Everything that decides a result.

    Attributes:
        version, protocol: of the package.
        suites: name and hash of each suite, by role.
        policies: hash of each policy, by training seed.
        submission: hash of what was submitted.
        planner: facts about a planner; None for players.
    """

    version: str
    protocol: str
    suites: dict[str, list[str]]
    policies: dict[str, str]
    submission: str
    planner: PlannerFacts | None = None

    def to_dict(self) -> Row:
        """Return the fingerprint as it is written into results."""
        return self.model_dump(exclude_unset=True)

    def differences(self, other: Fingerprint) -> list[str]:
        """Return the keys in which fingerprints differ, except the package's version."""
        one, two = self.to_dict(), other.to_dict()
        return sorted(key for key in (one.keys() | two.keys()) - {"version"} if one.get(key) != two.get(key))


class _Head(Strict):
    """First row of a result's file."""

    kind: Literal["result"]
    slug: str
    track: str
    status: Literal["verified", "not verified"]
    reason: str | None
    fingerprint: Fingerprint
    sha256: str


@dataclass(frozen=True)
class Result:
    """A result.

    Attributes:
        slug, track: the entry that it belongs to.
        fingerprint: what was played.
        records: one per training seed and rival; empty if it is not verified.
        reason: why it is not verified; None if it is.
    """

    slug: str
    track: str
    fingerprint: Fingerprint
    records: tuple[Record, ...] = ()
    reason: str | None = None

    @property
    def verified(self) -> bool:
        """True if it was played to its end; only then it is ranked."""
        return self.reason is None


def summaries_of(records: Sequence[Record], suites: Suites) -> dict[str, Summary]:
    """Return the summary of a submission's records over each of its suites, by role."""
    return {role: summary_of(records, suite) for role, suite in suites.items()}


def fingerprint(submission: Submission, suites: Suites) -> Fingerprint:
    """Return the fingerprint of a submission on its suites."""
    printed = Fingerprint(
        version=__version__,
        protocol=PROTOCOL,
        suites={role: [suite.name, suite.hash] for role, suite in suites.items()},
        policies={str(policy.seed): policy.sha256 for policy in submission.policies},
        submission=submission.fingerprint,
    )
    if submission.track != PLANNER:
        return printed
    return printed.model_copy(update={"planner": planner_facts(submission, suites[PUBLIC])})


def planner_facts(submission: Submission, suite: Suite) -> PlannerFacts:
    """Return the facts about a planner that a fingerprint holds.

    Raises:
        UserError: there is no such planner, or its transcripts cannot be read.
    """
    if submission.script is not None:
        tier = as_planner(submission.script, suite.scenario).tier
        return PlannerFacts(tier=tier, matches=suite.matches)
    about, _ = read_recording(submission.folder, suite)
    named = ("model", "server", "control", "prompt_hash", "season")
    facts = {name: getattr(about, name) for name in named}
    facts |= {"tier": "history", "matches": suite.matches, "runs": submission.runs}
    facts["prompt"] = Path(about.prompt).stem
    return parse(PlannerFacts, facts, f"transcripts of {submission.slug}")


def round_finite(value: float) -> float:
    """Round a number to six significant digits; NaN stays."""
    return float(f"{value:.{_DIGITS}g}")


# Files


def write_result(path: Path, result: Result) -> None:
    """Write a result's file."""
    head = {
        "kind": "result",
        "slug": result.slug,
        "track": result.track,
        "status": VERIFIED if result.verified else NOT_VERIFIED,
        "reason": result.reason,
        "fingerprint": result.fingerprint.to_dict(),
    }
    records = [record.row() for record in result.records]
    write_whole(path, _text([head | {SEAL: _sha256([head, *records])}, *records]))


def read_result(path: Path, suites: Suites) -> Result:
    """Read the result in a file, which must be as it was written.

    Args:
        path: the file.
        suites: the suites that the entry plays; the records of a result on other suites are not checked.

    Raises:
        UserError: it cannot be read, is not a result, is of an older protocol, or does not fit its hash.
    """
    first, *rows = _rows(path)
    printed = first.get("fingerprint")
    if first.get("kind") != "result" or not isinstance(printed, dict):
        raise UserError(f"result {path}: its first line is not that of a result")
    if (first.get("track"), first.get("slug")) != (path.parent.name, path.stem):
        raise UserError(f"result {path}: is the result of {first.get('track')}/{first.get('slug')}")
    if printed.get("protocol") != PROTOCOL or "suites" not in printed:
        raise UserError(
            f"result {path}: of another protocol than this version's, {PROTOCOL!r}; play it again"
        )
    head = parse(_Head, first, f"result {path}: line 1")
    records = tuple(read_record(row, f"result {path}: line {number}") for number, row in enumerate(rows, 2))
    del first[SEAL]
    if head.sha256 != _sha256([first, *(record.row() for record in records)]):
        raise UserError(f"result {path}: was edited or damaged: it does not fit its hash")
    if head.status == NOT_VERIFIED and (records or head.reason is None):
        raise UserError(f"result {path}: edited by hand: not verified, but with records or without a reason")
    if head.status == VERIFIED and head.reason is not None:
        raise UserError(f"result {path}: edited by hand: verified, but with a reason")
    result = Result(head.slug, head.track, head.fingerprint, records, head.reason)
    played = {role: [suite.name, suite.hash] for role, suite in suites.items()}
    if result.verified and head.fingerprint.suites == played:
        check_records(result, suites, path)
    return result


def check_records(result: Result, suites: Suites, path: Path) -> None:
    """Raise UserError if records are not those of the suites."""
    rounds = {suite.hash[:16]: suite.rounds for suite in suites.values()}
    if any(len(record.returns) != rounds.get(record.suite_hash) for record in result.records):
        raise UserError(f"result {path}: holds a record of another suite, or of another number of rounds")
    expected = sorted(
        (result.slug, seed, suite.name, suite.hash[:16], rival.name)
        for seed in sorted(result.fingerprint.policies) or ["None"]
        for suite in suites.values()
        for rival in suite.rivals
    )
    there = sorted(
        (record.entry, str(record.training_seed), record.suite, record.suite_hash, record.rival)
        for record in result.records
    )
    if there != expected:
        raise UserError(f"result {path}: its records are not one per training seed and rival")
    policies = result.fingerprint.policies
    if policies and any(
        record.fingerprint != policies[str(record.training_seed)][:16] for record in result.records
    ):
        raise UserError(f"result {path}: holds a record of another policy than the result's")


def _rows(path: Path) -> list[Row]:
    """Read the rows of an untrusted file: bounded, and strict JSON."""
    try:
        if not path.is_file() or path.is_symlink():
            raise UserError(f"result {path}: not a file; run fpg-bench leaderboard verify")
        lines = read_bounded(path, "result", LARGEST).removesuffix(b"\n").split(b"\n")
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


def _sha256(rows: Sequence[Row]) -> str:
    return hashlib.sha256(_text(rows).encode()).hexdigest()
