"""Matches of two teams on evaluation seeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.game.batch import Seeds
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.team_batch import TeamBatch
from fpg_bench.game.team_rules import TeamRules
from fpg_bench.players.player import PlayerSpec
from fpg_bench.players.team_runner import TeamRunner
from fpg_bench.players.team_scripts import as_team_player


class TeamMatches(NamedTuple):
    """Results of matches of one round.

    Attributes:
        rewards: ``(G,)`` float64, the mean reward of an ally per step.
        clashes: mean number per step of allies on the unspread point of an earlier seat.
        spreading: share of steps in which an ally spreads.
        heard: share of steps with a check in which jammers found an ally.
    """

    rewards: np.ndarray
    clashes: float
    spreading: float
    heard: float


def play_teams(
    allies: Sequence[PlayerSpec],
    opponents: Sequence[PlayerSpec],
    scenario: Scenario,
    team: TeamRules,
    matches: int,
    seeds: Seeds | None = None,
    on_step: Callable[[TeamBatch], None] = lambda batch: None,
) -> TeamMatches:
    """Play a round of each match.

    Args:
        allies, opponents: players as ``as_team_player`` takes them: one in all seats, or one for each seat.
        scenario: the rules of the game.
        team: the rules of teams.
        matches: number of matches, G.
        seeds: those of the matches; None: the first evaluation seeds.
        on_step: called with the games at the start and after each step.

    Raises:
        UserError: an unknown player, or not as many as seats.
    """
    batch = TeamBatch(scenario, team, matches)
    runners = {
        side: TeamRunner(
            side, [as_team_player(one, side, scenario, team) for one in players], batch, len(players) > 1
        )
        for side, players in (("ally", allies), ("opponent", opponents))
    }
    batch.reset(seeds=evaluation_seeds(matches) if seeds is None else seeds)
    for runner in runners.values():
        runner.begin(np.ones(matches, bool))
    on_step(batch)
    present, n = batch.playing("ally"), batch.counts[:, 0]
    totals, clashes, spreading, checks, heard = np.zeros(matches), 0.0, 0.0, 0, 0
    steps = scenario.steps_per_round
    for _ in range(steps):
        actions = {"opponent": runners["opponent"].act()}
        batch.step(runners["ally"].act(actions), actions["opponent"])
        on_step(batch)
        totals += batch.allies["ally_reward"].sum(axis=1) / n
        clashes += _clashes(batch.allies, present)
        spreading += (batch.allies["spreading"].sum(axis=1) / n).mean()
        checks += batch.allies["checked"][:, 0].sum()
        heard += (batch.allies["last_check"] * batch.allies["checked"] == 1).any(axis=1).sum()
    return TeamMatches(totals / steps, clashes / steps, spreading / steps, heard / max(checks, 1))


def _clashes(allies: np.ndarray, present: np.ndarray) -> float:
    """Return the mean number of allies ``(G, N)`` on the unspread point of an ally of an earlier seat."""
    unspread, clashes = present & ~allies["spreading"], np.zeros(allies.shape, bool)
    for seat in range(1, allies.shape[1]):
        alike = (allies["point"][:, :seat] == allies["point"][:, seat : seat + 1]) & unspread[:, :seat]
        clashes[:, seat] = alike.any(axis=1) & unspread[:, seat]
    return float(clashes.sum(axis=1).mean())
