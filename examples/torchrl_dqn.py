"""DQN of TorchRL on the native batch, choosing from a list; games reset in the same step (SAME_STEP).

``pip install torchrl`` beside the extra ``train``, then
``python examples/torchrl_dqn.py --steps 1000000 --out runs/torchrl-dqn`` leaves an agent in OUT.
"""

import argparse
import time
from pathlib import Path

import gymnasium
import torch
from dqn_single_file import BATCH, BUFFER, EPSILON, EXPLORED, GAMMA, ID, TARGET_UPDATES, net, save
from tensordict.nn import TensorDictSequential
from torch import nn
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
from torchrl.envs import GymWrapper
from torchrl.modules import EGreedyModule, QValueActor
from torchrl.objectives import DQNLoss, HardUpdate


def main() -> None:
    """Train, print the speed, write the agent."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--envs", type=int, default=16)
    parser.add_argument("--rollout", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/torchrl-dqn"))
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    games = gymnasium.make_vec(ID, num_envs=args.envs, autoreset_mode="SameStep")
    (choices,) = games.unwrapped.core.choices.lists
    env = GymWrapper(games, categorical_action_encoding=True)
    env.set_seed(args.seed)
    values = net(len(choices))
    actor = QValueActor(values, spec=env.action_spec, action_space="categorical")
    explored = int(EXPLORED * args.steps)
    explorer = EGreedyModule(env.action_spec, eps_end=EPSILON, annealing_num_steps=explored)
    loss = DQNLoss(actor, action_space="categorical", loss_function="smooth_l1", delay_value=True)
    loss.make_value_estimator(gamma=GAMMA)
    target = HardUpdate(loss, value_network_update_interval=TARGET_UPDATES)
    adam = torch.optim.Adam(loss.parameters(), lr=5e-4)
    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(BUFFER), batch_size=BATCH)
    size, began, steps = args.envs * args.rollout, time.process_time(), 0
    policy = TensorDictSequential(actor, explorer)
    for data in Collector(env, policy, frames_per_batch=size, total_frames=args.steps):
        steps += data.numel()
        explorer.step(data.numel())
        data["next", "reward"] /= 10
        buffer.extend(data.reshape(-1))
        for _ in range(args.rollout):
            adam.zero_grad()
            loss(buffer.sample())["loss"].backward()
            nn.utils.clip_grad_norm_(loss.parameters(), 10)
            adam.step()
            target.step()
    print(f"{steps / (time.process_time() - began):.0f} steps per CPU second")
    about = {"algorithm": "DQN", "id": ID, "training_seed": args.seed, "training_steps": steps}
    save(values, choices.rows, args.out, **about)


if __name__ == "__main__":
    main()
