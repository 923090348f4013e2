"""Profiles: what entries earn a step against a counterpart; a field is chosen by nothing else."""

from __future__ import annotations

from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.field import Counterpart, Field
from fpg_bench.evaluation.play import play
from fpg_bench.game.scenario import STANDARD, as_scenario

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
    counterpart = Counterpart("season", (other,), as_scenario(STANDARD, opponent_path=path))
    field = Field("season", side, STANDARD, rounds, (counterpart,), season=season)
    try:
        line = play(player_entry(player), field, counterpart)
    except UserError as error:
        raise UserError(f"{player} against {other}: {error}") from error
    returns = {name: line.tally[f"{name}_return"] / line.tally["steps"] for name in ("ally", "opponent")}
    return {"n": len(line.returns), **{name: round(value, 6) for name, value in returns.items()}}
