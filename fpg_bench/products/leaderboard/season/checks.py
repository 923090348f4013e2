"""Checks that held-out rivals must pass before a season closes."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fpg_bench.evaluation.statistics import correlation_interval, student_half
from fpg_bench.products.leaderboard.verdicts import Verdict

AGREEMENT = 0.8  # least Spearman correlation of two orders of the entries
SPLITS = 200
ORACLE_SHARE = 2 / 3  # of the members from which an oracle earns as much as the best entry
FEWEST, BEST = 8, 10  # entries of a table that can be compared, and the best ones whose order must hold


@dataclass(frozen=True)
class Evidence:
    """Returns per step of both sides where a side's members, strangers and an oracle met the entries.

    Attributes:
        side: the members' side.
        tables: for each table of the other side, the rows of its entries.
        scripts: the rows of entries that are scripts.
        members: what the entries earn from each member, ``(entries, members)``.
        kinds: kind of each member, by the method that made it.
        strangers: what they earn from each stranger, ``(entries, strangers)``.
        oracle: what an oracle of the entries' side earns from each member, ``(members,)``.
        earned: what each member earns from the entries, by name.
        floor: the script that a member must beat, and what it earns from the entries.
    """

    side: str
    tables: Mapping[str, Sequence[int]]
    scripts: Collection[int]
    members: np.ndarray
    kinds: Sequence[str]
    strangers: np.ndarray
    oracle: np.ndarray
    earned: Mapping[str, float]
    floor: tuple[str, float]


def check_members(evidence: Evidence) -> Iterator[Verdict]:
    """Yield the verdicts on a side's members.

    An oracle earns significantly more than any entry that meets them, and at least as much from two thirds of
    them; each member earns more by its own rules than the floor; no script leads a table; the mean over one
    half of the members orders the ten best entries of each table as that over the other half does (mean
    Spearman correlation over drawn halves), that over each kind of members as that over the other kinds, and
    the mean over all orders the table as that over strangers does, which are neither entries nor members.
    """
    side, means = evidence.side, evidence.members.mean(axis=1)
    best = int(means.argmax())
    ahead = evidence.oracle - evidence.members[best]
    least, share = ahead.mean() - student_half(ahead), float((ahead >= 0).mean())
    line = (
        f"an oracle earns {evidence.oracle.mean():.2f}, the best entry {means[best]:.2f}; the difference is "
        f"at least {least:.2f} (95 %); it earns as much or more from {100 * share:.0f} % of the members"
    )
    yield Verdict(f"{side}: an oracle ranks first", bool(least > 0) and share >= ORACLE_SHARE, line)
    script, floor = evidence.floor
    name, lowest = min(evidence.earned.items(), key=lambda item: item[1])
    line = f"{name} earns least, {lowest:.2f}; {script} earns {floor:.2f}"
    yield Verdict(f"{side}: members are above the floor", lowest > floor, line)
    for table, rows in evidence.tables.items():
        if len(rows) < FEWEST:
            continue
        own = evidence.members[list(rows)]
        order = np.argsort(-own.mean(axis=1), kind="stable")
        is_script = [row in evidence.scripts for row in rows]
        lead = next((k for k, row in enumerate(order) if not is_script[row]), len(order))
        yield Verdict(
            f"{side}: no script leads {table}", lead == 0, f"scripts before any other entry: {lead}"
        )
        first = own[order[:BEST]]
        yield _agreement(f"{side}: halves agree on the best of {table}", _split_half(first), len(first))
        value = _least_agreement(first, evidence.kinds)
        yield _agreement(f"{side}: kinds agree on the best of {table}", value, len(first))
        strangers = evidence.strangers[list(rows)]
        value = spearman(own.mean(axis=1), strangers.mean(axis=1))
        yield _agreement(f"{side}: strangers agree on {table}", value, len(rows))


def spearman(a: np.ndarray, b: np.ndarray) -> float:
    """Return Spearman's rank correlation of two samples; 0 where one of them is constant."""
    from scipy.stats import spearmanr

    return 0.0 if np.ptp(a) == 0 or np.ptp(b) == 0 else float(spearmanr(a, b).statistic)


def _split_half(returns: np.ndarray) -> float:
    rng, count = np.random.default_rng(0), returns.shape[1]
    values = []
    for _ in range(SPLITS):
        order = rng.permutation(count)
        halves = (returns[:, part].mean(axis=1) for part in np.array_split(order, 2))
        values.append(spearman(*halves))
    return float(np.mean(values))


def _least_agreement(returns: np.ndarray, kinds: Sequence[str]) -> float:
    """Return the least correlation of the order by one kind of members with that by all other members."""
    of = np.array(kinds)
    values = [
        spearman(returns[:, of == kind].mean(axis=1), returns[:, of != kind].mean(axis=1))
        for kind in dict.fromkeys(kinds)
    ]
    return min(values) if len(values) > 1 else 0.0


def _agreement(name: str, value: float, entries: int) -> Verdict:
    ends = correlation_interval(value, entries)
    line = (
        f"Spearman {value:.2f} [{ends.low:.2f}, {ends.high:.2f}] over {entries} entries, "
        f"at least {AGREEMENT} is asked"
    )
    return Verdict(name, value >= AGREEMENT, line)
