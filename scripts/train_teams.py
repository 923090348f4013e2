"""Train teams, and measure whether allies need to know of each other and whether jammers learn.

python scripts/train_teams.py [--seeds 5] [--page docs/results/teams.md]     run it again to resume

One policy plays all seats of a side (IPPO), three allies in convoy against two jammers. Allies learn against
the scripts of jammers at each level of what mates tell, jammers against the scripts of allies, and allies
once more against these jammers. Then allies of the first kind play with one of their choices replaced by a
constant. All are scored on evaluation seeds; the tables are put into the page between their marks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
from command import run
from lineage import fill
from measure_payoffs import Frozen, Values, levers
from measure_team_payoffs import Results

from fpg_bench.common.parallel import check_all_done, folder_job, run_jobs
from fpg_bench.evaluation.statistics import MATCHES, TRAINING_SEEDS, Interval, mean_interval
from fpg_bench.evaluation.table import markdown_table
from fpg_bench.game.scenario import preset
from fpg_bench.players.player import PlayerSpec
from fpg_bench.products.teams.rules import MATES, TEAM_SCRIPTS, TeamRules
from fpg_bench.products.teams.scripts import as_team_player
from fpg_bench.products.teams.spec import TeamSpec
from fpg_bench.training.config import RunConfig
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import train

ALGORITHM, STEPS = "ppo-stack4", 1_500_000
TEAM, SCENARIO = TeamRules(), preset("link")
ALLY_SCRIPTS = [name for name in TEAM_SCRIPTS["ally"] if name != "random-hops"]
NEEDED = ("none", "full")  # levels of what mates tell that meet trained jammers


class Teams:
    """Runs in a folder, and who earned what in ``rows.jsonl`` there.

    Args:
        folder: of the runs; it need not exist.
        seeds: number of training seeds.
        matches: rounds of each pair.
    """

    def __init__(self, folder: Path, seeds: int, matches: int) -> None:
        self.folder, self.seeds = folder, range(seeds)
        self._results = Results(folder / "rows.jsonl", matches)

    def agents(self, name: str) -> list[str]:
        """Return the agents of a group, a training seed each."""
        return [str(RunFolder(self.folder / name / f"seed_{seed}").agent) for seed in self.seeds]

    def train(self, groups: dict[str, dict[str, Any]], n_jobs: int) -> None:
        """Train what is missing of groups, given the options of their games."""
        jobs = []
        for name, options in groups.items():
            game = TeamSpec.of(actions="discrete", **options)
            for seed in self.seeds:
                folder = self.folder / name / f"seed_{seed}"
                run = RunConfig(ALGORITHM, game, seed, STEPS)
                make = partial(_train, run)
                jobs.append(folder_job(f"{name}/{seed}", folder, make, RunFolder(folder).is_finished))
        check_all_done(run_jobs(jobs, n_jobs))

    def rewards(self, ally: str, opponent: str, frozen: str = "", values: Values | None = None) -> np.ndarray:
        """Return the allies' mean reward per step in each match, ``(matches,)``, with some floats frozen."""
        label, player = ally, cast(PlayerSpec, ally)
        if values:
            label = f"{ally}, {frozen}"
            player = FrozenSeats(as_team_player(ally, "ally", SCENARIO, TEAM), values)
        return np.array(self._results.of("3 v 2", label, opponent, player)["rewards"])

    def over_seeds(
        self,
        seeds: Sequence[Sequence[tuple[str, str]]],
        of: Callable[[np.ndarray], float] = np.mean,
        **frozen: Any,
    ) -> Interval:
        """Return the interval over training seeds, each given by its pairs, of the mean or worst."""
        values = [of(np.array([self.rewards(*pair, **frozen).mean() for pair in pairs])) for pairs in seeds]
        return mean_interval(np.array(values), TRAINING_SEEDS)

    def over_matches(self, pairs: Sequence[tuple[str, str]]) -> Interval:
        """Return the interval over matches of the mean over pairs."""
        return mean_interval(np.mean([self.rewards(*pair) for pair in pairs], axis=0), MATCHES)


class FrozenSeats(Frozen):
    """A player of teams with some of its floats replaced."""

    sees = "team"

    def __init__(self, player: Any, values: Values) -> None:
        super().__init__(player, values)
        self.skills = getattr(player, "skills", None)


def _train(run: RunConfig, folder: Path) -> None:
    train(run, folder, evaluations=0, progress=False, resume=True)


def against(agents: Sequence[str], rivals: Sequence[str]) -> list[list[tuple[str, str]]]:
    """Return the pairs of each ally with all rivals."""
    return [[(agent, rival) for rival in rivals] for agent in agents]


