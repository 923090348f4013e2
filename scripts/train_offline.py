"""Train every offline algorithm on data sets of several behaviours, evaluate the agents, and write the table.

python scripts/train_offline.py [--seeds 0-4] [--datasets datasets]    run it again to go on
python scripts/train_offline.py --table      writes the table of docs/guides/offline.md alone

A row per agent goes to ``baselines/scores/offline/scores.jsonl`` as soon as it is evaluated.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from command import run
from lineage import fill

from fpg_bench.common.output import number
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.statistics import ENOUGH_SEEDS, mean_interval
from fpg_bench.evaluation.suite import Suite, load_suite, suite_of
from fpg_bench.evaluation.summary import summarise, summary_of
from fpg_bench.evaluation.table import bounds, markdown_table
from fpg_bench.players.agent import baselines_folder, load_agent
from fpg_bench.products.offline.make import make_dataset
from fpg_bench.products.offline.read import Dataset, open_dataset
from fpg_bench.products.offline.spec import load_spec
from fpg_bench.products.zoo.zoo import load_zoo
from fpg_bench.training.algorithms import OFFLINE, find_algorithm
from fpg_bench.training.config import RunConfig
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import parse_seeds, train

ROWS = baselines_folder() / "scores" / "offline" / "scores.jsonl"
PAGE = baselines_folder().parent / "docs" / "guides" / "offline.md"
BEHAVIOUR = "behaviour"
# Each data set, and the zoo's group that was trained online in the same game.
DATASETS = {
    "ally-random-v0": "ally-scripted",
    "ally-medium-v0": "ally-scripted",
    "ally-expert-v0": "ally-scripted",
    "ally-mixed-v0": "ally-scripted",
    "ally-discrete-mixed-v0": "ally-scripted-discrete",
    "opponent-mixed-v0": "opponent-pursuit",
}
TRANSITIONS = 300_000


def suite_for(name: str) -> Suite:
    """Return the suite that measures the agents of a data set."""
    spec = load_spec(name)
    return load_suite(suite_of(spec.game))


def missing(rows: RowFile, seeds: list[int]) -> list[tuple[str, str, int | None]]:
    """Return the data sets, algorithms and training seeds without a row; seeds are the outer loop."""
    done = {(row["dataset"], row["algorithm"], row["training_seed"]) for row in rows.read()}
    wanted: list[tuple[str, str, int | None]] = [(name, BEHAVIOUR, None) for name in DATASETS]
    for seed in seeds:
        for name in DATASETS:
            actions = load_spec(name).actions
            fitting = [word for word in OFFLINE if actions in find_algorithm(word).kind.modes]
            wanted += [(name, algorithm, seed) for algorithm in fitting]
    return [each for each in wanted if each not in done]


def behaviour_row(name: str) -> dict[str, Any]:
    """Return the row of a data set's own players: the mean of their scores."""
    spec, suite = load_spec(name), suite_for(name)
    entries = [player_entry(player, player, None) for player in spec.players]
    records = [play(entry, suite, rival) for entry in entries for rival in suite.rivals]
    scores = {summary.entry: summary.score.value for summary in summarise(records, suite)}
    return {"score": round(float(np.mean([scores[player] for player in spec.players])), 2)}


def agent_row(data: Dataset, algorithm: str, seed: int, steps: int | None, out: Path) -> dict[str, Any]:
    """Train and evaluate one agent, and return its row."""
    config = RunConfig.offline(algorithm, data, seed=seed, steps=steps)
    agent = train(config, out, evaluations=0, progress=False, resume=True)
    suite, entry = suite_for(data.spec.name), player_entry(load_agent(agent), algorithm, seed)
    summary = summary_of([play(entry, suite, rival) for rival in suite.rivals], suite)
    about = RunFolder(out).read()
    return {
        "score": round(summary.score.value, 2),
        "rivals": {name: round(reward.value, 3) for name, reward in summary.by_rival.items()},
        "steps": about.training_steps,
        "seconds": about.seconds,
        "content_sha256": data.sha256,
        "policy_sha256": entry.fingerprint,
    }


def score_table(rows: list[dict[str, Any]]) -> str:
    """Return the table of scores, a row per data set."""
    zoo, algorithms = load_zoo(), list(OFFLINE)
    lines = [["data set", "suite", BEHAVIOUR, *algorithms, "zoo's best, online"]]
    for name, group_name in DATASETS.items():
        suite = suite_for(name)
        scores: dict[str, list[float]] = {}
        for row in sorted(rows, key=lambda row: row["training_seed"] or 0):
            if row["dataset"] == name:
                scores.setdefault(row["algorithm"], []).append(row["score"])
        group = next(group for group in zoo.groups if group.name == group_name)
        best = next(each for each in summarise(zoo.read_records(group, suite), suite) if each.trained)
        cells = [_cell(scores.get(algorithm, [])) for algorithm in (BEHAVIOUR, *algorithms)]
        lines.append([f"`{name}`", suite.name, *cells, f"{number(best.score.value)} (`{best.entry}`)"])
    return markdown_table(lines)


def _cell(scores: list[float]) -> str:
    """Return the mean with its interval; of too few training seeds the scores themselves."""
    if len(scores) < ENOUGH_SEEDS:
        return ", ".join(map(number, scores)) or "-"
    interval = mean_interval(np.array(scores), "training seeds")
    return f"{number(interval.value)} {bounds(interval)}"


def main(
    seeds: str = "0-4",
    steps: int | None = None,
    datasets: Path = Path("datasets"),
    runs: Path = Path("runs/offline"),
    table: bool = False,
) -> None:
    """Train, evaluate and write what is missing; steps are gradient steps."""
    rows = RowFile(ROWS)
    if not table:
        with rows.locked():
            for name, algorithm, seed in missing(rows, parse_seeds(seeds)):
                if seed is None:
                    row = behaviour_row(name)
                else:
                    folder = make_dataset(load_spec(name, TRANSITIONS), datasets)
                    out = runs / name / algorithm / f"seed_{seed}"
                    row = agent_row(open_dataset(folder), algorithm, seed, steps, out)
                head = {"dataset": name, "algorithm": algorithm, "training_seed": seed}
                rows.append([head | row])
                print(f"{name} {algorithm} {seed}: {row['score']}", flush=True)
    fill(PAGE, {"scores": score_table(rows.read())})
    print(f"written: {PAGE}")


if __name__ == "__main__":
    run(main)
