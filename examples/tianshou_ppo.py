"""PPO of Tianshou on the native batch: a small adapter shows it as Tianshou's own kind of vector environment.

``pip install tianshou`` beside the extra ``train``, then
``python examples/tianshou_ppo.py --steps 1000000 --out runs/tianshou`` leaves an agent in OUT.
"""

import argparse
import time
from pathlib import Path

import gymnasium
import numpy as np
import torch
from stable_baselines3.common.utils import set_random_seed
from tianshou.algorithm import PPO
from tianshou.algorithm.modelfree.reinforce import ProbabilisticActorPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Collector, VectorReplayBuffer
from tianshou.env import BaseVectorEnv
from tianshou.trainer import OnPolicyTrainerParams
from torch import nn
from torch.distributions import Independent, Normal

import fpg_bench

ID = "FPG/AllyVsScripted-v0"


class Games(BaseVectorEnv):
    """One compiled batch, whose rounds begin and end together."""

    def __init__(self, count: int, seed: int) -> None:
        self.games = gymnasium.make_vec(ID, count, "vector_entry_point", autoreset_mode="SameStep")
        self.env_num, self.is_async, self.is_closed = count, False, False
        self.first, _ = self.games.reset(seed=seed)

    def get_env_attr(self, key, id=None):
        """Return what Tianshou asks each of its games for, such as the space of actions."""
        return [getattr(self.games, f"single_{key}")] * self.env_num

    def reset(self, env_id=None, **_):
        """The first observations of these games; the batch has begun their rounds already."""
        seen = self.first if env_id is None else self.first[env_id]
        return seen, np.array([{} for _ in seen])

    def step(self, action, id=None):
        """A step of all games; the last observation of a round is its own, as Tianshou expects."""
        seen, rewards, terminated, truncated, info = self.games.step(np.asarray(action, np.float32))
        if truncated.any():
            self.first, seen = seen, np.stack(info["final_obs"])
        return seen, rewards, terminated, truncated, np.array([{"env_id": k} for k in range(self.env_num)])


class Net(nn.Module):
    """Two hidden layers over the 15 numbers that a side sees."""

    def __init__(self, outputs: int) -> None:
        super().__init__()
        hidden = nn.Linear(15, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh()
        self.layers = nn.Sequential(*hidden, nn.Linear(64, outputs))
        self.log_scale = nn.Parameter(torch.zeros(outputs))

    def forward(self, obs, state=None, info=None):
        """The value, or a Gaussian's mean and scale with the state that there is none of."""
        mean = self.layers(torch.as_tensor(obs, dtype=torch.float32))
        return mean if mean.shape[-1] == 1 else ((mean, self.log_scale.exp().expand_as(mean)), state)


def main() -> None:
    """Train, say the speed, write the agent."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--envs", type=int, default=64)
    parser.add_argument("--rollout", type=int, default=256)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/tianshou"))
    args = parser.parse_args()
    set_random_seed(args.seed)
    games, actor, size = Games(args.envs, args.seed), Net(9), args.envs * args.rollout
    policy = ProbabilisticActorPolicy(
        actor=actor, dist_fn=lambda found: Independent(Normal(*found), 1), action_space=games.action_space[0]
    )
    ppo = PPO(policy=policy, critic=Net(1), optim=AdamOptimizerFactory(lr=3e-4), gamma=0.95, ent_coef=0.0)
    collector = Collector(ppo, games, VectorReplayBuffer(size, args.envs))
    length = {"max_epochs": 1, "epoch_num_steps": args.steps, "collection_step_num_env_steps": size}
    updates = {"batch_size": 2048, "update_step_num_repetitions": 10}
    began = time.process_time()
    ppo.run_training(OnPolicyTrainerParams(training_collector=collector, **length, **updates))
    steps = collector.collect_step
    print(f"{steps / (time.process_time() - began):.0f} steps per CPU second")
    form = {"input_names": ["observation"], "output_names": ["action"], "opset_version": 20}
    sizes = ({0: torch.export.Dim("n")},)
    within = nn.Sequential(actor.layers, nn.Hardtanh()).eval()  # what the game takes
    exported = torch.onnx.export(within, (torch.zeros(2, 15),), dynamic_shapes=sizes, dynamo=True, **form)
    about = {"algorithm": "PPO", "id": ID, "training_seed": args.seed, "training_steps": steps}
    fpg_bench.write_agent(args.out, exported.model_proto.SerializeToString(), **about)


if __name__ == "__main__":
    main()
