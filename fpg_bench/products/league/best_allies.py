"""Worth of hopping in a scenario: the best ally that hops against the best one that does not."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fpg_bench.cli.options import print_json, print_wrapped
from fpg_bench.common.ids import SCRIPTS
from fpg_bench.common.output import print_line, shown_progress
from fpg_bench.evaluation.play import SeedSource
from fpg_bench.evaluation.seeds import evaluation_seeds, tuning_seeds
from fpg_bench.evaluation.statistics import MATCHES, Interval, difference, mean_interval
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario
from fpg_bench.players.player import Player
from fpg_bench.players.registry import as_player
from fpg_bench.products.league.candidates import Candidates
from fpg_bench.products.league.evaluation import evaluate_against
from fpg_bench.products.league.rule_search import RuleSearch, rule_of
from fpg_bench.products.league.rules import describe_rule, rule_graph, rule_values

GENERATIONS = 16  # of a search
TRIED, MEASURED = 32, 100  # rounds against each jammer, to choose the best and to measure it
DONE = {"hops": "hop_rate", "spreads": "spread_ratio"}  # the measure of what a player does
# Numbers that say when a rule hops, and where.
HOPS = (
    *(f"{name}_hits" for name in JAMMING_TYPES),
    "drawn",
    "forget_s",
    "pause_s",
    "below_db",
    "hop_every_s",
)


class Best(NamedTuple):
    """The best ally of those that do the same.

    Attributes:
        does: ``hops``, ``spreads``, ``hops and spreads`` or ``stays``.
        player: a script, or a rule in words.
        earned: ``(rounds,)``, per step, the mean over all jammers.
    """

    does: str
    player: str
    earned: np.ndarray


def best_allies(scenario: Scenario, jammers: Sequence[str] = SCRIPTS["opponent"]) -> list[Best]:
    """Return the best allies by what they do, best first: scripts, and rules searched for these jammers.

    One rule is free, one never hops. The best are chosen in other rounds than those that measure them.
    """
    scenario = dataclasses.replace(scenario, rounds_per_match=1)
    rivals = [as_player(name, "opponent", scenario) for name in jammers]
    players: dict[str, str | Player] = {name: name for name in SCRIPTS["ally"]}
    with shown_progress() as show:
        for done, off in enumerate(((), HOPS)):
            search = RuleSearch("ally", rivals, scenario, off=off)
            for k in range(GENERATIONS):
                show("generations", done * GENERATIONS + k, 2 * GENERATIONS)
                search.run()
            words = describe_rule("ally", rule_of("ally", search.best))
            values = rule_values("ally", search.best[None], scenario)
            players[f"rule: {words}"] = Candidates(rule_graph("ally", scenario), values)

    def play(player: str, matches: int, seeds: SeedSource) -> Best:
        against = {name: name for name in jammers}
        of = evaluate_against(players[player], against, "ally", scenario, matches, seeds)
        does = " and ".join(verb for verb, measure in DONE.items() if of.measures[measure])
        return Best(does or "stays", player, of.rewards.mean(axis=(0, 1)))

    tried = sorted((play(player, TRIED, tuning_seeds) for player in players), key=_mean)
    best = {does: player for does, player, _ in tried}  # the last one of each
    measured = [play(player, MEASURED, evaluation_seeds)._replace(does=does) for does, player in best.items()]
    return sorted(measured, key=_mean, reverse=True)


def _mean(best: Best) -> float:
    return float(best.earned.mean())


def worth_of_hopping(best: Sequence[Best]) -> Interval:
    """Return what the best ally that hops earns more per step than the best one that does not."""
    hopping, other = (next(each for each in best if ("hops" in each.does) == hops) for hops in (True, False))
    return difference(hopping.earned[None], other.earned[None])


def show_worth_of_hopping(scenario: Scenario, as_json: bool) -> None:
    """Print the best allies of a scenario, and in a sentence whether hopping pays."""
    best = best_allies(scenario)
    more = worth_of_hopping(best)
    rows = [(does, player, mean_interval(earned, MATCHES)) for does, player, earned in best]
    if as_json:
        rows.append(("worth of hopping", "", more))
        print_json({"does": does, "player": player, **vars(interval)} for does, player, interval in rows)
        return
    print_line("\nDoes hopping pay? The best allies against all scripted jammers, reward per step:")
    for does, player, of in rows:
        print_wrapped(f"{does}: {of.value:.2f} [{of.low:.2f}, {of.high:.2f}], {player}")
    verb = "pays" if more.low > 0 else "does not pay" if more.high < 0 else "makes no difference"
    gain = f"{more.value:+.2f} [{more.low:+.2f}, {more.high:+.2f}]"
    print_wrapped(f"Hopping {verb}: {gain} per step for the best that hops over the best that does not.")
