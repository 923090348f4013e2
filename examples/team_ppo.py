"""PPO for a team on the PettingZoo environment, in plain torch: one policy plays all three allies.

Equal policies that play their mode choose equal points, so the exported one draws its actions by ``noise``.
``python examples/team_ppo.py --steps 300000 --out runs/team`` leaves an agent in OUT; a game's step is one.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch
from torch import nn
from torch.distributions import Normal

import fpg_bench
from fpg_bench.products.teams.pettingzoo_env import TeamParallelEnv

GAMMA, LAMBDA, CLIP, EPOCHS, BATCH, SEATS = 0.95, 0.95, 0.2, 10, 1024, ("ally_0", "ally_1", "ally_2")


def net(outputs: int) -> nn.Sequential:
    """Two hidden layers over the 67 numbers that a seat sees."""
    return nn.Sequential(nn.Linear(67, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))


def rows(by_game: list) -> torch.Tensor:
    """Return what each game says of each seat, seat by seat."""
    return torch.tensor(np.array([each[seat] for each in by_game for seat in SEATS]))


class Policy(nn.Module):
    """The action [n, 9], drawn around the mean and cut to what the game takes."""

    def __init__(self, actor: nn.Module, std: torch.Tensor) -> None:
        super().__init__()
        self.actor, self.std = actor, nn.Buffer(std)

    def forward(self, observation: torch.Tensor, noise: torch.Tensor) -> torch.Tensor:
        """Observations [n, 67] and normal numbers [n, 9] to actions [n, 9]."""
        return (self.actor(observation) + self.std * noise).clamp(-1, 1)


def main() -> None:
    """Train, say the speed, write the agent."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=300_000)
    parser.add_argument("--envs", type=int, default=16)
    parser.add_argument("--rollout", type=int, default=128)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/team"))
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    games = [TeamParallelEnv(side="ally") for _ in range(args.envs)]
    seeds = np.random.SeedSequence(args.seed).generate_state(args.envs)  # that no other seed shares
    seen = rows([game.reset(seed=int(seed))[0] for game, seed in zip(games, seeds, strict=True)])
    actor, critic, log_std = net(9), net(1), nn.Parameter(torch.full((9,), -0.5))
    weights = [*actor.parameters(), *critic.parameters(), log_std]
    adam, began, done = torch.optim.Adam(weights, lr=3e-4), time.process_time(), 0
    while done < args.steps:
        kept = []
        with torch.no_grad():
            for _ in range(args.rollout):
                chance, value = Normal(actor(seen), log_std.exp()), critic(seen)[:, 0]
                action = chance.sample()
                by_game = zip(games, action.clamp(-1, 1).numpy().reshape(-1, len(SEATS), 9), strict=True)
                steps = [game.step(dict(zip(SEATS, of, strict=True))) for game, of in by_game]
                after, reward, _, ended = (rows(each) for each in list(zip(*steps, strict=True))[:4])
                target = reward.float() / 10 + GAMMA * critic(after)[:, 0]  # a round ends by time alone
                kept.append((seen, action, chance.log_prob(action).sum(1), value, target, ended))
                seen = rows([s[0] if g.agents else g.reset()[0] for g, s in zip(games, steps, strict=True)])
        state, action, log_p, value, target, ended = map(torch.stack, zip(*kept, strict=True))
        advantage, last = torch.zeros_like(value), torch.zeros(value.shape[1])
        for t in reversed(range(args.rollout)):
            last = target[t] - value[t] + GAMMA * LAMBDA * last * ~ended[t]
            advantage[t] = last
        data = [entry.flatten(0, 1) for entry in (state, action, log_p, advantage, advantage + value)]
        for part in (part for _ in range(EPOCHS) for part in torch.randperm(len(data[0])).split(BATCH)):
            s, a, old, gain, goal = (entry[part] for entry in data)
            ratio = (Normal(actor(s), log_std.exp()).log_prob(a).sum(1) - old).exp()
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            worst = torch.min(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain).mean()
            adam.zero_grad()
            (0.5 * (critic(s)[:, 0] - goal).square().mean() - worst).backward()
            nn.utils.clip_grad_norm_(weights, 0.5)
            adam.step()
        done += args.rollout * args.envs
    print(f"{done / (time.process_time() - began):.0f} steps per CPU second")
    form = {"input_names": ["observation", "noise"], "output_names": ["action"], "opset_version": 20}
    policy, sizes = Policy(actor, log_std.detach().exp()).eval(), ({0: torch.export.Dim("n")},) * 2
    inputs = (torch.zeros(2, 67), torch.zeros(2, 9))
    exported = torch.onnx.export(policy, inputs, dynamic_shapes=sizes, dynamo=True, **form)
    about = {"id": "FPG/team_v0", "side": "ally", "algorithm": "PPO", "sample": True}
    about |= {"training_seed": args.seed, "training_steps": done * len(SEATS)}
    fpg_bench.write_agent(args.out, exported.model_proto.SerializeToString(), **about)


if __name__ == "__main__":
    main()
