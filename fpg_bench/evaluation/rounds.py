"""The loop that plays rounds: both sides act and the game steps until every round is over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.game.batch import Seeds
from fpg_bench.players.player import SIDES, PlayerSpec
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player

Players = PlayerSpec | list[PlayerSpec] | tuple[PlayerSpec, ...]  # one, or several to draw from per round


class SidePolicy(Protocol):
    """Policy of one side of a batch, as :class:`fpg_bench.players.policy_runner.PolicyRunner` is."""

    def begin(self, mask: np.ndarray) -> None:
        """Start the rounds that begin in the masked games."""

    def act(self) -> np.ndarray:
        """Return the side's actions ``(N, 9)`` for the present observations."""


@dataclass(frozen=True)
class MatchBatch:
    """A batch of games with both policies."""

    duel: TwoPlayerBatch
    ally: SidePolicy
    opponent: SidePolicy


def make_match(duel: TwoPlayerBatch, ally: Players, opponent: Players) -> MatchBatch:
    """Make a batch of games between two players, or lists of players of which one is drawn per round.

    Raises:
        UserError: no such player, or one of the wrong side.
    """
    runners = []
    for side, spec in zip(SIDES, (ally, opponent), strict=True):
        specs = spec if isinstance(spec, list | tuple) else [spec]
        players = [as_player(each, side, duel.scenario) for each in specs]
        runners.append(PolicyRunner(side, players, duel.batch))
    return MatchBatch(duel, *runners)


def play_round(
    *matches: MatchBatch, seeds: Seeds | None = None, on_step: Callable[[], None] | None = None
) -> None:
    """Play one round of every game, all batches step by step together.

    Args:
        *matches: batches with rounds of equal length.
        seeds: seeds of new matches, for each batch; None: the next round of each match.
        on_step: called after each step.
    """
    begin_round(*matches, seeds=seeds)
    finish_round(*matches, on_step=on_step)


def begin_round(*matches: MatchBatch, seeds: Seeds | None = None) -> None:
    """Begin a round in every game; arguments as in :func:`play_round`."""
    for match in matches:
        mask = match.duel.reset(seeds=seeds)
        match.ally.begin(mask)
        match.opponent.begin(mask)


def finish_round(*matches: MatchBatch, on_step: Callable[[], None] | None = None) -> None:
    """Play a round that has begun to its end; arguments as in :func:`play_round`."""
    while not all(match.duel.batch.games["truncated"].all() for match in matches):
        for match in matches:
            match.duel.batch.step(match.ally.act(), match.opponent.act())
        if on_step is not None:
            on_step()
