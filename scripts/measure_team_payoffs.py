"""Measure who earns what from whom between teams, and what clones earn that choose alike.

python scripts/measure_team_payoffs.py [--matches 100] [--page docs/results/teams.md]

Pay-offs: scripts of teams meet in convoy, three allies against two jammers and, as contrasts, with the whole
power in each beam and against one jammer. Bounds know more than allies may, so the equilibrium is without
them. Clones: an agent of the duel in all three seats, in convoy and on curves of their own. All on evaluation
seeds. The first table is put into the page between its marks; a CSV beside it has all pairs.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from command import run
from lineage import fill
from measure_payoffs import answers_note, equilibrium_note

from fpg_bench.common.files import write_whole
from fpg_bench.common.output import csv_text
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.evaluation.statistics import MATCHES, mean_interval
from fpg_bench.evaluation.table import markdown_table
from fpg_bench.game.scenario import preset
from fpg_bench.players.player import SIDES, PlayerSpec
from fpg_bench.products.league.payoffs import Payoffs
from fpg_bench.products.teams.batch import TeamBatch
from fpg_bench.products.teams.match import play_teams
from fpg_bench.products.teams.rules import TEAM_SCRIPTS, TeamRules
from fpg_bench.products.teams.scripts import BOUNDS

GAMES = {
    "3 v 2": TeamRules(),
    "whole power": TeamRules(share_power=False),
    "3 v 1": TeamRules(jammers=1),
    "separate": TeamRules(formation="separate"),
}
ON_PAGE = "3 v 2"
CLONES = [f"ally-link{kind}/ppo-stack8/seed_0" for kind in ("-population", "")]
BESIDE = ["random-hops", "greedy-own-points"]  # scripts that play like clones
COUNTS = ("clashes", "spreading", "heard")
KEY = ("game", *SIDES, "matches")


class Results:
    """Results of pairs, which are played once and kept in a file.

    Args:
        path: the file of rows; it need not exist. An agent that has changed needs a new one.
        matches: rounds of each pair.
    """

    def __init__(self, path: Path, matches: int) -> None:
        self._file, self._matches = RowFile(path), matches
        self._rows = {tuple(row[name] for name in KEY): row for row in self._file.read()}

    def of(self, game: str, ally: str, opponent: str, player: PlayerSpec | None = None) -> Row:
        """Return rewards and counts in a game of ``GAMES``; ``player`` plays as ``ally``, if given."""
        key, counts = (game, ally, opponent, self._matches), Counts()
        if key not in self._rows:
            args = [player or ally], [opponent], preset("link"), GAMES[game], self._matches
            rewards = play_teams(*args, on_step=counts.count)
            row = dict(zip(KEY, key, strict=True)) | counts.means() | {"rewards": rewards.tolist()}
            self._file.append([row])
            self._rows[key] = row
            print(f"{game}: {ally} against {opponent}: {rewards.mean():.2f}", flush=True)
        return self._rows[key]

    def payoffs(self, game: str, allies: Mapping[str, str], opponents: Mapping[str, str]) -> Payoffs:
        """Return the pay-offs of players by their labels."""
        samples = tuple(
            np.array([self.of(game, ally, name)["rewards"] for name in opponents.values()]).T[None]
            for ally in allies.values()
        )
        return Payoffs(tuple(allies), tuple(opponents), samples)

    def csv(self, labels: Mapping[str, str]) -> str:
        """Return all pairs, players by their labels, with half of the 95 % interval of each reward."""
        lines = [["game", *SIDES, "reward", "half", *COUNTS]]
        for _, row in sorted(self._rows.items()):
            if row["matches"] == self._matches and {row["ally"], row["opponent"]} <= set(labels):
                reward = mean_interval(np.array(row["rewards"]), MATCHES)
                values = (reward.value, reward.half, *(row[name] for name in COUNTS))
                pair = labels[row["ally"]], labels[row["opponent"]]
                lines.append([row["game"], *pair, *(f"{value:.3f}" for value in values)])
        return csv_text(lines)


class Counts:
    """Counts of the steps of a batch of teams.

    Clashes are allies on the unspread point of an earlier seat, spreading is a share of the allies, and heard
    the share of steps with a check in which jammers found an ally.
    """

    def __init__(self) -> None:
        self._steps, self._sums, self._checks = -1, dict.fromkeys(COUNTS, 0.0), 0  # from the start on

    def count(self, batch: TeamBatch) -> None:
        """Count a step; the first call is at the start."""
        self._steps += 1
        if not self._steps:
            return
        allies = batch.allies
        unspread, clashes = batch.playing("ally") & ~allies["spreading"], np.zeros(allies.shape, bool)
        for seat in range(1, allies.shape[1]):
            alike = (allies["point"][:, :seat] == allies["point"][:, seat : seat + 1]) & unspread[:, :seat]
            clashes[:, seat] = alike.any(axis=1) & unspread[:, seat]
        self._checks += allies["checked"][:, 0].sum()
        self._sums["clashes"] += float(clashes.sum(axis=1).mean())
        self._sums["spreading"] += (allies["spreading"].sum(axis=1) / batch.counts[:, 0]).mean()
        self._sums["heard"] += (allies["last_check"] * allies["checked"] == 1).any(axis=1).sum()

    def means(self) -> dict[str, float]:
        """Return the means by name."""
        over = {"heard": max(self._checks, 1)}
        return {name: float(total / over.get(name, self._steps)) for name, total in self._sums.items()}


def payoff_table(payoffs: Payoffs) -> str:
    """Return the rewards of allies against each jammer, the worst and the mean."""
    lines = [["allies", *payoffs.rivals, "worst", "mean"]]
    for name, row in zip(payoffs.players, payoffs.values, strict=True):
        label = f"{name} (full state)" if name in BOUNDS else name
        lines.append([label, *(f"{value:.2f}" for value in (*row, row.min(), row.mean()))])
    return markdown_table(lines)


def without_bounds(payoffs: Payoffs) -> Payoffs:
    """Return the pay-offs of players that know what an ally may."""
    kept = [k for k, name in enumerate(payoffs.players) if name not in BOUNDS]
    players, samples = (tuple(of[k] for k in kept) for of in (payoffs.players, payoffs.samples))
    return Payoffs(players, payoffs.rivals, samples)


def main(
    matches: int = 100,
    ally: list[str] = [],  # noqa: B006
    opponent: list[str] = [],  # noqa: B006
    rows: Path = Path("runs/team-payoffs.jsonl"),
    page: Path | None = None,
) -> None:
    """Print the tables, and put the first into a page.

    ``LABEL=FOLDER`` is one more ally or opponent, a trained agent for instance; pairs in the file of rows are
    not played again.
    """
    results, parts = Results(rows, matches), {}
    players = {side: {name: name for name in TEAM_SCRIPTS[side]} for side in SIDES}
    players["ally"] |= {name: name for name in BOUNDS}
    words = {"ally": ally, "opponent": opponent}
    added = {side: dict(word.split("=", 1) for word in words[side]) for side in SIDES}
    alike = {name: name for name in (*CLONES, *BESIDE)}
    labels = alike | {spec: label for side in SIDES for label, spec in (players[side] | added[side]).items()}
    for game in (ON_PAGE, "whole power", "3 v 1"):
        scripts = without_bounds(results.payoffs(game, *players.values()))
        every = results.payoffs(game, *(players[side] | added[side] for side in SIDES))
        notes = [f"Scripts: {equilibrium_note(scripts)} {answers_note(scripts)}"]
        if any(added.values()):
            every_note = without_bounds(every)
            notes.append(
                f"With those that learned: {equilibrium_note(every_note)} {answers_note(every_note)}"
            )
        parts[game] = "\n\n".join([payoff_table(every), *notes])
    for game in (ON_PAGE, "separate"):
        results.payoffs(game, alike, players["opponent"])
    print(*(f"\n{title}\n\n{text}" for title, text in parts.items()), sep="\n")
    if page:
        write_whole(page.with_name(f"{page.stem}-payoffs.csv"), results.csv(labels))
        fill(page, {ON_PAGE: parts[ON_PAGE]})  # the file beside it has all games


if __name__ == "__main__":
    run(main)
