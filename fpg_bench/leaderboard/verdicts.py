"""What becomes of a submission that was played: its result is written, or compared with the kept one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from fpg_bench.common.parallel import outcome_of
from fpg_bench.evaluation.record import Record
from fpg_bench.leaderboard.agreement import disagreements, same_to_the_bit
from fpg_bench.leaderboard.cases import Case, again, result_at
from fpg_bench.leaderboard.playing import failure_in, key_of, open_in, records_in
from fpg_bench.leaderboard.result import Result, failed_result, verified_result, write_result
from fpg_bench.leaderboard.tracks import ranked_by


@dataclass(frozen=True)
class Verdict:
    """What became of one submission: all is well or not, and the line that says so."""

    name: str
    good: bool
    record: str


def judge(case: Case) -> tuple[bool, str]:
    """Whether all is well, and what is to be said; writes the result where there is none."""
    folders = [(case.work / part.name, matchups) for part, matchups in case.wanted]
    why = next((said for folder, _ in folders if (said := failure_in(folder))), None)
    records: list[Record] = []
    for folder, matchups in folders if why is None else ():
        there = records_in(folder)
        records += [there[key_of(*matchup)] for matchup in matchups]
    if case.whole and records and all(record.lost == len(record.returns) for record in records):
        why = "all of its rounds are lost by rule: its answers are no valid actions"
    if case.known is None:
        return _first(case, records, why)
    if not case.known.verified:
        return _still_failed(case, why)
    if why is not None:
        return False, f"the result is verified, but now: {why}"
    found = disagreements(records, case.known.records, case.suites)
    if found:
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        return False, f"the result does not hold: {found[0]}{more}"
    same = same_to_the_bit(records, case.known.records)
    return True, f"holds: {same} of {len(records)} lines played again are the same to the bit"


def open_walls(case: Case) -> str:
    """What the processes of a case's policies could not be kept from, in words; nothing where all is well."""
    found = dict.fromkeys(name for part, _ in case.wanted for name in open_in(case.work / part.name))
    return f"; this machine cannot keep a policy from {', '.join(found)}" if found else ""


def _first(case: Case, records: list[Record], why: str | None) -> tuple[bool, str]:
    whose = (case.submission.slug, case.submission.track, case.printed)
    if why is not None:
        write_result(case.path, failed_result(*whose, why))
        return False, f"not verified: {why}"
    result = verified_result(*whose, records, case.suites)
    write_result(case.path, result)
    wrong = None if case.claimed is None else _wrong(case, case.claimed, records)
    if wrong is not None:
        return False, f"replaced: the result that came along {wrong}; commit this one: {told(result)}"
    return True, told(result)


def _wrong(case: Case, claimed: Path, records: list[Record]) -> str | None:
    """What is wrong with a result that came along, None where it holds or there was none."""
    read = outcome_of(partial(result_at, claimed, case.submission, case.suites))
    if read.error is not None:
        return "is none of this entry's, or was edited"
    claim: Result | None = read.result
    if claim is None:
        return None
    if not claim.verified:
        return "says that it is not verified"
    found = disagreements(records, claim.records, case.suites)
    return f"does not hold: {found[0]}" if found else None


def _still_failed(case: Case, why: str | None) -> tuple[bool, str]:
    if not case.wanted:
        return True, "not verified; not part of a sample"
    if why is None:
        return False, f"the result is not verified, but it plays; {again(case.submission)}"
    return True, f"not verified, as before: {why}"


def told(result: Result) -> str:
    """What a result says, in a line."""
    if not result.verified:
        return f"not verified: {result.head['reason']}"
    summary = result.head["summary"]
    role = ranked_by(summary["scores"])
    score = summary["scores"][role]
    lost = f", {summary['lost']:,} of {summary['rounds']:,} rounds lost by rule" if summary["lost"] else ""
    return f"verified: {role} {score['value']:.1f} [{score['low']:.1f}, {score['high']:.1f}]{lost}"