def cells(interval: Interval) -> list[str]:
    """Return an interval's value and ends as two cells."""
    return [f"{interval.value:.2f}", f"[{interval.low:.2f}, {interval.high:.2f}]"]


def allies_table(teams: Teams, jammers: Sequence[str]) -> str:
    """Return what allies that learned at each level of ``mates`` earn, and the best scripts."""
    scripts = list(TEAM_SCRIPTS["opponent"])
    head = ["mates tell", "against scripts", "95 %", "worst", "against trained jammers", "95 %"]
    lines = [["allies", *head]]
    groups = [(mates, "", "trained on scripts") for mates in MATES]
    groups += [(mates, "-again", "trained on trained jammers, too") for mates in NEEDED]
    for mates, again, label in groups:
        agents = teams.agents(f"allies-{mates}{again}")
        mean = teams.over_seeds(against(agents, scripts))
        worst = teams.over_seeds(against(agents, scripts), np.min)
        met = teams.over_seeds(against(agents, jammers))
        lines.append([label, mates, *cells(mean), f"{worst.value:.2f}", *cells(met)])
    for name in ("greedy-own-points", "joint"):
        pairs = [(name, rival) for rival in scripts]
        worst = min(teams.rewards(*pair).mean() for pair in pairs)
        met = teams.over_matches([(name, rival) for rival in jammers])
        lines.append([f"`{name}`", "", *cells(teams.over_matches(pairs)), f"{worst:.2f}", *cells(met)])
    return markdown_table(lines)


def jammers_table(teams: Teams, jammers: Sequence[str]) -> str:
    """Return what jammers leave to the scripts of allies, and to each."""
    lines = [["jammers", "left to allies", "95 %", *ALLY_SCRIPTS]]
    trained = teams.over_seeds([[(ally, agent) for ally in ALLY_SCRIPTS] for agent in jammers])
    each = [np.mean([teams.rewards(ally, agent).mean() for agent in jammers]) for ally in ALLY_SCRIPTS]
    lines.append([f"trained, {len(jammers)} seeds", *cells(trained), *(f"{value:.2f}" for value in each)])
    scripts = {name: [(ally, name) for ally in ALLY_SCRIPTS] for name in TEAM_SCRIPTS["opponent"]}
    for name, pairs in sorted(scripts.items(), key=lambda item: teams.over_matches(item[1]).value):
        each = [teams.rewards(*pair).mean() for pair in pairs]
        lines.append([f"`{name}`", *cells(teams.over_matches(pairs)), *(f"{value:.2f}" for value in each)])
    return markdown_table(lines)


def levers_table(teams: Teams) -> str:
    """Return what trained allies lose against the scripts once one of their choices is a constant."""
    scripts, agents = list(TEAM_SCRIPTS["opponent"]), teams.agents("allies-full")
    free = teams.over_seeds(against(agents, scripts))
    zero = teams.over_matches([("random-hops", rival) for rival in scripts]).value
    lines = [["frozen", "best constant", "reward", "95 %", "cost"], ["nothing", "", *cells(free), ""]]
    for lever in (one for one in levers(SCENARIO) if one.side == "ally"):
        frozen = {
            name: teams.over_seeds(against(agents, scripts), frozen=f"{lever.name}: {name}", values=values)
            for name, values in lever.constants.items()
            if not name.startswith("point")
        }
        best = max(frozen, key=lambda name: frozen[name].value)
        cost = (free.value - frozen[best].value) / (free.value - zero)
        lines.append([lever.name, best, *cells(frozen[best]), f"{cost:.0%}"])
    return markdown_table(lines)


def main(
    seeds: int = 5,
    matches: int = 100,
    runs: Path = Path("runs/teams"),
    n_jobs: int = 1,
    page: Path | None = None,
) -> None:
    """Train, print the tables, and put them into a page."""
    teams = Teams(runs, seeds, matches)
    scripts = list(TEAM_SCRIPTS["opponent"])
    first: dict[str, dict[str, Any]] = {
        f"allies-{mates}": {"side": "ally", "mates": mates, "rivals": scripts} for mates in MATES
    }
    first["jammers"] = {"side": "opponent", "rivals": ALLY_SCRIPTS}
    teams.train(first, n_jobs)
    jammers = teams.agents("jammers")
    again = {
        f"allies-{mates}-again": {"side": "ally", "mates": mates, "rivals": [*scripts, *jammers]}
        for mates in NEEDED
    }
    teams.train(again, n_jobs)
    parts = {
        "learned allies": allies_table(teams, jammers),
        "learned jammers": jammers_table(teams, jammers),
        "levers": levers_table(teams),
    }
    print(*(f"\n{title}\n\n{text}" for title, text in parts.items()), sep="\n")
    if page:
        fill(page, parts)


if __name__ == "__main__":
    run(main)
