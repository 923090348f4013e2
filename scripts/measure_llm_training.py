"""Train PPO against a language model that plans beside the game, and say how far its plans are behind.

    python scripts/measure_llm_training.py

Three trainings of the same seed and steps, in matches of many rounds, since a small model on a processor
is far slower than the game: against the language model; the same again from its transcript, without a
server, whose policy must be the same to the bit; and against the interceptor. Then the language model, the
interceptor and the circle plan against both agents. What is there already is not done again.
"""

from __future__ import annotations

import argparse
import hashlib
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np

from fpg_bench.common.files import read_json, write_json, write_whole
from fpg_bench.common.rows import RowFile
from fpg_bench.training.language_model import TRANSCRIPT

SUITE = """\
side: planner
scenario: standard
rounds_per_match: {rounds}
matches: {matches}
opponent: adaptive
scale: {{zero: 5.73, top: 30.45}}  # of planner-v1
rivals:
  - {{name: trained-on-llm, ally: {out}/llm/agent}}
  - {{name: trained-on-interceptor, ally: {out}/interceptor/agent}}
"""
GAMES = """\
{view}:
  policy: MlpPolicy
  n_envs: {games}
  n_timesteps: 1000000
  normalize: {{norm_obs: false, norm_reward: true}}
  n_steps: 512
  batch_size: 1024
  n_epochs: 5
  learning_rate: 0.001277
  gamma: 0.95
  gae_lambda: 0.8
  policy_kwargs: {{net_arch: [128, 128], log_std_init: -0.1858}}
"""


def train(out: Path, said: argparse.Namespace) -> None:
    """The three trainings."""
    write_whole(out / "long.yml", f"rounds_per_match: {said.rounds}\n")
    views = {"llm": "FPG/AllyVsLLM-v0", "again": "FPG/AllyVsLLM-v0", "interceptor": "FPG/AllyVsPlanner-v0"}
    for name, view in views.items():
        write_whole(out / f"{name}.yml", GAMES.format(view=view, games=said.games))
        words = ["train", "ppo", view, "--seed", "0", "--steps", str(said.steps), "--evaluations", "0"]
        words += ["--hyperparams", str(out / f"{name}.yml"), "--scenario", str(out / "long.yml")]
        if name == "again":
            words += ["--transcript", str(out / "llm" / TRANSCRIPT)]
        if not (out / name / "agent" / "agent.json").exists():
            fpg_bench(*words, "--out", str(out / name), "--restart")  # one that was stopped begins again


def compare(out: Path, said: argparse.Namespace) -> None:
    """The planners against both agents: those that cost nothing in many matches, the model in few."""
    for name, planners, matches, rounds in (
        ("cheap", ["interceptor", "circle", "random"], 50, 10),
        ("model", ["llm", "interceptor", "circle"], said.matches, said.asked),
    ):
        suite = out / f"{name}-suite.yml"
        write_whole(suite, SUITE.format(rounds=rounds, matches=matches, out=out))
        fpg_bench("plan", "compare", *planners, "--suite", str(suite), "--out", str(out / name))


def told(out: Path) -> dict[str, object]:
    """What the trainings came to."""
    runs = {name: read_json(out / name / "run.json", "run") for name in ("llm", "again", "interceptor")}
    flown = [row for row in RowFile(out / "llm" / TRANSCRIPT).read() if row["kind"] == "flown"]
    behind = [row["round"] - row["planned_round"] for row in flown if row["planned_round"] is not None]
    circles = sum(row["plan"] == "circle" for row in flown)
    return {
        "steps_per_s": {name: run["steps_per_s"] for name, run in runs.items()},
        "rounds": len(flown),
        "rounds_with_a_new_plan": len(behind),
        "rounds_on_the_model_s_path_%": round(100 * (1 - circles / max(len(flown), 1)), 1),
        "rounds_behind": _spread(behind),
        "plans": runs["llm"].get("plans"),
        "same_policy_from_the_transcript": _policy(out / "llm") == _policy(out / "again"),
    }


def _spread(behind: list[int]) -> dict[str, float] | None:
    if not behind:
        return None
    low, middle, high = np.quantile(behind, (0.05, 0.5, 0.95))
    return {"5 %": float(low), "median": float(middle), "95 %": float(high)}


def _policy(run: Path) -> str:
    return hashlib.sha256((run / "agent" / "policy.onnx").read_bytes()).hexdigest()


def fpg_bench(*words: str) -> None:
    """Run a verb, and say which."""
    print("fpg-bench", shlex.join(words), flush=True)
    subprocess.run([sys.executable, "-m", "fpg_bench.cli", *words], check=True)


def main() -> None:
    """Train, compare, tell."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    asked.add_argument("--out", type=Path, default=Path("runs/against-language-model"))
    asked.add_argument("--steps", type=int, default=500_000)
    asked.add_argument("--games", type=int, default=4, help="at once; each waits for the model's plans")
    asked.add_argument("--rounds", type=int, default=1000, help="of a match in training")
    asked.add_argument("--matches", type=int, default=1, help="in which the model meets each agent")
    asked.add_argument("--asked", type=int, default=5, help="rounds of such a match")
    said = asked.parse_args()
    train(said.out, said)
    found = told(said.out)
    write_json(said.out / "training.json", found)
    for name, value in found.items():
        print(f"{name}: {value}", flush=True)
    compare(said.out, said)


if __name__ == "__main__":
    main()
