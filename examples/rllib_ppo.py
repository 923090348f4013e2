"""PPO of RLlib on the native batch.

``pip install "ray[rllib]"`` beside the extra ``train``, then
``python examples/rllib_ppo.py --steps 1000000 --out runs/rllib`` leaves an agent in OUT.
"""

import argparse
import time
from pathlib import Path

import torch
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from torch import nn

import fpg_bench

ID = "FPG/AllyVsScripted-v0"


class Mean(nn.Module):
    """The mean action of RLlib's policy, within what the game takes; its other outputs are the scale."""

    def __init__(self, module: nn.Module) -> None:
        super().__init__()
        self.encoder, self.head = module.encoder, module.pi

    def forward(self, observation):
        """Actions for a batch of observations."""
        found = self.encoder({"obs": observation})["encoder_out"]["actor"]
        return self.head(found)[:, :9].clamp(-1, 1)


def main() -> None:
    """Train, say the speed, write the agent."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--envs", type=int, default=64)
    parser.add_argument("--rollout", type=int, default=256)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/rllib"))
    args = parser.parse_args()
    size = args.envs * args.rollout
    network = DefaultModelConfig(fcnet_hiddens=[64, 64], fcnet_activation="tanh", vf_share_layers=False)
    config = (
        PPOConfig()
        .environment(f"fpg_bench:{ID}")  # imported where RLlib makes it
        .env_runners(
            num_env_runners=0,
            num_envs_per_env_runner=args.envs,
            gym_env_vectorize_mode="vector_entry_point",
        )
        .rl_module(model_config=network)
        .training(
            train_batch_size_per_learner=size,
            minibatch_size=min(2048, size),
            num_epochs=10,
            lr=3e-4,
            gamma=0.95,
            lambda_=0.95,
            clip_param=0.2,
            vf_clip_param=1e6,
            use_kl_loss=False,
            grad_clip=0.5,
        )
        .debugging(seed=args.seed)
    )
    algorithm = config.build_algo()
    began, steps = time.process_time(), 0
    while steps < args.steps:
        found = algorithm.train()["env_runners"]
        steps = int(found["num_env_steps_sampled_lifetime"])
        print(f"{steps:,} steps, return a round {found.get('episode_return_mean', float('nan')):.0f}")
    print(f"{steps / (time.process_time() - began):.0f} steps per CPU second")
    form = {"input_names": ["observation"], "output_names": ["action"], "opset_version": 20}
    sizes = ({0: torch.export.Dim("n")},)
    policy = Mean(algorithm.get_module()).eval()
    exported = torch.onnx.export(policy, (torch.zeros(2, 15),), dynamic_shapes=sizes, dynamo=True, **form)
    about = {"algorithm": "PPO", "id": ID, "training_seed": args.seed, "training_steps": steps}
    fpg_bench.write_agent(args.out, exported.model_proto.SerializeToString(), **about)


if __name__ == "__main__":
    main()
