"""Score against seconds of training: settings side by side in one run, taking turns.

    python scripts/measure_time_to_score.py ppo-fast ppo --seeds 3 --steps 2000000 --out results/time
    python scripts/measure_time_to_score.py --settings FILE --seconds 40 --out results/search

A setting is an algorithm with its shipped hyper-parameters, or an entry of a YAML file that changes some:
``NAME: {algorithm: ppo, n_epochs: 3, policy_kwargs.net_arch: [64, 64]}``. All settings of a training seed
are trained at once in one process, each for about a second of CPU time, then the next; each draws the numbers
that it would draw alone. Seconds are those of SB3's ``learn``, without the scores on the way, which are
played on tuning seeds. What was trained before is not trained again.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from taking_turns import train_together

from fpg_bench.common.files import read_yaml, write_whole
from fpg_bench.common.ids import find_env
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.evaluation.policy_evaluator import PolicyEvaluator
from fpg_bench.evaluation.seeds import training_seed
from fpg_bench.evaluation.suite import suite_of
from fpg_bench.players.agent import baselines_folder
from fpg_bench.players.registry import as_player
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.rendering.canvas import blank_figure
from fpg_bench.training.algorithms import find_algorithm
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import make_games, make_model
from fpg_bench.training.tuning.space import merged

MEASURES = ("return", "score")
AT_S = (2, 5, 10, 20, 40, 80, 120)
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")  # Okabe and Ito
Trainings = dict[str, list[list[Row]]]  # by setting, of each seed the looks


class Setting(NamedTuple):
    """What is compared: an algorithm's shipped hyper-parameters for an id, with some of them changed."""

    env_id: str
    algorithm: str
    changes: dict[str, Any]

    def model(self, seed: int, steps: int | None) -> tuple[BaseAlgorithm, int]:
        """A new model on games of its own, and its budget of steps."""
        values = None
        if self.changes:
            file = baselines_folder() / "hyperparams" / f"{self.algorithm}.yml"
            values = merged(read_yaml(file, "hyper-parameters")[self.env_id], self.changes)
        parameters = load_hyperparameters(self.algorithm, self.env_id, values)
        games = make_games(self.env_id, parameters, training_seed(seed))
        model = make_model(find_algorithm(self.algorithm), games, parameters, seed)
        return model, steps or parameters.n_timesteps


class Judge:
    """What a policy is worth on an id's suite, and the best script there."""

    def __init__(self, env_id: str) -> None:
        self._evaluator = PolicyEvaluator(suite_of(env_id, {}))
        scenario, side = self._evaluator.suite.scenario, find_env(env_id).side
        scripts = {name: self.look(as_player(name, side, scenario)) for name in SCRIPTED[side]}
        self.script = max(scripts, key=lambda name: scripts[name]["return"])
        self.bounds = scripts[self.script]

    def look(self, player: Any) -> Row:
        """The score, and the return a step."""
        found = self._evaluator.score(player)
        return {measure: found[measure] for measure in MEASURES}


def measured(settings: dict[str, Setting], judge: Judge, options: argparse.Namespace) -> Trainings:
    """The looks at all trainings, made now or before."""
    file, seeds = RowFile(options.out / "rows.jsonl"), range(options.first, options.first + options.seeds)
    for seed in seeds:
        done = {row["setting"] for row in file.read() if row["seed"] == seed}
        makers = {
            name: partial(setting.model, seed, options.steps)
            for name, setting in settings.items()
            if name not in done
        }
        for name, rows in train_together(makers, judge.look, options.every, options.seconds).items():
            file.append([{"setting": name, "seed": seed} | row for row in rows])
            last = rows[-1]
            print(f"seed {seed}: {name}: {last['return']:.2f} after {last['cpu_s']:.0f} CPU s", flush=True)
    found: Trainings = {}
    for name in settings:
        rows = [row for row in file.read() if row["setting"] == name]
        by_seed = [[row for row in rows if row["seed"] == seed] for seed in seeds]
        found |= {name: [of for of in by_seed if of]} if rows else {}
    return found


def seconds_to_pass(n_evals: Sequence[Row], measure: str, bound: float, clock: str) -> float:
    """Until a training first reached a bound, between two looks by a straight line; NaN: never."""
    for before, after in pairwise(n_evals):
        if after[measure] >= bound:
            part = (bound - before[measure]) / (after[measure] - before[measure])
            return float(before[clock] + max(part, 0.0) * (after[clock] - before[clock]))
    return float("nan")


def reached(trainings: Sequence[Sequence[Row]], measure: str, cpu_s: float) -> float:
    """The mean over trainings of what they had reached after so many seconds; NaN: one had ended by then."""
    if min(n_evals[-1]["cpu_s"] for n_evals in trainings) < 0.98 * cpu_s:
        return float("nan")
    curves = [([row["cpu_s"] for row in n_evals], [row[measure] for row in n_evals]) for n_evals in trainings]
    return float(np.mean([np.interp(cpu_s, *curve) for curve in curves]))


