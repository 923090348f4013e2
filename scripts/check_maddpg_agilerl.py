"""AgileRL's MADDPG on the same task, in the same number of steps and updates as ``check_maddpg.py``.

python scripts/check_maddpg_agilerl.py [--steps 500000] [--seeds 3]

Needs ``pip install agilerl==2.58.0``, in an environment of its own: it is no part of this project's.
"""

from __future__ import annotations

import numpy as np
import torch
from agilerl.algorithms import MADDPG
from agilerl.components.data import MultiAgentTransition, transition_to_tensordict
from agilerl.components.replay_buffer import ReplayBuffer
from check_maddpg import EPISODES, Together, options, report
from gymnasium import spaces
from stable_baselines3.common.utils import set_random_seed

GAMES, UPDATES, BATCH, LEARNING_STARTS, REWARD_SCALE = 8, 2, 256, 5000, 0.1
NET = {"latent_dim": 64, "encoder_config": {"hidden_size": [64]}, "head_config": {"hidden_size": [64]}}


class Learner:
    """AgileRL's MADDPG on a batch of games, with ``check_maddpg.py``'s settings."""

    def __init__(self, seed: int) -> None:
        set_random_seed(seed)
        self.games = Together(GAMES, seed=1000 * seed)
        self.agents = self.games.agents
        self.ends = np.cumsum([seen for seen, _ in self.games.sizes])[:-1]
        self.model = MADDPG(
            [spaces.Box(-np.inf, np.inf, (seen,)) for seen, _ in self.games.sizes],
            [spaces.Box(0, 1, (acts,)) for _, acts in self.games.sizes],
            self.agents,
            O_U_noise=False,
            expl_noise=0.3,
            vect_noise_dim=GAMES,
            net_config=NET,
            batch_size=BATCH,
            lr_actor=0.001,
            lr_critic=0.001,
            gamma=0.95,
            tau=0.01,
        )
        self.memory = ReplayBuffer(1_000_000)
        self.seen = self.games.reset()
        self.steps = self.updates = 0

    def apart(self, together: np.ndarray) -> dict[str, np.ndarray]:
        """Each agent's part of ``(games, values)`` of both."""
        return dict(zip(self.agents, np.split(together.astype(np.float32), self.ends, axis=1), strict=True))

    def learn(self, steps: int) -> None:
        """Play so many steps of all games together, and learn on the way."""
        self.model.set_training_mode(True)
        goal = self.steps + steps
        while self.steps < goal:
            acts, raw = self.model.get_action(self.apart(self.seen))
            self.games.step_async(np.concatenate([acts[agent] for agent in self.agents], axis=1))
            seen, rewards, _, infos = self.games.step_wait()
            last = np.stack(
                [info.get("terminal_observation", row) for info, row in zip(infos, seen, strict=True)]
            )
            kept = transition_to_tensordict(
                MultiAgentTransition(
                    obs=self.apart(self.seen),
                    action=raw,
                    reward=dict(zip(self.agents, (REWARD_SCALE * rewards).T.astype(np.float32), strict=True)),
                    next_obs=self.apart(last),
                    done={agent: np.zeros(GAMES, np.float32) for agent in self.agents},
                )
            )
            kept.batch_size = torch.Size([GAMES])
            self.memory.add(kept)
            self.seen, self.steps = seen, self.steps + GAMES
            if self.steps >= LEARNING_STARTS:
                for _ in range(UPDATES):
                    self.model.learn(self.memory.sample(BATCH))
                self.updates += UPDATES

    def mean_return(self) -> float:
        """The mean over episodes of both agents' returns together, without noise."""
        self.model.set_training_mode(False)
        games = Together(EPISODES, seed=10_000)
        seen, total = games.reset(), 0.0
        for _ in range(25):
            acts, _ = self.model.get_action(self.apart(seen))
            games.step_async(np.concatenate([acts[agent] for agent in self.agents], axis=1))
            seen, rewards, _, _ = games.step_wait()
            total += float(rewards.sum())
        return total / EPISODES


def main() -> None:
    """Train, and print returns."""
    asked = options(__doc__.splitlines()[0])
    torch.set_num_threads(1)
    for seed in range(asked.seeds):
        learner = Learner(seed)
        report(seed, 0, 0, learner.mean_return())
        for _ in range(10):
            learner.learn(asked.steps // 10)
            report(seed, learner.steps, learner.updates, learner.mean_return())


if __name__ == "__main__":
    main()
