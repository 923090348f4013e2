"""Train PPO for several budgets and record a round of each: ``python scripts/make_theatre.py``.

The board's front page shows the rounds: random play and the agents, all on one seed against ``adaptive``.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.common.files import write_whole
from fpg_bench.envs.two_player import make_duel
from fpg_bench.evaluation.rounds import begin_round, finish_round, make_match
from fpg_bench.game.recording import Recording
from fpg_bench.game.scenario import Scenario
from fpg_bench.products.rendering.replay import replay_data, scenario_data, script_json

ROOT = Path(__file__).parents[1]
OUT = ROOT / "fpg_bench/products/leaderboard/site/static/theatre_rounds.js"
BUDGETS = (10_000, 100_000, 2_000_000)
SEED = 2


def train(runs: Path, steps: int) -> Path:
    """Return the agent of a run, which is trained where it is missing."""
    folder = runs / f"ppo_{steps}"
    if not (folder / "agent").is_dir():
        command = [sys.executable, "-m", "fpg_bench", "train", "ppo", "FPG/AllyVsScripted-v0", "--seed", "0"]
        subprocess.run([*command, "--steps", str(steps), "--out", str(folder)], check=True)
    return folder / "agent"


def record(ally: str, steps: int) -> dict[str, Any]:
    """Play a round; returns what the page draws of each second, and the round's measures."""
    match = make_match(make_duel(1, scenario=Scenario(opponent_path="pursuit")), ally, "adaptive")
    begin_round(match, seeds=np.array([SEED]))
    recording = Recording(match.duel.batch)
    finish_round(match, on_step=recording.add)
    data = replay_data([recording], "", ally, "adaptive")
    seconds, threshold = data["rounds"][0]["steps"], data["scenario"]["threshold_db"]
    jammed = match.duel.measures(0)["jamming_success_rate"]
    return {
        "steps": steps,
        "jammed": round(jammed or 0, 3),
        "earned": round(float(recording.frames["ally_reward"][1:].mean()), 2),
        "frequency": seconds["frequency"][1:],
        "type": seconds["type"][1:],
        "centre": [round(mhz, 1) for mhz in seconds["centre"][1:]],
        "out": [int(snr < threshold) for snr in seconds["snr"][1:]],
    }


def main() -> None:
    """Train, record and write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=Path, default=ROOT / "runs/theatre", help="folder of the runs")
    runs = parser.parse_args().runs
    rounds = [record("random", 0), *(record(str(train(runs, steps)), steps) for steps in BUDGETS)]
    scenario = scenario_data(Scenario())
    content = {"band": scenario["band_mhz"], "jamming": scenario["jamming"], "rounds": rounds}
    write_whole(OUT, f"fpgTheatre({script_json(content)});\n".encode())


if __name__ == "__main__":
    main()
