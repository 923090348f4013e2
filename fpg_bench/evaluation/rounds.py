"""The one loop that plays rounds: both seats act, the game steps, until every round is over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.players.player import SIDES
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player


class Acting(Protocol):
    """What sits at a side of a table: a :class:`fpg_bench.players.policy_runner.Seat`, or something like it."""

    def begin(self, mask: np.ndarray) -> None:
        """Take up the rounds that begin in the masked games."""

    def act(self) -> np.ndarray:
        """The side's actions ``(N, 9)`` on the present observations."""


@dataclass(frozen=True)
class MatchBatch:
    """N games and who sits at both sides of them."""

    duel: TwoPlayerBatch
    ally: Acting
    opponent: Acting


def make_match(duel: TwoPlayerBatch, ally: Any, opponent: Any) -> MatchBatch:
    """A table whose sides are played by these players; of a list, one is drawn per round.

    Raises:
        UserError: no such player, or one of the wrong side.
    """
    players = [list(who) if isinstance(who, list | tuple) else [who] for who in (ally, opponent)]
    runners = [
        PolicyRunner(side, [as_player(spec, side, duel.scenario) for spec in specs], duel.batch)
        for side, specs in zip(SIDES, players, strict=True)
    ]
    return MatchBatch(duel, *runners)


def play_round(
    *tables: MatchBatch, seeds: Any = None, on_step: Callable[[], None] | None = None, begun: bool = False
) -> None:
    """Play one round of every game to its end, the tables step by step together.

    Args:
        *tables: with rounds of equal length.
        seeds: those of new matches, for each table; None: the next round of each match.
        on_step: called after each step.
        begun: whether :func:`begin` has been called already.
    """
    if not begun:
        begin(*tables, seeds=seeds)
    while not all(table.duel.batch.games["truncated"].all() for table in tables):
        for table in tables:
            table.duel.batch.step(table.ally.act(), table.opponent.act())
        if on_step is not None:
            on_step()


def begin(*tables: MatchBatch, seeds: Any = None) -> None:
    """Begin a round in every game; arguments as in :func:`play_round`."""
    for table in tables:
        mask = table.duel.reset(seeds=seeds)
        table.ally.begin(mask)
        table.opponent.begin(mask)
