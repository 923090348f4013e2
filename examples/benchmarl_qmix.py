"""QMIX, IPPO or IQL of BenchMARL on the duel with discrete actions; the ally's network becomes an agent.

``pip install benchmarl`` beside the extra ``train``, then
``python examples/benchmarl_qmix.py --steps 1000000 --out runs/qmix`` leaves an agent in OUT. The sides are
rivals, so each is a group of its own, and QMIX mixes the values of one agent by the full state.
"""

import argparse
import tempfile
import time
from pathlib import Path

from benchmarl.algorithms import algorithm_config_registry
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig
from benchmarl_maddpg import ID, TwoPlayerBatch
from dqn_single_file import save
from torch import nn
from torchrl.envs import PettingZooWrapper
from torchrl.modules import MultiAgentMLP

from fpg_bench.envs.pettingzoo_env import parallel_env


class DiscreteBatch(TwoPlayerBatch):
    """The game as a task: two groups of one agent each, which choose from lists."""

    def get_env_fun(self, num_envs, continuous_actions, seed, device):
        """Return a function that makes a game; BenchMARL steps several in turn."""
        options = {"return_state": True, "categorical_actions": True, "seed": seed, "device": device}
        group_map = {"ally": ["ally"], "opponent": ["opponent"]}
        return lambda: PettingZooWrapper(parallel_env(actions="discrete"), group_map=group_map, **options)

    def supports_continuous_actions(self):
        """They are discrete."""
        return False

    def supports_discrete_actions(self):
        """They are."""
        return True

    def has_state(self):
        """The full state of the game, for QMIX."""
        return True


def main() -> None:
    """Train, print the speed, write the ally's agent."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--algorithm", choices=("qmix", "ippo", "iql"), default="qmix")
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--envs", type=int, default=8)
    parser.add_argument("--rollout", type=int, default=256)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/qmix"))
    args = parser.parse_args()
    config = ExperimentConfig.get_from_yaml()
    config.max_n_frames, config.evaluation, config.loggers = args.steps, False, []
    config.create_json, config.lr, config.gamma = False, 3e-4, 0.95
    for kind in ("on_policy", "off_policy"):
        setattr(config, f"{kind}_n_envs_per_worker", args.envs)
        setattr(config, f"{kind}_collected_frames_per_batch", args.envs * args.rollout)
    config.off_policy_n_optimizer_steps = max(1, args.rollout // 8)
    config.save_folder = tempfile.mkdtemp()  # of BenchMARL's own notes
    model = MlpConfig(num_cells=[64, 64], activation_class=nn.ReLU, layer_class=nn.Linear)
    algorithm = algorithm_config_registry[args.algorithm].get_from_yaml()
    task = DiscreteBatch("DUEL", {"task": "duel"})
    experiment = Experiment(task, algorithm, model, seed=args.seed, config=config, critic_model_config=model)
    began = time.process_time()
    experiment.run()
    print(f"{experiment.total_frames / (time.process_time() - began):.0f} steps per CPU second")
    actor = experiment.group_policies["ally"]
    (network,) = [module for module in actor.modules() if isinstance(module, MultiAgentMLP)]
    (choices,) = parallel_env(actions="discrete").duel.choices["ally"].lists
    about = {"algorithm": args.algorithm, "id": ID, "side": "ally", "training_seed": args.seed}
    about |= {"actions": "discrete", "training_steps": experiment.total_frames}
    save(network.get_stateful_net(), choices.rows, args.out, **about)


if __name__ == "__main__":
    main()
