"""Profiles: what entries earn a step against a counterpart; a field is chosen by nothing else."""

from __future__ import annotations

from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import Entry, Panel
from fpg_bench.evaluation.runner import play_entry
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.game.scenario import STANDARD

ROUNDS = 60


def played(
    player: Any, side: str, other: Any, path: str, season: str, rounds: int = ROUNDS
) -> dict[str, Any]:
    """Rounds of a player against one of the other side, pooled.

    Args:
        player: whose profile it is: a name, or an object with ``predict``.
        side: which it plays.
        other: whom it meets.
        path: how the opponent of the two flies.
        season: the season's seed, from which the evaluation seeds follow.
        rounds: how many.

    Returns:
        ``n`` rounds, and the mean returns a step ``ally`` and ``opponent``.

    Raises:
        UserError: no such player, one of the wrong side, or actions that are no numbers.
    """
    entry = Entry(other, path)
    panel = Panel("season", side, STANDARD, rounds, "random", (entry,), season)
    chances = lambda count: evaluation_seeds(count, season)  # noqa: E731
    try:
        rows = [row for part in play_entry(player, panel, entry, rounds, chances) for row in part]
    except UserError as error:
        raise UserError(f"{player} against {other}: {error}") from error
    steps = sum(row["steps"] for row in rows)
    returns = {name: sum(row[f"{name}_return"] for row in rows) / steps for name in ("ally", "opponent")}
    return {"n": len(rows), **{name: round(value, 6) for name, value in returns.items()}}
