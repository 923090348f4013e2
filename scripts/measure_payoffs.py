"""Measure who earns what from whom in a scenario, and what each choice of an agent is worth.

python scripts/measure_payoffs.py [--matches 100] [--page docs/results/link.md]

Pay-offs: scripts, the zoo's agents and the champions of the scenario meet in pursuit. The equilibrium is that
of the zero-sum game whose pay-off is the ally's reward per step. Levers: the zoo's best agents among the
unseen play their public suite with one of their choices replaced by a constant. All on evaluation seeds. The
equilibrium and the levers are put into the page between their marks; the pay-offs are a CSV file beside it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from command import run
from lineage import fill

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole
from fpg_bench.common.ids import SCRIPTS
from fpg_bench.common.output import csv_text
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.store import Store, pairings
from fpg_bench.evaluation.suite import Rival, Suite, load_suite
from fpg_bench.evaluation.summary import summarise
from fpg_bench.evaluation.table import markdown_table
from fpg_bench.game.actions import (
    HOP_GATE,
    IN_BAND_GATE,
    KNOWLEDGE_GATE,
    PREFERENCE,
    SPEED,
    SPREAD_GATE,
    TUNING,
    TYPE_SCORES,
)
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario, preset
from fpg_bench.game.state import TYPES
from fpg_bench.players.agent import baselines_folder
from fpg_bench.players.player import SIDES, Memory, Player, PlayerSpec
from fpg_bench.players.registry import as_player
from fpg_bench.players.seeded import Batched
from fpg_bench.products.league.payoffs import Payoffs
from fpg_bench.products.zoo.zoo import load_zoo

SCENARIO = "link"
LEAST_SHARE = 0.01  # of a player that the table of the equilibrium names
Values = dict[int, float]  # of the nine floats, by their index


@dataclass(frozen=True)
class Lever:
    """One choice of a side, and the constants that may replace it."""

    side: str
    name: str
    constants: Mapping[str, Values]


def _one_type(kind: int) -> Values:
    return {TYPE_SCORES + index: 1.0 if index == kind else -1.0 for index in range(TYPES)}


def levers(scenario: Scenario) -> list[Lever]:
    """Return the levers of both sides in pursuit."""
    places = np.linspace(-1, 1, scenario.frequency_points)
    points = {
        f"point {k}": {PREFERENCE: float(place), KNOWLEDGE_GATE: -1.0} for k, place in enumerate(places)
    }
    in_band = {f"point {k}": {TUNING: float(place), IN_BAND_GATE: 1.0} for k, place in enumerate(places)}
    return [
        Lever("ally", "hopping", {"never": {HOP_GATE: -1.0}, "always": {HOP_GATE: 1.0}}),
        Lever("ally", "spreading", {"never": {SPREAD_GATE: -1.0}, "always": {SPREAD_GATE: 1.0}}),
        Lever("ally", "speed", {"least": {SPEED: -1.0}, "mean": {SPEED: 0.0}, "full": {SPEED: 1.0}}),
        Lever("ally", "point", {"by the knowledge base": {KNOWLEDGE_GATE: 1.0}, **points}),
        Lever("ally", "knowledge base", {"never": {KNOWLEDGE_GATE: -1.0}}),
        Lever("opponent", "type", {name: _one_type(kind) for kind, name in enumerate(JAMMING_TYPES)}),
        Lever("opponent", "tuning", {"known frequency": {TUNING: 0.0, IN_BAND_GATE: -1.0}, **in_band}),
    ]


class Frozen(Batched):
    """Player whose actions have some of their nine floats replaced."""

    def __init__(self, player: Player, values: Values) -> None:
        self._player, self._values = player, values
        self.reset = getattr(player, "reset", lambda mask, seeds: None)

    def _answer(
        self, seen: np.ndarray, state: Memory, starts: np.ndarray | None
    ) -> tuple[np.ndarray, Memory]:
        actions, state = self._player.predict(seen, state, starts)
        for index, value in self._values.items():
            actions[:, index] = value
        return actions, state


def mean_reward(player: PlayerSpec, suite: Suite) -> float:
    """Return the mean reward per step of a player over the rivals of a suite."""
    return float(np.mean([_reward(player, suite, rival) for rival in suite.rivals]))


def _reward(player: PlayerSpec, suite: Suite, rival: Rival) -> float:
    record = play(player_entry(player, "player"), suite, rival)
    return float(suite.rewards(record.returns).mean())


def measure(
    scenario: Scenario, allies: Mapping[str, str], opponents: Mapping[str, str], matches: int, store: Store
) -> Payoffs:
    """Return the pay-offs of allies against opponents in pursuit, of players by their labels."""
    rivals = [Rival(label, (name,), scenario) for label, name in opponents.items()]
    suites = [Suite("payoffs", "ally", scenario, matches, (rival,)) for rival in rivals]
    players = {
        label: name if name in SCRIPTS["ally"] else as_player(name, "ally", scenario)
        for label, name in allies.items()
    }
    entries = [player_entry(player, label) for label, player in players.items()]
    wanted = [pairing for suite in suites for pairing in pairings(entries, suite)]
    store.fill(wanted)
    return Payoffs.of(store, wanted)


def answers_note(payoffs: Payoffs) -> str:
    """Return a sentence on who is the best answer to how many single rivals, and what they earn there."""
    best = payoffs.values.argmax(axis=0)
    counts = Counter(payoffs.players[row] for row in best).most_common()
    first = counts[0][0]
    worst, least = payoffs.worst(first)
    return (
        f"Best answers to the {len(best)} opponents: "
        f"{', '.join(f'{name} to {count}' for name, count in counts)}. "
        f"{first} earns least from {worst}: {least.value:.2f}."
    )


def equilibrium_note(payoffs: Payoffs) -> str:
    """Return sentences on the equilibrium of pay-offs."""
    equilibrium = payoffs.equilibrium()
    shares = [
        ", ".join(f"{name} {share:.2f}" for name, share in mixture.items() if share > LEAST_SHARE)
        for mixture in (equilibrium.players, equilibrium.rivals)
    ]
    worth = f"worth {equilibrium.value:z.2f} to the ally"
    return f"equilibrium {worth}. Allies: {shares[0]}. Opponents: {shares[1]}."


def lever_table(
    scenario: Scenario, suites: Mapping[str, Suite], agents: Mapping[str, Sequence[str]]
) -> list[list[str]]:
    """Return the reward of each side's agents with one lever frozen, as lines of cells below headings.

    The cost is the share of the distance between the random player and the agents that is lost.
    """
    lines = [["side", "frozen", "best constant", "reward per step", "cost"]]
    for side, suite in suites.items():

        def reward(values: Values, side: str = side, suite: Suite = suite) -> float:
            frozen = [Frozen(as_player(agent, side, scenario), values) for agent in agents[side]]
            return float(np.mean([mean_reward(player, suite) for player in frozen]))

        free, zero = reward({}), mean_reward("random", suite)
        lines.append([side, "nothing", "", f"{free:.2f}", ""])
        for lever in (one for one in levers(scenario) if one.side == side):
            rewards = {name: reward(values) for name, values in lever.constants.items()}
            best = max(rewards, key=rewards.__getitem__)
            cost = (free - rewards[best]) / (free - zero)
            lines.append([side, lever.name, best, f"{rewards[best]:.2f}", f"{cost:.1%}"])
    return lines


def agents_of(side: str, groups: str) -> list[str]:
    """Return the shipped agents of the zoo's groups of a side whose names match ``groups``."""
    return [
        member.name
        for member in load_zoo().members()
        if member.shipped and member.group.side == side and re.fullmatch(groups, member.group.name)
    ]


