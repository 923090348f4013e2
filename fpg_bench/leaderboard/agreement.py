"""Whether a result holds: lines played again, compared with those that are kept."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from fpg_bench.evaluation.panel import Panel
from fpg_bench.leaderboard.planner_track import STATUSES, TOKENS
from fpg_bench.rows import Row

# Rounds and means are compared by what they are worth: in shares of the distance between the random
# player (0) and the panel's reference (1) on the entry.
ROUND_WITHIN, MEAN_WITHIN = 1e-3, 5e-3
SHARE_OF_ROUNDS = 0.99
# Measures: of their value, or of their spread over rounds; one round of 100 may move them by a tenth of it.
_OF_SPREAD = 0.15
_POINTS_WITHIN = 0.01
# Neither means nor shares: one round more decides them.
_NOT_COMPARED = ("outage_longest_s", "recoveries_cut", "outage_mean_s", "time_to_recover_s")


def disagreements(played: Iterable[Row], kept: Iterable[Row], panel: Panel) -> list[str]:
    """Why a result does not hold, one line each; none where it does.

    At least 99 % of all rounds must return what they did, within a thousandth of the distance between the
    random player and the reference, and the mean of each entry within half a hundredth of it.

    Args:
        played: lines just played, perhaps of some entries only.
        kept: those of the result.
        panel: what they were played on.
    """
    before = {(line["training_seed"], line["entry"]): line for line in kept}
    pairs = [(line, before[line["training_seed"], line["entry"]]) for line in played]
    changed = [pair for pair in pairs if pair[0] != pair[1]]
    if not changed:
        return []
    found = _of_rounds(pairs, panel) + _of_entries(pairs, panel)
    return found + [text for now, then in changed for text in _of_line(now, then)]


def same_to_the_bit(played: Iterable[Row], kept: Iterable[Row]) -> int:
    """How many lines are just as they were."""
    before = {(line["training_seed"], line["entry"]): line for line in kept}
    return sum(line == before[line["training_seed"], line["entry"]] for line in played)


def _of_rounds(pairs: list[tuple[Row, Row]], panel: Panel) -> list[str]:
    near = [_apart(now, then, panel) <= ROUND_WITHIN for now, then in pairs]
    share = float(np.concatenate(near).mean())
    if share >= SHARE_OF_ROUNDS:
        return []
    return [f"{100 * (1 - share):.1f} % of {sum(map(len, near))} rounds return something else"]


def _of_entries(pairs: list[tuple[Row, Row]], panel: Panel) -> list[str]:
    found = []
    for name in dict.fromkeys(now["entry"] for now, _ in pairs):
        mine = [pair for pair in pairs if pair[0]["entry"] == name]
        means = [np.mean([line["returns"] for line in side]) for side in zip(*mine, strict=True)]
        if abs(means[0] - means[1]) > MEAN_WITHIN * _span(name, panel):
            found.append(f"{name}: mean return {means[0]:.1f}, the result says {means[1]:.1f}")
    return found


def _of_line(now: Row, then: Row) -> list[str]:
    """What else a line says: lost rounds, measures, frequency points."""
    where = now["entry"] if now["training_seed"] is None else f"seed {now['training_seed']}, {now['entry']}"
    found = []
    if abs(now["lost"] - then["lost"]) > (1 - SHARE_OF_ROUNDS) * now["n"]:
        found.append(f"{where}: {now['lost']} rounds lost, the result says {then['lost']}")
    for name in (STATUSES, TOKENS):
        if now.get(name) != then.get(name):
            found.append(f"{where}: {name} {now.get(name)}, the result says {then.get(name)}")
    for name, value in now["mean"].items():
        if name not in _NOT_COMPARED and not _near(value, then["mean"][name], now["sd"].get(name)):
            found.append(f"{where}: {name} {value}, the result says {then['mean'][name]}")
    for name in ("ally_points", "jam_points"):
        shares = [np.array(line[name]) / max(np.sum(line[name]), 1) for line in (now, then)]
        if np.abs(shares[0] - shares[1]).sum() / 2 > _POINTS_WITHIN:
            found.append(f"{where}: other {name}")
    return found


def _near(now: float | None, then: float | None, spread: float | None) -> bool:
    if now is None or then is None:
        return now is then
    return abs(now - then) <= max(MEAN_WITHIN * max(abs(now), abs(then)), _OF_SPREAD * (spread or 0), 1e-6)


def _apart(now: Row, then: Row, panel: Panel) -> np.ndarray:
    return np.abs(np.subtract(now["returns"], then["returns"])) / _span(now["entry"], panel)


def _span(entry: str, panel: Panel) -> float:
    assert panel.references is not None
    reference = panel.references[entry]
    return abs(float(np.mean(reference.reference) - np.mean(reference.random)))
