"""Measure the time of a verdict on a submission of five training seeds on all suites of the allies' track.

    python scripts/benchmark_leaderboard.py [--quick] [--json FILE]

The reference plays the same rounds one after the other: a single Gymnasium environment and
Stable-Baselines3's ``predict`` of a policy of the same size. Only some of its rounds are played, and the time
is scaled up.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from pathlib import Path

import gymnasium
import numpy as np
from benchmark_speed import Figure, report
from stable_baselines3 import PPO

from fpg_bench.common.ids import policy_env
from fpg_bench.evaluation.suite import Rival
from fpg_bench.leaderboard.cases import make_case
from fpg_bench.leaderboard.verify import verify

ENTERED = Path("leaderboard/submissions/ally/ally-scripted-ppo")
NETWORK = {"net_arch": [128, 128]}
ASKED_S, ASKED_RATIO = 60.0, 20.0


def verdict_s(folder: Path, jobs: int) -> float:
    """Return the seconds from the call to the verdict on a submission without a result."""
    shutil.rmtree(folder / "results", ignore_errors=True)
    begin = time.perf_counter()
    (verdict,) = verify(folder, jobs=jobs, say=lambda line: None)
    assert verdict.good, verdict.line
    return time.perf_counter() - begin


def round_s(rival: Rival, rounds: int) -> float:
    """Return the seconds of a round against a rival in a single environment with SB3's predict."""
    scenario = rival.scenario
    players, view = list(rival.players), policy_env("ally").id
    env = gymnasium.make(view, opponent=players, path=scenario.opponent_path, scenario=scenario)
    model = PPO("MlpPolicy", env, policy_kwargs=NETWORK, device="cpu")
    begin = time.perf_counter()
    for seed in range(rounds):
        observation, _ = env.reset(seed=seed)
        over = False
        while not over:
            action, _ = model.predict(observation, deterministic=True)
            observation, _, terminated, truncated, _ = env.step(action)
            over = terminated or truncated
    return (time.perf_counter() - begin) / rounds


def measure_all(quick: bool) -> list[Figure]:
    """Return all figures of this script."""
    repeats, rounds = (1, 1) if quick else (3, 5)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        shutil.copytree(ENTERED, folder / "submissions" / "ally" / ENTERED.name)
        case = make_case(folder, folder / "submissions" / "ally" / ENTERED.name)
        played = sum(suite.rounds for _, matchups in case.wanted for suite, _ in matchups)
        met = [(rival, suite.rounds) for suite in case.suites.values() for rival in suite.rivals]
        round_s(met[0][0], 1)  # compiles
        singles, ones, twos = [], [], []
        for _ in range(repeats):  # in turns, so that a slow moment meets all
            each = [count * round_s(rival, rounds) for rival, count in met]
            singles.append(len(case.wanted) * sum(each))
            ones.append(verdict_s(folder, 1))
            twos.append(verdict_s(folder, 2))
    ratios = np.array(singles) / ones
    return [
        Figure(f"a verdict ({played:,} rounds), two at once", float(np.median(twos)), ASKED_S, False, "s"),
        Figure("the same, one at a time", float(np.median(ones)), None, False, "s"),
        Figure(
            "single views and SB3's predict / a verdict, one at a time", float(np.median(ratios)), ASKED_RATIO
        ),
    ]


if __name__ == "__main__":
    report(__doc__ or "", measure_all)
