"""Matches of two teams on evaluation seeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fpg_bench.evaluation.rounds import MatchBatch
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.evaluation.suite import Rival, Suite
from fpg_bench.game.batch import Seeds
from fpg_bench.game.metrics import GREATEST
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.state import TALLY
from fpg_bench.players.player import PlayerSpec
from fpg_bench.products.teams.batch import TeamBatch
from fpg_bench.products.teams.rules import SIDES, TeamRules
from fpg_bench.products.teams.runner import TeamRunner
from fpg_bench.products.teams.scripts import as_team_player


class TeamDuel:
    """Games of two teams in the place of a batch of duels: each team is summed up as a side.

    Args:
        scenario: the rules of the game.
        team: the rules of teams.
        count: number of games, G.
    """

    plans = ()

    def __init__(self, scenario: Scenario, team: TeamRules, count: int) -> None:
        self.teams, self.scenario, self.count = TeamBatch(scenario, team, count), scenario, count
        self.games, self.step, self.clean_sum = self.teams.games, self.teams.step, self.teams.clean_sum

    @property
    def batch(self) -> TeamDuel:
        """The games themselves."""
        return self

    def reset(self, mask: np.ndarray | None = None, seeds: Seeds | None = None) -> np.ndarray:
        """Begin rounds in the masked games; returns the mask."""
        mask = np.ones(self.count, bool) if mask is None else mask
        self.teams.reset(mask, seeds)
        return mask

    @property
    def tallies(self) -> np.ndarray:
        """``(G,)`` records of dtype ``state.TALLY``: sums over the allies, and means of the returns."""
        sums = np.zeros(self.count, TALLY)
        for name in TALLY.names or ():
            of_ally = self.teams.tallies[name]
            sums[name] = of_ally.max(axis=1) if name == GREATEST else of_ally.sum(axis=1)
            if name.endswith("_return"):
                sums[name] /= self.teams.counts[:, 0]
        return sums

    @property
    def histograms(self) -> np.ndarray:
        """``(G, 2, points)``, sums over the allies."""
        sums: np.ndarray = self.teams.histograms.sum(axis=1)
        return sums


def two_teams(
    allies: Sequence[PlayerSpec],
    opponents: Sequence[PlayerSpec],
    scenario: Scenario,
    team: TeamRules,
    count: int,
    is_by_seat: Sequence[bool],
) -> tuple[TeamDuel, TeamRunner, TeamRunner]:
    """Make a batch of games, and the policies of both teams.

    Args:
        allies, opponents: players as ``as_team_player`` takes them.
        scenario: the rules of the game.
        team: the rules of teams.
        count: number of games.
        is_by_seat: of each side, whether player k plays seat k; else each game draws one for all seats.

    Raises:
        UserError: an unknown player, or not as many as seats.
    """
    duel = TeamDuel(scenario, team, count)
    runners = []
    for side, specs, by_seat in zip(SIDES, (allies, opponents), is_by_seat, strict=True):
        players = [as_team_player(spec, side, scenario, team) for spec in specs]
        runners.append(TeamRunner(side, players, duel.teams, by_seat))
    return duel, runners[0], runners[1]


def suite_match(player: PlayerSpec, suite: Suite, rival: Rival, count: int) -> MatchBatch:
    """Make the games in which a suite's entry meets a rival, in all seats or, beside mates, in the first."""
    assert isinstance(suite.game, TeamRules)
    sides = [[player, *rival.mates], rival.players]
    by_seat = [bool(rival.mates), False]
    order = slice(None, None, 1 if suite.side == "ally" else -1)
    match = two_teams(*sides[order], rival.scenario, suite.game, count, by_seat[order])
    return MatchBatch(*match)


def play_teams(
    allies: Sequence[PlayerSpec],
    opponents: Sequence[PlayerSpec],
    scenario: Scenario,
    team: TeamRules,
    matches: int,
    seeds: Seeds | None = None,
    on_step: Callable[[TeamBatch], None] = lambda batch: None,
) -> np.ndarray:
    """Play a round of each match, and return ``(G,)`` float64, the mean reward of an ally per step.

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
    by_seat = [len(players) > 1 for players in (allies, opponents)]
    duel, ally, opponent = two_teams(allies, opponents, scenario, team, matches, by_seat)
    batch = duel.teams
    duel.reset(seeds=evaluation_seeds(matches) if seeds is None else seeds)
    for runner in (ally, opponent):
        runner.begin(np.ones(matches, bool))
    on_step(batch)
    totals = np.zeros(matches)
    for _ in range(scenario.steps_per_round):
        actions = {"opponent": opponent.act()}
        batch.step(ally.act(actions), actions["opponent"])
        on_step(batch)
        totals += batch.allies["ally_reward"].sum(axis=1) / batch.counts[:, 0]
    return totals / scenario.steps_per_round
