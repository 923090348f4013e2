"""What SAC and TD3 are worth per minute: trainings with several update ratios and nets, as a table.

python scripts/measure_update_ratios.py [--steps 60000] [--seeds 2] [--runs runs/ratios]

Every training is a run folder under ``--runs``; finished ones are not repeated, stopped ones go on. Speeds
are measured at the end, all configurations taking turns.
"""

from __future__ import annotations

import argparse
import time
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmark_speed import interleaved

from fpg_bench.common.files import read_yaml, write_whole
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.players.agent import baselines_folder
from fpg_bench.training.config import RunConfig
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import make_games, make_model
from fpg_bench.training.train import train

VIEW = "FPG/AllyVsScripted-v0"
NETS = ([64, 64], [128, 128], [256, 256])
STEPS_PER_UPDATE = (16, 8, 4)
TIMED_STEPS = 2000
OUT = Path("docs/update-ratios.md")


class Setting(NamedTuple):
    """What is compared: an algorithm with a net and one update per so many steps of all games together."""

    algorithm: str
    net: tuple[int, ...]
    ratio: int

    def hyperparameters(self) -> dict[str, Any]:
        """The shipped ones but for these."""
        content = read_yaml(baselines_folder() / "hyperparams" / f"{self.algorithm}.yml", "hyper-parameters")
        values = dict(content[VIEW])
        games = max(values["n_envs"], self.ratio)
        return values | {
            "n_envs": games,
            "gradient_steps": games // self.ratio,
            "policy_kwargs": values["policy_kwargs"] | {"net_arch": list(self.net)},
        }


SETTINGS = [
    Setting(algorithm, tuple(net), ratio)
    for algorithm, net, ratio in product(("sac", "td3"), NETS, STEPS_PER_UPDATE)
]


def trained(setting: Setting, seed: int, steps: int, runs: Path) -> list[Row]:
    """The scores of a training on its way, made now or before."""
    folder = runs / f"{setting.algorithm}-{setting.net[0]}-{setting.ratio}-seed{seed}"
    values = setting.hyperparameters()
    config = RunConfig(setting.algorithm, VIEW, seed, steps, values)
    train(config, folder, progress=False, resume=True)
    return RowFile(folder / "evaluations.jsonl").read()


def rate(setting: Setting) -> float:
    """Steps per second of SB3's ``learn`` once it learns."""
    values = setting.hyperparameters() | {"learning_starts": 1}
    parameters = load_hyperparameters(setting.algorithm, VIEW, values)
    model = make_model(setting.algorithm, make_games(VIEW, parameters, 0), parameters, 0)
    model.learn(500)
    begin = time.perf_counter()
    model.learn(TIMED_STEPS, reset_num_timesteps=False)
    return TIMED_STEPS / (time.perf_counter() - begin)


def score(trainings: list[list[Row]], steps: float) -> str:
    """The mean score of trainings after so many steps; between two looks by a straight line."""
    known = [([row["steps"] for row in rows], [row["score"] for row in rows]) for rows in trainings]
    if steps > 1.01 * known[0][0][-1]:
        return "-"
    return f"{np.mean([np.interp(steps, *curve) for curve in known]):.1f}"


def table(found: dict[Setting, list[list[Row]]], rates: dict[Setting, float], steps: int) -> str:
    """A line per setting: its speed, and its score after all steps and after two times of training."""
    times = np.quantile([steps / rates[setting] for setting in found], (0.25, 0.75))
    heads = ["net", "steps per update", "steps/s", f"score after {steps:,} steps"]
    records = [[*heads, *(f"after {t:.0f} s" for t in times)], ["---"] * (len(heads) + len(times))]
    for setting, trainings in found.items():
        record = [" x ".join(map(str, setting.net)), str(setting.ratio), f"{rates[setting]:.0f}"]
        records.append(record + [score(trainings, s) for s in (steps, *(times * rates[setting]))])
    return "\n".join("| " + " | ".join(record) + " |" for record in records) + "\n"


def main() -> None:
    """Train what is missing, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=60_000)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--runs", type=Path, default=Path("runs/ratios"))
    options = parser.parse_args()
    found: dict[Setting, list[list[Row]]] = {setting: [] for setting in SETTINGS}
    for seed, setting in product(range(options.seeds), SETTINGS):
        found[setting].append(trained(setting, seed, options.steps, options.runs))
        print(*setting, seed, found[setting][-1][-1]["score"], flush=True)
    timed = interleaved(3, {str(setting): partial(rate, setting) for setting in SETTINGS})
    rates = {setting: float(np.median(timed[str(setting)])) for setting in SETTINGS}
    page = (
        "# Update ratio and net size of SAC and TD3\n\n"
        f"On `{VIEW}`, {options.seeds} training seeds of {options.steps:,} steps each;\n"
        "otherwise the shipped hyper-parameters. The score is that of training on the way (mean over the\n"
        "suite's rivals, tuning seeds); `-`: the training had ended by then. Times are of one core of\n"
        "a shared machine, measured with all settings taking turns: compare them with each other. Made by\n"
        f"`python scripts/measure_update_ratios.py --steps {options.steps} --seeds {options.seeds}`.\n"
    )
    for algorithm in ("sac", "td3"):
        mine = {setting: trainings for setting, trainings in found.items() if setting.algorithm == algorithm}
        page += f"\n## {algorithm}\n\n" + table(mine, rates, options.steps)
    write_whole(OUT, page)
    print(page)


if __name__ == "__main__":
    main()
