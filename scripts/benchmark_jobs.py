"""What a second process of this machine is worth to a list of jobs: training runs of several seeds.

    python scripts/benchmark_jobs.py [--quick] [--json FILE]

Both are timed from the call to its return, with the start of the processes, scores on the way and export.
"""

from __future__ import annotations

import tempfile
import time
from functools import partial

from benchmark_speed import VIEW, Figure, interleaved, median_ratio, report

from fpg_bench.training.config import RunConfig
from fpg_bench.training.train import train_seeds

RUNS = 4
ROLLOUT = 64 * 256


def run_rate(workers: int, steps: int) -> float:
    """Training runs per second."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        config = RunConfig("ppo", VIEW, steps=steps)
        train_seeds(config, folder, range(RUNS), workers=workers, say=lambda line: None)
        return RUNS / (time.perf_counter() - begin)


def measure_all(quick: bool) -> list[Figure]:
    """All figures of this script."""
    repeats, rollouts = (1, 1) if quick else (3, 31)  # 31: a quarter of the shipped budget
    run_rate(2, ROLLOUT)  # compiles
    steps = rollouts * ROLLOUT
    runs = {"two": partial(run_rate, 2, steps), "one": partial(run_rate, 1, steps)}
    ratio = median_ratio(interleaved(repeats, runs), "two", "one")
    asked = None if quick else 1.7
    return [Figure(f"{RUNS} PPO runs on two local processes / on one", ratio, asked)]


if __name__ == "__main__":
    report(__doc__ or "", measure_all)
