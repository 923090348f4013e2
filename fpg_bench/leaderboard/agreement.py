"""Whether a result holds: lines played again, compared with those that are kept."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from fpg_bench.evaluation.record import TALLIES, Record
from fpg_bench.evaluation.suite import Suite
from fpg_bench.game.measures import GREATEST

# Returns are compared by what they are worth: in shares of the distance from 0 to 100 on the suite's scale.
ROUND_WITHIN, MEAN_WITHIN = 1e-3, 5e-3
SHARE_OF_ROUNDS = 0.99
_STEPS_WITHIN = 0.005  # of all steps, where something is counted by step
_LEVEL_WITHIN = 0.005  # of a sum of levels or rates
_POINTS_WITHIN = 0.01
_SAME_WITHIN = 1e-6  # of sums over the same rounds, which are rounded once more when they are added up
_LEVELS = ("snr_db", "capacity_mbit_s")
_RETURNS = ("ally_return", "opponent_return")
_BY_STEP = tuple(name for name in TALLIES if name not in (*_LEVELS, *_RETURNS, "steps", GREATEST))
Key = tuple[int | None, str, str, str]


def disagreements(played: Iterable[Record], kept: Iterable[Record], suites: Mapping[str, Suite]) -> list[str]:
    """Why a result does not hold, one line each; none where it does.

    At least 99 % of all rounds must return what they did, within a thousandth of the distance from 0 to 100,
    and the mean against each rival within half a hundredth of it.

    Args:
        played: lines just played, perhaps against some rivals only.
        kept: those of the result.
        suites: what they were played on.
    """
    before = {_key(record): record for record in kept}
    pairs = [(record, before[_key(record)]) for record in played]
    changed = [pair for pair in pairs if not pair[0].same_as(pair[1])]
    if not changed:
        return []
    spans = {  # of a round's return, from 0 to 100
        suite.hash[:16]: (suite.scale.top - suite.scale.zero) * suite.scenario.steps_per_round
        for suite in suites.values()
    }
    found = _of_rounds(pairs, spans) + _of_means(pairs, spans)
    return found + [text for now, then in changed for text in _of_record(now, then, spans[now.suite_hash])]


def same_to_the_bit(played: Iterable[Record], kept: Iterable[Record]) -> int:
    """How many lines are just as they were."""
    before = {_key(record): record for record in kept}
    return sum(record.same_as(before[_key(record)]) for record in played)


def _key(record: Record) -> Key:
    return record.training_seed, record.suite, record.suite_hash, record.rival


def _of_rounds(pairs: list[tuple[Record, Record]], spans: Mapping[str, float]) -> list[str]:
    near = [
        np.abs(np.subtract(now.returns, then.returns)) <= ROUND_WITHIN * spans[now.suite_hash]
        for now, then in pairs
    ]
    share = float(np.concatenate(near).mean())
    if share >= SHARE_OF_ROUNDS:
        return []
    return [f"{100 * (1 - share):.1f} % of {sum(map(len, near))} rounds return something else"]


def _of_means(pairs: list[tuple[Record, Record]], spans: Mapping[str, float]) -> list[str]:
    found = []
    for which in dict.fromkeys(_key(now)[1:] for now, _ in pairs):
        mine = [pair for pair in pairs if _key(pair[0])[1:] == which]
        means = [np.mean([record.returns for record in side]) for side in zip(*mine, strict=True)]
        if abs(means[0] - means[1]) > MEAN_WITHIN * spans[which[1]]:
            found.append(f"{_where(mine[0][0])}: mean return {means[0]:.1f}, the result says {means[1]:.1f}")
    return found


def _of_record(now: Record, then: Record, span: float) -> list[str]:
    """What else a line says: lost rounds, sums, frequency points, plans."""
    seed = "" if now.training_seed is None else f"seed {now.training_seed}, "
    where, found = f"{seed}{_where(now)}", []
    if abs(now.lost - then.lost) > (1 - SHARE_OF_ROUNDS) * len(now.returns):
        found.append(f"{where}: {now.lost} rounds lost, the result says {then.lost}")
    if now.plans != then.plans:
        found.append(f"{where}: other plans: {now.plans}, the result says {then.plans}")
    for name, most in _within(now, then, span).items():
        if abs(now.tally[name] - then.tally[name]) > most:
            found.append(f"{where}: {name} {now.tally[name]:g}, the result says {then.tally[name]:g}")
    for name in ("ally_points", "jam_points"):
        shares = [
            np.array(getattr(record, name)) / max(sum(getattr(record, name)), 1) for record in (now, then)
        ]
        if len(shares[0]) != len(shares[1]) or np.abs(shares[0] - shares[1]).sum() / 2 > _POINTS_WITHIN:
            found.append(f"{where}: other {name}")
    return found


def _within(now: Record, then: Record, span: float) -> dict[str, float]:
    """How far the sums of two lines may be apart; the longest outage may, as a single round decides it."""
    if now.rounds_sha256 == then.rounds_sha256:
        return {name: _SAME_WITHIN * abs(value) for name, value in now.tally.items()}
    found = {"steps": 0.0} | dict.fromkeys(_BY_STEP, _STEPS_WITHIN * now.tally["steps"])
    found |= {name: _LEVEL_WITHIN * abs(now.tally[name]) for name in _LEVELS}
    return found | dict.fromkeys(_RETURNS, MEAN_WITHIN * span * len(now.returns))


def _where(record: Record) -> str:
    return f"{record.suite}, {record.rival}"
