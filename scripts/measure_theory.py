"""Measure the players of theory: ``python scripts/measure_theory.py docs/reference/theory.md``.

Their scores on public suites, and what the range rule keeps whatever the jammer does. The page gets both
between its marks.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from command import run
from lineage import fill

from fpg_bench.common.ids import NAMED
from fpg_bench.common.output import number
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.evaluation.statistics import MATCHES, mean_interval
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import Summary, summary_of
from fpg_bench.evaluation.table import bounds, markdown_table
from fpg_bench.game.compiling import compiled
from fpg_bench.game.flight import distance_m
from fpg_bench.game.link import transmit
from fpg_bench.game.rewards import reward
from fpg_bench.game.rules import radio_record, rules_record
from fpg_bench.game.scenario import Scenario, preset
from fpg_bench.game.state import TYPES
from fpg_bench.players.registry import as_player

BLIND = "hunter(type=0, hold_s=1)"  # a tone on an ally just found, else broadband on a random half
SCORED = {
    "opponent scores": ("opponent-link-v1", ("adaptive", "watchful", BLIND, "bayes", "oracle")),
    "ally scores": ("ally-link-v1", ("by-type", "clock", "evidence", "range", "belief", "oracle")),
    "standard scores": ("ally-v2", ("expert-spread", "sulk", "by-type", "range", "belief", "oracle")),
}
MET = ("ally-link-population/ppo-stack8/seed_0", "ally-link-champion/ppo-stack8/seed_0", "range", "belief")


@compiled
def fill_least(
    least: np.ndarray,
    games: np.ndarray,
    centres: np.ndarray,
    rules_array: np.ndarray,
    radio_array: np.ndarray,
) -> None:
    """Fill what the ally would have earned in the step just played under the worst of all jammings.

    ``games`` are copies; their jamming changes.
    """
    rules, radio = rules_array[0], radio_array[0]
    for i in range(games.shape[0]):
        game = games[i]
        costs = game.airtime * game.ally_value - game.ally_reward
        to_base_m = distance_m(game.ally_position, rules.base_station)
        game.next_check = game.step + 1 if game.checked else -1
        worst = game.ally_value
        for kind in range(TYPES):
            for centre in centres:
                game.jamming_type, game.jamming_mhz = kind, centre
                transmit(game, to_base_m, rules, radio)
                reward(game, 0.0, rules, radio)
                worst = min(worst, game.ally_value)
        least[i] += game.airtime * worst - costs


def guaranteed(ally: str, scenario: Scenario, matches: int) -> np.ndarray:
    """Return ``(matches,)``, what an ally keeps per step under the worst jamming of each second.

    That bounds all jammers in pursuit if the ally's actions depend on positions alone, as the rule's do.
    """
    match = make_match(TwoPlayerBatch(scenario, matches, threads=1), ally, "tone")
    rules, radio, batch = rules_record(scenario), radio_record(scenario), match.duel.batch
    assert radio is not None
    centres = np.linspace(scenario.band_low_mhz, scenario.band_high_mhz, 4 * scenario.frequency_points - 3)
    least = np.zeros(matches)
    play_round(
        match,
        seeds=evaluation_seeds(matches),
        on_step=lambda: fill_least(least, batch.games.copy(), centres, rules, radio),
    )
    return least / scenario.steps_per_round


def scores(suite_name: str, players: Sequence[str]) -> list[Summary]:
    """Return the summaries of players on a public suite."""
    suite, found = load_suite(suite_name), []
    for name in players:
        named = name in NAMED[suite.side] or name == "oracle"
        entry = player_entry(name if named else as_player(name, suite.side, suite.scenario), name)
        found.append(summary_of([play(entry, suite, rival) for rival in suite.rivals], suite))
    return found


def score_table(summaries: Sequence[Summary]) -> str:
    """Return the scores as Markdown."""
    lines = [["player", "score", "95 %", "lowest return per step", "against"]]
    for of in summaries:
        lowest = number(of.by_rival[of.worst].value, digits=2)
        lines.append([f"`{of.entry}`", number(of.score.value), bounds(of.score), lowest, of.worst])
    return markdown_table(lines)


def kept_table(scenario: Scenario, matches: int) -> str:
    """Return what allies keep against jammers of theory, and the rule against all, as Markdown."""
    lines = [["ally", *(f"`{name}`" for name in ("bayes", BLIND, "oracle")), "any jammer in pursuit"]]
    for ally in MET:
        cells = []
        for jammer in ("bayes", BLIND, "oracle"):
            match = make_match(TwoPlayerBatch(scenario, matches, threads=1), ally, jammer)
            play_round(match, seeds=evaluation_seeds(matches))
            tallies = match.duel.batch.tallies
            cells.append(f"{(tallies['ally_return'] / tallies['steps']).mean():.2f}")
        least = "-"
        if ally == "range":
            interval = mean_interval(guaranteed(ally, scenario, matches), MATCHES)
            least = f"at least {interval.value:.2f} [{interval.low:.2f}, {interval.high:.2f}]"
        lines.append([f"`{ally.removesuffix('/ppo-stack8/seed_0')}`", *cells, least])
    return markdown_table(lines)


def main(page: Path, matches: int = 100) -> None:
    """Measure, and fill the page."""
    found = {title: scores(suite, players) for title, (suite, players) in SCORED.items()}
    parts = {
        "kept": kept_table(preset("link"), matches),
        **{title: score_table(summaries) for title, summaries in found.items()},
    }
    for title, text in parts.items():
        print(f"\n{title}\n\n{text}", flush=True)
    fill(page, parts)


if __name__ == "__main__":
    run(main)
