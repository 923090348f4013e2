"""Train allies in one scenario and over ranges of it, and score both where the rules differ.

python scripts/train_variants.py [--seeds 5] [--page docs/guides/training.md]     run it again to resume

The ranges are those of the shifted suites, without the box, which all rounds share. Rivals are those of the
public suite, and the population that the shifted suites draw from. Held-out suites are scored, too.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from command import run
from lineage import fill

from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.evaluation.statistics import mean_interval
from fpg_bench.evaluation.suite import read_suite
from fpg_bench.evaluation.table import bounds, markdown_table
from fpg_bench.game.spec import GameSpec
from fpg_bench.training.config import RunConfig
from fpg_bench.training.train import train

# Of each scenario: its population; public, held-out and shifted suite; and ranges.
SENSING = {"sensing_centre_sd_mhz": [1, 4], "sensing_type_error": [0.1, 0.3]}
STUDIES: dict[str, tuple[str, tuple[str, ...], dict[str, Any]]] = {
    "standard": (
        "suite:training-1",
        ("ally-v2", "ally-season-5", "ally-shifted-v2"),
        {
            "check_interval_s": [[2, 3], [7, 9]],
            "footprint_half_widths_mhz": [[1.67, 6.67, 16.67, 1.67], [3.75, 15, 37.5, 3.75]],
            "opponent_power_dbm": [17, 23],
            "ally_speed_m_s": [[3, 6], [5, 10]],
        },
    ),
    "link": (
        "suite:training-link-1",
        ("ally-link-v1", "ally-link-season-4", "ally-link-shifted-v1"),
        {
            "check_interval_s": [[1, 1], [6, 8]],
            "opponent_power_dbm": [36, 42],
            "hop_airtime_s": [0.1, 0.5],
            "ally_speed_m_s": [[0, 15], [0, 25]],
            "noise_density_dbm_hz": [-158, -148],
        },
    ),
}
ALGORITHM = "ppo-fast"


def row(name: str, is_drawn: bool, seeds: int, runs: Path) -> list[str]:
    """Train the seeds of one cell, evaluate them, and return their row of the table."""
    population, suites, ranges = STUDIES[name]
    scripts = {player for rival in read_suite(suites[0]).rivals for player in rival.players}
    scenario = {"preset": name} | (ranges | SENSING if is_drawn else {})
    rivals = [*sorted(scripts), population]
    game = GameSpec("FPG/AllyVsPolicy-v0", scenario=scenario, opponent=rivals, path="pursuit")
    word = "ranges" if is_drawn else "one"
    agents = []
    for seed in range(seeds):
        folder = runs / name / word / f"seed_{seed}"
        config = RunConfig(ALGORITHM, game, seed=seed)
        agents.append(train(config, folder, evaluations=0, progress=False, resume=True))
    cells = []
    for suite in suites:
        (found,) = evaluate({word: agents}, suite, runs / name / word / suite)
        scores = found.suite.scale.score(found.rewards.mean(axis=(1, 2)))
        interval = mean_interval(np.asarray(scores), "training seeds")
        cells.append(f"{interval.value:.1f} {bounds(interval)}")
    print(name, word, *cells, flush=True)
    return [f"`{name}`", "its ranges" if is_drawn else "itself", *cells]


def main(seeds: int = 5, runs: Path = Path("runs/variants"), page: Path | None = None) -> None:
    """Train, print the table, and put it into a page."""
    lines = [["scenario", "trained on", "public", "held-out", "shifted"]]
    lines += [row(name, is_drawn, seeds, runs) for name in STUDIES for is_drawn in (False, True)]
    table = markdown_table(lines)
    print(f"\n{table}")
    if page:
        fill(page, {"variants": table})


if __name__ == "__main__":
    run(main)
