"""Training runs that take a second: small nets, few games, few steps."""

from __future__ import annotations

import dataclasses

from fpg_bench.game.spec import GameSpec
from fpg_bench.training import train as training
from fpg_bench.training.config import RunConfig

ALLY = "FPG/AllyVsScripted-v0"
EVALUATION_ROUNDS = 3
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
    """The hyper-parameters of one id: 1200 steps of four games."""
    kind = ON_POLICY if "ppo" in algorithm else OFF_POLICY
    policy = {"policy": "MlpPolicy", "policy_kwargs": SMALL}
    if algorithm == "recurrent-ppo":
        policy = {"policy": "MlpLstmPolicy", "policy_kwargs": LSTM}
    normalize = {"norm_obs": True, "norm_reward": True}
    return {"n_envs": 4, "n_timesteps": 1200, "normalize": normalize, **policy, **kind, **changes}


def run_config(algorithm, env_id=ALLY, **options) -> RunConfig:
    """A run; options that are none of its own are those of its games."""
    own = {field.name for field in dataclasses.fields(RunConfig)}
    game = GameSpec.of(env_id, **{name: value for name, value in options.items() if name not in own})
    return RunConfig(algorithm, game, **{name: value for name, value in options.items() if name in own})


def train(algorithm, env_id, out, *, progress=False, evaluations=0, **options):
    """Train a run; scored nowhere unless asked for."""
    how = {name: options.pop(name) for name in ("restart", "resume") if name in options}
    config = run_config(algorithm, env_id, **options)
    return training.train(config, out, progress=progress, evaluations=evaluations, **how)


def train_tiny(algorithm, out, changes=None, env_id=ALLY, **options):
    """Train a run with :func:`settings`."""
    given = {"hyperparams": settings(algorithm, **(changes or {}))}
    return train(algorithm, env_id, out, **(given | options))
