"""MADDPG of BenchMARL on the duel, both sides at once; the ally's network becomes an agent.

``pip install benchmarl`` beside the extra ``train``, then
``python examples/benchmarl_maddpg.py --steps 1000000 --out runs/benchmarl`` leaves an agent in OUT.
"""

import argparse
import tempfile
import time
from pathlib import Path

import torch
from benchmarl.algorithms import MaddpgConfig
from benchmarl.environments.pettingzoo.common import PettingZooClass
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig
from tensordict import TensorDict
from torch import nn
from torchrl.envs import PettingZooWrapper
from torchrl.modules import MultiAgentMLP

import fpg_bench
from fpg_bench.envs.pettingzoo_env import parallel_env

ID = "FPG/duel_v0"


class TwoPlayerBatch(PettingZooClass):
    """The game as a task: two groups of one agent each."""

    def get_env_fun(self, num_envs, continuous_actions, seed, device):
        """Return a function that makes a game; BenchMARL steps several in turn."""
        group_map = {"ally": ["ally"], "opponent": ["opponent"]}
        return lambda: PettingZooWrapper(parallel_env(), group_map=group_map, device=device, seed=seed)

    def supports_continuous_actions(self):
        """They are."""
        return True

    def max_steps(self, env):
        """Steps of a round."""
        return 300

    def has_render(self, env):
        """Pictures are made by ``fpg-bench play``."""
        return False


def main() -> None:
    """Train, say the speed, write the ally's agent."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--envs", type=int, default=8)
    parser.add_argument("--rollout", type=int, default=256)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/benchmarl"))
    args = parser.parse_args()
    config = ExperimentConfig.get_from_yaml()
    config.max_n_frames, config.evaluation, config.loggers = args.steps, False, []
    config.create_json, config.lr, config.gamma = False, 3e-4, 0.95
    config.off_policy_n_envs_per_worker = args.envs
    config.off_policy_collected_frames_per_batch = args.envs * args.rollout
    config.off_policy_n_optimizer_steps = max(1, args.rollout // 8)
    config.save_folder = tempfile.mkdtemp()  # of BenchMARL's own notes
    model = MlpConfig(num_cells=[64, 64], activation_class=nn.ReLU, layer_class=nn.Linear)
    task = TwoPlayerBatch("DUEL", {"task": "duel"})
    experiment = Experiment(
        task, MaddpgConfig.get_from_yaml(), model, seed=args.seed, config=config, critic_model_config=model
    )
    began = time.process_time()
    experiment.run()
    print(f"{experiment.total_frames / (time.process_time() - began):.0f} steps per CPU second")
    actor = experiment.group_policies["ally"]
    (network,) = [module for module in actor.modules() if isinstance(module, MultiAgentMLP)]
    policy = nn.Sequential(network.get_stateful_net(), nn.Tanh()).eval()
    seen = torch.rand(64, 1, 15) * 2 - 1
    wanted = actor[0](TensorDict({("ally", "observation"): seen}, [64]))["ally", "param"].tanh()
    assert (policy(seen) - wanted).abs().max() < 1e-5
    form = {"input_names": ["observation"], "output_names": ["action"], "opset_version": 20}
    sizes = ({0: torch.export.Dim("n")},)
    exported = torch.onnx.export(policy, (torch.zeros(2, 15),), dynamic_shapes=sizes, dynamo=True, **form)
    about = {"algorithm": "MADDPG", "id": ID, "side": "ally", "training_seed": args.seed}
    about["training_steps"] = experiment.total_frames
    fpg_bench.write_agent(args.out, exported.model_proto.SerializeToString(), **about)


if __name__ == "__main__":
    main()
