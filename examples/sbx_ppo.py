"""PPO of SBX (Stable-Baselines3 in JAX) on the native batch; its weights become an agent.

``pip install sbx-rl`` beside the extra ``train``, then
``python examples/sbx_ppo.py --steps 1000000 --out runs/sbx`` leaves an agent in OUT.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch
from sbx import PPO
from torch import nn

import fpg_bench

ID = "FPG/AllyVsScripted-v0"


def in_torch(params: dict) -> nn.Module:
    """The actor's mean action as a torch module: JAX keeps a layer's weights transposed."""
    policy = nn.Sequential(
        nn.Linear(15, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, 9), nn.Hardtanh()
    )
    for number in range(3):
        linear, found = policy[2 * number], params[f"Dense_{number}"]
        linear.weight.data = torch.tensor(np.array(found["kernel"]).T)
        linear.bias.data = torch.tensor(np.array(found["bias"]))
    return policy.eval()


def main() -> None:
    """Train, say the speed, write the agent."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--envs", type=int, default=64)
    parser.add_argument("--rollout", type=int, default=256)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/sbx"))
    args = parser.parse_args()
    games = fpg_bench.make_sb3(ID, n_envs=args.envs, seed=args.seed)
    batch = min(2048, args.envs * args.rollout)
    model = PPO("MlpPolicy", games, n_steps=args.rollout, batch_size=batch, gamma=0.95, seed=args.seed)
    began = time.process_time()
    model.learn(args.steps)
    print(f"{model.num_timesteps / (time.process_time() - began):.0f} steps per CPU second")
    policy = in_torch(model.policy.actor_state.params["params"])
    seen = np.random.default_rng(0).uniform(-1, 1, (64, 15)).astype(np.float32)
    wanted, _ = model.predict(seen, deterministic=True)
    assert np.abs(policy(torch.tensor(seen)).detach().numpy() - wanted).max() < 1e-4
    form = {"input_names": ["observation"], "output_names": ["action"], "opset_version": 20}
    sizes = ({0: torch.export.Dim("n")},)
    exported = torch.onnx.export(policy, (torch.zeros(2, 15),), dynamic_shapes=sizes, dynamo=True, **form)
    about = {"algorithm": "PPO", "id": ID, "training_seed": args.seed, "training_steps": model.num_timesteps}
    fpg_bench.write_agent(args.out, exported.model_proto.SerializeToString(), **about)


if __name__ == "__main__":
    main()
