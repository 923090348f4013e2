"""PPO of AgileRL on the native batch, which resets in the same step (SAME_STEP), as AgileRL expects.

``pip install agilerl peft`` beside the extra ``train``, then
``python examples/agilerl_ppo.py --steps 1000000 --out runs/agilerl`` leaves an agent in OUT.
"""

import argparse
import time
from pathlib import Path

import gymnasium
import numpy as np
import torch
from agilerl.algorithms import PPO
from agilerl.rollouts.on_policy import collect_rollouts
from stable_baselines3.common.utils import set_random_seed
from torch import nn

import fpg_bench

ID = "FPG/AllyVsScripted-v0"
LAYERS = {"hidden_size": [64], "activation": "Tanh", "layer_norm": False}
NETWORK = {
    "latent_dim": 64,
    "encoder_config": {**LAYERS, "output_activation": "Tanh", "output_layernorm": False},
    "head_config": LAYERS,
}


def main() -> None:
    """Train, say the speed, write the agent."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--envs", type=int, default=64)
    parser.add_argument("--rollout", type=int, default=256)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/agilerl"))
    args = parser.parse_args()
    set_random_seed(args.seed)
    games = gymnasium.make_vec(
        ID, args.envs, vectorization_mode="vector_entry_point", autoreset_mode="SameStep"
    )
    size = args.envs * args.rollout
    agent = PPO(
        games.single_observation_space,
        games.single_action_space,
        net_config=NETWORK,
        share_encoders=False,
        num_envs=args.envs,
        learn_step=size,
        batch_size=2048,
        update_epochs=10,
        lr=3e-4,
        gamma=0.95,
        ent_coef=0.0,
    )
    began, steps = time.process_time(), 0
    seen, info = games.reset(seed=args.seed)
    last = {
        "last_obs": seen,
        "last_done": np.zeros(args.envs),
        "last_scores": np.zeros(args.envs),
        "last_info": info,
    }
    while steps < args.steps:
        _, *state = collect_rollouts(agent, games, **last)
        last = dict(zip(last, state, strict=True))
        agent.learn()
        steps += size
        print(f"{steps:,} steps, reward a step {agent.rollout_buffer.buffer['rewards'].mean():.2f}")
    print(f"{steps / (time.process_time() - began):.0f} steps per CPU second")
    form = {"input_names": ["observation"], "output_names": ["action"], "opset_version": 20}
    sizes = ({0: torch.export.Dim("n")},)
    actor = agent.actor
    within = nn.Sequential(actor.encoder.model, actor.head_net.wrapped.model, nn.Hardtanh()).eval()
    exported = torch.onnx.export(within, (torch.zeros(2, 15),), dynamic_shapes=sizes, dynamo=True, **form)
    about = {"algorithm": "PPO", "id": ID, "training_seed": args.seed, "training_steps": steps}
    fpg_bench.write_agent(args.out, exported.model_proto.SerializeToString(), **about)


if __name__ == "__main__":
    main()
