"""PPO in one file on the native batch, as CleanRL writes it: no RL library, extra ``train`` alone.

The batch resets a game one step after its round ended (NEXT_STEP): that row has no action, the loss skips it.
``python examples/ppo_single_file.py --steps 1000000 --out runs/single-file`` leaves an agent in OUT.
"""

import argparse
import time
from pathlib import Path

import gymnasium
import numpy as np
import torch
from torch import nn

import fpg_bench

ID, GAMMA, LAMBDA, CLIP, EPOCHS, BATCH = "FPG/AllyVsScripted-v0", 0.95, 0.95, 0.2, 10, 2048


def net(outputs: int) -> nn.Sequential:
    """Two hidden layers over the 15 numbers that a side sees."""
    return nn.Sequential(nn.Linear(15, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))


class Policy(nn.Module):
    """The mean action [n, 9], cut to what the game takes."""

    def __init__(self, actor: nn.Module) -> None:
        super().__init__()
        self.actor = actor

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Observations [n, 15] to actions [n, 9]."""
        return self.actor(observation).clamp(-1, 1)


def main() -> None:
    """Train, say the speed, write the agent."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--envs", type=int, default=64)
    parser.add_argument("--rollout", type=int, default=256)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/single-file"))
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    games = gymnasium.make_vec(ID, num_envs=args.envs, stagger=True)
    actor, critic, log_std = net(9), net(1), nn.Parameter(torch.zeros(9))
    weights = [*actor.parameters(), *critic.parameters(), log_std]
    adam = torch.optim.Adam(weights, lr=3e-4)
    seen = torch.as_tensor(games.reset(seed=args.seed)[0])
    starts, began, done = torch.zeros(args.envs, dtype=torch.bool), time.process_time(), 0
    while done < args.steps:
        rows: list[list[torch.Tensor]] = [[], [], [], [], [], [], []]
        for _ in range(args.rollout):
            with torch.no_grad():
                chance = torch.distributions.Normal(actor(seen), log_std.exp())
                action, value = chance.sample(), critic(seen)[:, 0]
            after, reward, _, over, _ = games.step(action.clamp(-1, 1).numpy())
            after = torch.as_tensor(after)
            with torch.no_grad():  # a round ends by time alone: the value goes on behind it
                target = torch.as_tensor(reward, dtype=torch.float32) / 10 + GAMMA * critic(after)[:, 0]
            ended = torch.as_tensor(over)
            log_p = chance.log_prob(action).sum(1)
            for row, entry in zip(rows, (seen, action, log_p, value, target, ended, ~starts), strict=True):
                row.append(entry)
            seen, starts = after, ended
        state, action, log_p, value, target, ended, real = map(torch.stack, rows)
        advantage, last = torch.zeros_like(value), torch.zeros(args.envs)
        for t in reversed(range(args.rollout)):
            last = target[t] - value[t] + GAMMA * LAMBDA * last * ~ended[t]
            advantage[t] = last
        returns, keep = advantage + value, real.flatten()
        data = [entry.flatten(0, 1)[keep] for entry in (state, action, log_p, advantage, returns)]
        for _ in range(EPOCHS):
            for part in torch.randperm(len(data[0])).split(BATCH):
                s, a, old, gain, goal = (entry[part] for entry in data)
                ratio = (torch.distributions.Normal(actor(s), log_std.exp()).log_prob(a).sum(1) - old).exp()
                gain = (gain - gain.mean()) / (gain.std() + 1e-8)
                worst = torch.min(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain).mean()
                adam.zero_grad()
                (0.5 * (critic(s)[:, 0] - goal).square().mean() - worst).backward()
                nn.utils.clip_grad_norm_(weights, 0.5)
                adam.step()
        done += int(np.sum(keep.numpy()))
    print(f"{done / (time.process_time() - began):.0f} steps per CPU second")
    args.out.mkdir(parents=True, exist_ok=True)
    form = {"input_names": ["observation"], "output_names": ["action"], "opset_version": 20}
    sizes = ({0: torch.export.Dim("n")},)
    exported = torch.onnx.export(
        Policy(actor).eval(), (torch.zeros(2, 15),), dynamic_shapes=sizes, dynamo=True, **form
    )
    about = {"algorithm": "PPO", "id": ID, "training_seed": args.seed, "training_steps": done}
    fpg_bench.write_agent(args.out, exported.model_proto.SerializeToString(), **about)


if __name__ == "__main__":
    main()
