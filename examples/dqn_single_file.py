"""DQN in one file on the native batch, as CleanRL writes it: no RL library, extra ``train`` alone.

The agent chooses from the list of ``FPG/AllyVsScriptedDiscrete-v0``, and its ONNX file holds that list.
``python examples/dqn_single_file.py --steps 1000000 --out runs/dqn-file`` leaves an agent in OUT.
"""

import argparse
import copy
import time
from pathlib import Path

import gymnasium
import numpy as np
import torch
from torch import nn

import fpg_bench

ID, GAMMA, BUFFER, BATCH = "FPG/AllyVsScriptedDiscrete-v0", 0.95, 200_000, 256
EXPLORED, EPSILON, TARGET_UPDATES = 0.3, 0.03, 125


def net(outputs: int) -> nn.Sequential:
    """Two hidden layers over the 15 numbers that a side sees."""
    hidden = nn.Linear(15, 128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU()
    return nn.Sequential(*hidden, nn.Linear(128, outputs))


class Policy(nn.Module):
    """The action [n, 9] that the choice with the highest value stands for."""

    def __init__(self, values: nn.Module, table: np.ndarray) -> None:
        super().__init__()
        self.values, self.table = values, nn.Buffer(torch.from_numpy(table))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Observations [n, 15] to actions [n, 9]."""
        return self.table.index_select(0, self.values(observation).argmax(1))  # ONNX's Gather


def save(values: nn.Module, table: np.ndarray, folder: Path, **about: object) -> None:
    """Write an agent that takes the choice with the highest value; ``table`` holds the floats of each."""
    form = {"input_names": ["observation"], "output_names": ["action"], "opset_version": 20}
    sizes = ({0: torch.export.Dim("n")},)
    policy = Policy(values, table).eval()
    exported = torch.onnx.export(policy, (torch.zeros(2, 15),), dynamic_shapes=sizes, dynamo=True, **form)
    fpg_bench.write_agent(folder, exported.model_proto.SerializeToString(), **about)


def main() -> None:
    """Train, print the speed, write the agent."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--envs", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/dqn-file"))
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    games = gymnasium.make_vec(ID, num_envs=args.envs)
    (choices,) = games.unwrapped.core.choices.lists
    values = net(len(choices))
    target = copy.deepcopy(values)
    adam = torch.optim.Adam(values.parameters(), lr=5e-4)
    entries = torch.zeros(15), torch.tensor(0), torch.tensor(0.0), torch.zeros(15)
    buffer = [entry.expand(BUFFER, *entry.shape).clone() for entry in entries]
    seen = torch.as_tensor(games.reset(seed=args.seed)[0])
    starts, began, done, updates = torch.zeros(args.envs, dtype=torch.bool), time.process_time(), 0, 0
    while done < args.steps:
        epsilon = max(EPSILON, 1 - done / (EXPLORED * args.steps))
        with torch.no_grad():
            action = values(seen).argmax(1)
        explores = torch.rand(args.envs) < epsilon
        action = torch.where(explores, torch.randint(len(choices), (args.envs,)), action)
        after, reward, _, over, _ = games.step(action.numpy())
        after, reward = torch.as_tensor(after), torch.as_tensor(reward, dtype=torch.float32) / 10
        keep = ~starts  # a game whose round ended is reset in this step (NEXT_STEP): no transition
        places = (done + torch.arange(int(keep.sum()))) % BUFFER
        for rows, entry in zip(buffer, (seen, action, reward, after), strict=True):
            rows[places] = entry[keep]
        seen, starts, done = after, torch.as_tensor(over), done + len(places)
        if done < args.steps / 100:
            continue
        drawn = torch.randint(min(done, BUFFER), (BATCH,))
        state, action, reward, after = (rows[drawn] for rows in buffer)
        with torch.no_grad():  # a round ends by time alone: the value goes on behind it
            goal = reward + GAMMA * target(after).amax(1)
        adam.zero_grad()
        nn.functional.smooth_l1_loss(values(state).gather(1, action[:, None])[:, 0], goal).backward()
        nn.utils.clip_grad_norm_(values.parameters(), 10)
        adam.step()
        if (updates := updates + 1) % TARGET_UPDATES == 0:
            target.load_state_dict(values.state_dict())
    print(f"{done / (time.process_time() - began):.0f} steps per CPU second")
    about = {"algorithm": "DQN", "id": ID, "training_seed": args.seed, "training_steps": done}
    save(values, choices.rows, args.out, **about)


if __name__ == "__main__":
    main()
