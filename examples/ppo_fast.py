"""PPO without overhead: plain torch on the arrays of ``make_sb3``, with the values of ``ppo-fast``.

Its scores are those of ``fpg-bench train ppo-fast``, in half the CPU time. Extra ``train`` alone.
``python examples/ppo_fast.py --out runs/plain/seed_0 --evals 20`` leaves an agent and evaluations in OUT.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch
from torch import nn

import fpg_bench

ID, GAMMA, LAMBDA, CLIP, BATCH, RATE, LOG_STD = "FPG/AllyVsScripted-v0", 0.95, 0.8, 0.2, 1024, 0.005, -0.1858


def net(outputs: int, gain: float) -> nn.Sequential:
    """Two hidden layers over the 15 numbers that a side sees, orthogonal at first."""
    net = nn.Sequential(nn.Linear(15, 64), nn.ReLU(), nn.Linear(64, 64), nn.ReLU(), nn.Linear(64, outputs))
    for layer, scale in zip(net[::2], (2**0.5, 2**0.5, gain), strict=True):
        nn.init.orthogonal_(layer.weight, scale)
        nn.init.zeros_(layer.bias)
    return net


class Policy(nn.Sequential):
    """The mean action [n, 9] of observations [n, 15], cut to what the game takes; a player."""

    def predict(self, observation: np.ndarray, *_: object) -> tuple[np.ndarray, None]:
        """Act in n games."""
        with torch.no_grad():
            return self(torch.tensor(observation)).numpy(), None


def main() -> None:
    """Train, say the speed, write the agent."""
    parser = argparse.ArgumentParser()
    for name, default in (("steps", 2_000_000), ("envs", 256), ("rollout", 16), ("seed", 0), ("evals", 0)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--out", type=Path, default=Path("runs/plain"))
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    games = fpg_bench.make_sb3(ID, args.envs, seed=args.seed * 1_000_000, stagger=True)
    actor, critic, log_std = net(9, 0.01), net(1, 1.0), nn.Parameter(torch.full((9,), LOG_STD))
    policy, weights = Policy(*actor, nn.Hardtanh()), [*actor.parameters(), *critic.parameters(), log_std]
    adam = torch.optim.Adam(weights, RATE, eps=1e-5, fused=True)
    shape, seen, done, seconds = (args.rollout, args.envs), torch.from_numpy(games.reset()), 0, 0.0
    states, actions, noise = (torch.empty(*shape, size) for size in (15, 9, 9))
    rewards, overs, sums = np.empty(shape, np.float32), np.zeros(shape, bool), np.zeros(args.envs)
    mean, var, count = 0.0, 1.0, 1e-4  # of the discounted sums of rewards, by which rewards are scaled
    while done < args.steps:
        began = time.process_time()
        with torch.no_grad():
            for t in range(args.rollout):
                states[t], noise[t] = seen, torch.randn(args.envs, 9)
                actions[t] = actor(seen) + log_std.exp() * noise[t]
                after, reward, overs[t], infos = games.step(actions[t].clamp(-1, 1).numpy())
                sums = GAMMA * np.where(overs[t - 1], 0, sums) + reward
                delta, new = sums.mean() - mean, args.envs / (count + args.envs)
                var = (1 - new) * var + new * (sums.var() + delta**2 * (1 - new))
                mean, count = mean + delta * new, count + args.envs
                rewards[t] = np.clip(reward / (var + 1e-8) ** 0.5, -10, 10)
                for i in np.flatnonzero(overs[t]):  # a round ends by time alone: the value goes on behind it
                    rewards[t, i] += GAMMA * critic(torch.tensor(infos[i]["terminal_observation"])).item()
                seen = torch.from_numpy(after)
            values = critic(torch.cat((states, seen[None])))[:, :, 0]
            goes_on, last = GAMMA * torch.from_numpy(~overs), torch.zeros(args.envs)
            advantage = torch.from_numpy(rewards) + goes_on * values[1:] - values[:-1]
            for t in reversed(range(args.rollout)):
                advantage[t] = last = advantage[t] + LAMBDA * goes_on[t] * last
            old = -(noise.square() / 2 + log_std).sum(2)
        data = [each.flatten(0, 1) for each in (states, actions, old, advantage, advantage + values[:-1])]
        adam.param_groups[0]["lr"] = RATE * max(0.0, 1 - (done + old.numel()) / args.steps)
        for part in torch.randperm(old.numel()).split(BATCH):
            s, a, before, gain, goal = (each[part] for each in data)
            ratio = (-(((a - actor(s)) / log_std.exp()).square() / 2 + log_std).sum(1) - before).exp()
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            loss = -torch.min(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain).mean()
            adam.zero_grad()
            (loss + 0.5 * (critic(s)[:, 0] - goal).square().mean()).backward()
            nn.utils.clip_grad_norm_(weights, 0.5)
            adam.step()
        done, seconds = done + old.numel(), seconds + time.process_time() - began
        if done * args.evals // args.steps > (done - old.numel()) * args.evals // args.steps:
            fpg_bench.log_evaluation(args.out, policy, done, seconds, training_seed=args.seed)
    print(f"{done / seconds:.0f} steps per CPU second")
    args.out.mkdir(parents=True, exist_ok=True)
    form = {"input_names": ["observation"], "output_names": ["action"], "opset_version": 20}
    form |= {"dynamic_shapes": ({0: torch.export.Dim("n")},), "dynamo": True}
    exported = torch.onnx.export(policy.eval(), (torch.zeros(2, 15),), **form)
    about = {"algorithm": "PPO", "id": ID, "training_seed": args.seed, "training_steps": done}
    fpg_bench.write_agent(args.out, exported.model_proto.SerializeToString(), **about)


if __name__ == "__main__":
    main()