def groups_of(side: str, scenario: str) -> str:
    """Return a pattern of the names of a side's groups that trained in a scenario."""
    return f"{side}-{scenario}(-population|-strangers)?"


def champions_of(side: str, scenario: str) -> list[str]:
    """Return the first training seeds of a side's champions of a scenario."""
    agents = baselines_folder() / "agents"
    folders = sorted(agents.glob(f"{side}-{scenario}-champion*/*/seed_0"))
    return [folder.relative_to(agents).as_posix() for folder in folders]


def best_agents(side: str, groups: str) -> list[str]:
    """Return the zoo's best agents of a side, all training seeds of one algorithm, among groups of a name.

    The best have the highest mean score on the last suite of their group, whose rivals nobody trained with.

    Raises:
        UserError: none has records of that suite.
    """
    zoo, scores = load_zoo(), {}
    for group in zoo.groups:
        if group.side == side and re.fullmatch(groups, group.name):
            suite = load_suite(group.suites[-1])
            for summary in summarise(zoo.read_records(group, suite), suite):
                if summary.trained:
                    scores[f"{group.name}/{summary.entry}"] = summary.score.value
    if not scores:
        raise UserError(f"zoo: no {side} of {groups} has records of its last suite; train_zoo.py --tables")
    return [agent.name for agent in zoo.members(max(scores, key=scores.__getitem__)) if agent.shipped]


def main(
    matches: int = 100,
    ally: list[str] = [],  # noqa: B006
    opponent: list[str] = [],  # noqa: B006
    store: Path | None = None,
    page: Path | None = None,
) -> None:
    """Print the tables, and put them into a page.

    ``LABEL=FOLDER`` is one more ally or opponent of the pay-offs, a best response for instance; a store keeps
    the records of the pay-offs, which are not played again.
    """
    scenario = preset(SCENARIO)
    suites = {side: replace(load_suite(f"{side}-{SCENARIO}-v1"), matches=matches) for side in SIDES}
    groups = {side: groups_of(side, SCENARIO) for side in SIDES}
    own = {side: agents_of(side, groups[side]) for side in SIDES}
    first = {side: [name for name in own[side] if name.endswith("seed_0")] for side in SIDES}
    best = {side: best_agents(side, groups[side]) for side in SIDES}
    names = " and ".join(f"`{agents[0].rpartition('/')[0]}`" for agents in best.values())
    champions = {side: champions_of(side, SCENARIO) for side in SIDES}
    shipped = [{name: name for name in (*SCRIPTS[side], *first[side], *champions[side])} for side in SIDES]
    added = [dict(word.split("=", 1) for word in words) for words in (ally, opponent)]
    games = {"Shipped players": shipped}
    if any(added):
        games["With those that learned to beat them"] = [a | b for a, b in zip(shipped, added, strict=True)]
    notes, kept = [], Store(store)
    for title, players in games.items():
        payoffs = measure(scenario, *players, matches, kept)
        notes.append(f"{title}: {equilibrium_note(payoffs)} {answers_note(payoffs)}")
    earned = [
        [name, *(f"{value:.2f}" for value in row)]
        for name, row in zip(payoffs.players, payoffs.values, strict=True)
    ]
    tables = {
        "equilibrium": "\n\n".join(notes),
        "levers": f"The agents are {names}.\n\n{markdown_table(lever_table(scenario, suites, best))}",
    }
    text = csv_text([["ally \\ opponent", *payoffs.rivals], *earned])
    print(*(f"{title}\n\n{of}\n" for title, of in {**tables, "payoffs": text}.items()), sep="\n")
    if page:
        write_whole(page.with_name(f"{page.stem}-payoffs.csv"), text)
        fill(page, tables)


if __name__ == "__main__":
    run(main)