def shown(values: Sequence[float], form: str) -> str:
    """The mean of some values, with their lowest and highest where there are several."""
    mean = np.mean(values)
    if np.isnan(mean):
        return "-"
    spread = f" ({min(values):{form}} to {max(values):{form}})" if len(values) > 1 else ""
    return f"{mean:{form}}{spread}"


def table(found: Trainings, judge: Judge, measure: str, versus: str) -> str:
    """A line per setting: speed, what it reached when, and how long it took to pass the best script."""
    form, bound = (".2f" if measure == "return" else ".1f"), judge.bounds[measure]
    longest = max(n_evals[-1]["cpu_s"] for trainings in found.values() for n_evals in trainings)
    at = [s for s in AT_S if s <= 1.02 * longest]
    heads = ["setting", "steps per CPU s", *(f"{s} s" for s in at), "at the end", "steps", "CPU s"]
    records = [[*heads, "CPU s to pass", "wall s to pass", "ratio of CPU s"]]
    records.append(["---"] * len(records[0]))
    times = {
        name: {
            clock: [seconds_to_pass(n_evals, measure, bound, clock) for n_evals in trainings]
            for clock in ("cpu_s", "wall_s")
        }
        for name, trainings in found.items()
    }
    for name, trainings in found.items():
        ends = [n_evals[-1] for n_evals in trainings]
        record = [name, f"{np.mean([row['steps'] / row['cpu_s'] for row in ends]):,.0f}"]
        record += [shown([reached(trainings, measure, s)], form) for s in at]
        record += [shown([row[measure] for row in ends], form)]
        record += [f"{np.mean([row[key] for row in ends]):,.0f}" for key in ("steps", "cpu_s")]
        record += [shown(times[name][clock], ".1f") for clock in ("cpu_s", "wall_s")]
        record.append(shown([float(np.mean(times[name]["cpu_s"]) / np.mean(times[versus]["cpu_s"]))], ".2f"))
        records.append(record)
    head = f"{measure}: {judge.script}, the best script, {bound:{form}}; ratio to {versus}\n\n"
    return head + "\n".join("| " + " | ".join(record) + " |" for record in records) + "\n"


def draw(found: Trainings, judge: Judge, path: Path) -> None:
    """Draw the return a step against CPU seconds: the mean over seeds, as far as all have come."""
    figure = blank_figure(6.4, 3.6)
    axes = figure.subplots()
    for (name, trainings), colour in zip(found.items(), COLOURS, strict=False):
        grid = np.geomspace(1, min(n_evals[-1]["cpu_s"] for n_evals in trainings), 200)
        curve = [
            np.interp(grid, [row["cpu_s"] for row in n_evals], [row["return"] for row in n_evals])
            for n_evals in trainings
        ]
        axes.plot(grid, np.mean(curve, axis=0), color=colour, lw=1.8, label=name)
        axes.fill_between(grid, np.min(curve, axis=0), np.max(curve, axis=0), color=colour, alpha=0.15, lw=0)
    axes.axhline(judge.bounds["return"], color="#7f7f7f", lw=0.9, ls="--", label=judge.script)
    axes.set(xscale="log", xlabel="CPU seconds of training", ylabel="return a step", ylim=(-5, None))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.legend(frameon=False, fontsize=8, loc="lower right")
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, metadata={"Software": None})


def settings_of(options: argparse.Namespace) -> dict[str, Setting]:
    """What is compared, by name."""
    found = {name: Setting(options.id, name, {}) for name in options.names}
    content = read_yaml(options.settings, "settings") if options.settings else {}
    for name, values in content.items():
        changes = {key: value for key, value in values.items() if key != "algorithm"}
        found[name] = Setting(options.id, values.get("algorithm", "ppo"), changes)
    return found


def main() -> None:
    """Train what is missing, and print and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="algorithms with their shipped hyper-parameters")
    parser.add_argument("--settings", type=Path, help="a YAML file of more settings")
    parser.add_argument("--id", default="FPG/AllyVsScripted-v0", help="the environment id")
    parser.add_argument("--versus", help="whose seconds the others' are divided by; default: the last one's")
    parser.add_argument("--seeds", type=int, default=1, help="how many training seeds")
    parser.add_argument("--first", type=int, default=0, help="the first of them")
    parser.add_argument("--steps", type=int, help="budget of each training; default: the setting's")
    parser.add_argument("--seconds", type=float, help="of CPU time, at which a training ends; default: none")
    parser.add_argument("--every", type=float, default=0.5, help="CPU seconds from one score to the next")
    parser.add_argument("--picture", type=Path, help="a PNG file to draw")
    parser.add_argument("--out", type=Path, default=Path("results/time-to-score"))
    options = parser.parse_args()
    settings, judge = settings_of(options), Judge(options.id)
    found = measured(settings, judge, options)
    versus = options.versus or list(found)[-1]
    page = "\n".join(table(found, judge, measure, versus) for measure in MEASURES)
    write_whole(options.out / "tables.md", page)
    print(page)
    if options.picture:
        draw(found, judge, options.picture)


if __name__ == "__main__":
    main()
