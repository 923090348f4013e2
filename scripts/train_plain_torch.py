"""Example of a submission without Stable-Baselines3: a small torch network that imitates a scripted ally.

python scripts/train_plain_torch.py [--out leaderboard/submissions/ally/plain-torch] [--seeds 0 1 2]

DAgger (Ross et al. 2011): the network plays, the script `expert-spread` labels its observations with actions,
the network learns them, and so on. Torch alone exports it to ONNX. Takes about a minute on one core.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from torch import nn

import fpg_bench
from fpg_bench import preset
from fpg_bench.envs.sb3_vec_env import FPGVecEnv
from fpg_bench.evaluation.seeds import training_seed
from fpg_bench.players.player import Player
from fpg_bench.players.registry import as_player

ID = "FPG/AllyVsScripted-v0"
OPPONENTS = ["tone", "narrowband", "broadband", "comb", "random", "sweep", "adaptive"]
TURNS, GAMES, STEPS = 4, 64, 300


def network() -> nn.Module:
    """Return a network from 15 observations to 9 actions in [-1, 1]."""
    return nn.Sequential(
        nn.Linear(15, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, 9), nn.Tanh()
    )


def play(policy: nn.Module | None, teacher: Player, games: FPGVecEnv) -> tuple[np.ndarray, np.ndarray]:
    """Play a round of all games, by the policy or the teacher; returns observations and teacher's actions."""
    observation, observations, labels = games.reset(), [], []
    for _ in range(STEPS):
        label, _ = teacher.predict(observation)
        observations.append(observation)
        labels.append(label)
        with torch.no_grad():
            action = label if policy is None else policy(torch.from_numpy(observation)).numpy()
        observation, *_ = games.step(action)
    return np.concatenate(observations), np.concatenate(labels)


def learn(policy: nn.Module, observations: np.ndarray, labels: np.ndarray, updates: int = 1500) -> None:
    """Fit the policy to the teacher's actions."""
    optimiser = torch.optim.Adam(policy.parameters(), lr=2e-3)
    x, y = torch.from_numpy(observations), torch.from_numpy(labels)
    for _ in range(updates):
        batch = torch.randint(len(x), (512,))
        loss = nn.functional.mse_loss(policy(x[batch]), y[batch])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()


def train(seed: int) -> nn.Module:
    """Train the network of a training seed."""
    torch.manual_seed(seed)
    teacher = as_player("expert-spread", "ally", preset("standard"))
    games = fpg_bench.make_sb3(ID, GAMES, training_seed(seed), opponent=OPPONENTS)
    policy, data = network(), [play(None, teacher, games)]
    for turn in range(TURNS):
        learn(policy, *map(np.concatenate, zip(*data, strict=True)))
        if turn < TURNS - 1:
            data.append(play(policy, teacher, games))
    return policy


def export(policy: nn.Module, folder: Path, seed: int) -> None:
    """Write the agent folder of a training seed."""
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "policy.onnx"
        torch.onnx.export(
            policy.eval(),
            (torch.zeros(2, 15),),
            str(file),
            input_names=["observation"],
            output_names=["action"],
            dynamic_shapes=({0: torch.export.Dim("n")},),
            opset_version=20,
            dynamo=True,
            external_data=False,
            verbose=False,
        )
        steps = TURNS * GAMES * STEPS
        fpg_bench.write_agent(
            folder, file, algorithm="dagger", id=ID, training_seed=seed, training_steps=steps
        )


def main() -> None:
    """Train and export every seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("leaderboard/submissions/ally/plain-torch"))
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    options = parser.parse_args()
    torch.set_num_threads(1)
    for seed in options.seeds:
        begin = time.monotonic()
        export(train(seed), options.out / f"seed_{seed}", seed)
        print(f"seed {seed}: {time.monotonic() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main()
