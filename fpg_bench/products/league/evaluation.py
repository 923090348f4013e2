"""Evaluation of a player against players that no suite names."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import SeedSource, play
from fpg_bench.evaluation.store import Store, pairings
from fpg_bench.evaluation.suite import Rival, Scale, Suite, side_suite
from fpg_bench.evaluation.summary import Summary, summary_of
from fpg_bench.game.scenario import Scenario
from fpg_bench.players.player import Player

MATCHES = 100  # against each player, in the evaluation of best responses


def evaluate_against(
    player: str | Player,
    others: Mapping[str, str],
    side: str,
    scenario: Scenario,
    matches: int,
    seeds: SeedSource | None = None,
) -> Summary:
    """Evaluate a player against players that no suite names.

    The scale of the scores is that of the side's public suite where the scenario is that suite's own, apart
    from the path.

    Args:
        player: the player, as :func:`fpg_bench.players.registry.as_player` takes it.
        others: players of the other side, by the names that the summary calls them.
        side: side of the player.
        scenario: the scenario that is played.
        matches: number of matches against each of the others.
        seeds: function from a number of matches to their seeds; None takes the evaluation seeds.

    Raises:
        UserError: no such player, or one of the wrong side.
    """
    public = side_suite(side, scenario)
    scale = public.scale if public.is_of(scenario) else Scale()
    rivals = tuple(Rival(name, (other,), scenario) for name, other in others.items())
    suite = Suite("league", side, scenario, matches, rivals, scale)
    records = Store().fill(pairings([player_entry(player)], suite), partial(play, seeds=seeds))
    return summary_of(records, suite)
