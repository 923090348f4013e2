"""PPO of TorchRL on the native batch, which resets in the same step (SAME_STEP), as TorchRL expects.

``pip install torchrl`` beside the extra ``train``, then
``python examples/torchrl_ppo.py --steps 1000000 --out runs/torchrl`` leaves an agent in OUT.
"""

import argparse
import time
from pathlib import Path

import gymnasium
import torch
from tensordict.nn import AddStateIndependentNormalScale, TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.envs import GymWrapper
from torchrl.modules import IndependentNormal, ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

import fpg_bench

ID, GAMMA, LAMBDA, EPOCHS, BATCH = "FPG/AllyVsScripted-v0", 0.95, 0.95, 10, 2048


def net(outputs: int) -> nn.Sequential:
    """Two hidden layers over the 15 numbers that a side sees."""
    return nn.Sequential(nn.Linear(15, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))


def main() -> None:
    """Train, say the speed, write the agent."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--envs", type=int, default=64)
    parser.add_argument("--rollout", type=int, default=256)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/torchrl"))
    args = parser.parse_args()
    torch.manual_seed(args.seed)
    games = gymnasium.make_vec(
        ID, args.envs, vectorization_mode="vector_entry_point", autoreset_mode="SameStep"
    )
    env = GymWrapper(games)
    env.set_seed(args.seed)
    mean = net(9)
    actor = TensorDictModule(
        nn.Sequential(mean, AddStateIndependentNormalScale(9)), ["observation"], ["loc", "scale"]
    )
    policy = ProbabilisticActor(
        actor, ["loc", "scale"], distribution_class=IndependentNormal, return_log_prob=True
    )
    critic = ValueOperator(net(1), ["observation"])
    loss = ClipPPOLoss(policy, critic, clip_epsilon=0.2, entropy_coeff=0.0)
    advantage = GAE(gamma=GAMMA, lmbda=LAMBDA, value_network=critic, average_gae=True)
    optimiser = torch.optim.Adam(loss.parameters(), lr=3e-4)
    size = args.envs * args.rollout
    began, steps = time.process_time(), 0
    for data in Collector(env, policy, frames_per_batch=size, total_frames=args.steps):
        steps += data.numel()
        for _ in range(EPOCHS):
            advantage(data)
            rows = data.reshape(-1)
            for batch in torch.randperm(len(rows)).split(BATCH):
                found = loss(rows[batch])
                total = found["loss_objective"] + found["loss_critic"]
                optimiser.zero_grad()
                total.backward()
                nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimiser.step()
        print(f"{steps:,} steps, reward a step {data['next', 'reward'].mean():.2f}")
    print(f"{steps / (time.process_time() - began):.0f} steps per CPU second")
    form = {"input_names": ["observation"], "output_names": ["action"], "opset_version": 20}
    sizes = ({0: torch.export.Dim("n")},)
    within = nn.Sequential(mean, nn.Hardtanh()).eval()  # what the game takes
    exported = torch.onnx.export(within, (torch.zeros(2, 15),), dynamic_shapes=sizes, dynamo=True, **form)
    about = {"algorithm": "PPO", "id": ID, "training_seed": args.seed, "training_steps": steps}
    fpg_bench.write_agent(args.out, exported.model_proto.SerializeToString(), **about)


if __name__ == "__main__":
    main()
