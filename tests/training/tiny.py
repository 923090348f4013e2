"""Training runs that take a second: small nets, few games, few steps."""

from __future__ import annotations

from fpg_bench.training.maddpg_seeds import Together
from fpg_bench.training.train import train

ALLY = "FPG/AllyVsScripted-v0"
ON_POLICY = {"n_steps": 100, "batch_size": 100, "n_epochs": 1}
OFF_POLICY = {
    "learning_starts": 100,
    "buffer_size": 2000,
    "batch_size": 16,
    "train_freq": 50,
    "gradient_steps": 9,
}
SMALL = {"net_arch": [8]}
LSTM = SMALL | {"lstm_hidden_size": 6, "n_lstm_layers": 2}


def settings(algorithm: str, **changes) -> dict:
    """What a hyper-parameter file says for one id: 1200 steps of four games."""
    kind = ON_POLICY if "ppo" in algorithm else OFF_POLICY
    policy = {"policy": "MlpPolicy", "policy_kwargs": SMALL}
    if algorithm == "recurrent-ppo":
        policy = {"policy": "MlpLstmPolicy", "policy_kwargs": LSTM}
    normalize = {"norm_obs": True, "norm_reward": True}
    return {"n_envs": 4, "n_timesteps": 1200, "normalize": normalize, **policy, **kind, **changes}


def train_tiny(algorithm, out, changes=None, view_id=ALLY, **options):
    """A run of :func:`settings`; scored nowhere unless asked for."""
    given = {"hyperparams": settings(algorithm, **(changes or {})), "progress": False, "evaluations": 0}
    return train(algorithm, view_id, out, **(given | options))


def learn_together(models, steps, learner="torch"):
    """Train several MADDPG models at once, to the end."""
    together = Together(models, steps, learner)
    while not together.done:
        together.go_on()
