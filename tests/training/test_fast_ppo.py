"""FastPPO learns what PPO learns from the same random numbers, or is PPO and says so."""

import logging
from functools import partial

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.distributions import CategoricalDistribution
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.sb2_compat.rmsprop_tf_like import RMSpropTFLike
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize
from torch import nn

from fpg_bench import FastPPO, make_sb3
from tests.training.tiny import ALLY

ARRAYS = ("observations", "actions", "rewards", "episode_starts", "values", "log_probs", "returns")
SIZES = {"n_steps": 64, "batch_size": 64, "n_epochs": 2, "policy": "MlpPolicy"}


class Any(gymnasium.Env):
    """Ten steps of random observations, whose mean is earned by an action's first number."""

    def __init__(self, observed, chosen):
        self.observation_space, self.action_space = observed, chosen

    def _seen(self):
        self.observation_space.seed(int(self.np_random.integers(2**31)))
        return self.observation_space.sample()

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._steps = 0
        return self._seen(), {}

    def step(self, action):
        self._steps += 1
        return self._seen(), float(np.ravel(action)[0]), self._steps > 12, self._steps == 10, {}


BOX = spaces.Box(-1.0, 1.0, (3,))
games = partial(make_sb3, ALLY, 8, seed=0, stagger=True)
cart_pole = partial(make_vec_env, "CartPole-v1", 4, seed=1)
pendulum = partial(make_vec_env, "Pendulum-v1", 4, seed=1)


def made(observed=BOX, chosen=BOX):
    return partial(make_vec_env, partial(Any, observed, chosen), 4, seed=1)


class Reordered(FlattenExtractor):
    """Without weights."""

    def forward(self, observations):
        return super().forward(observations).flip(1)


class OwnPolicy(ActorCriticPolicy):
    """As SB3's."""


class Halved(nn.Linear):
    def forward(self, x):
        return super().forward(x) / 2


class OwnAdam(torch.optim.Adam):
    def zero_grad(self, set_to_none=True):
        for group in self.param_groups:
            group["weight_decay"] = 0.1
        super().zero_grad(set_to_none)


class OwnBuffer(RolloutBuffer):
    def compute_returns_and_advantage(self, last_values, dones):
        super().compute_returns_and_advantage(last_values, dones)
        self.advantages **= 3


class Peaked(CategoricalDistribution):
    def proba_distribution(self, action_logits):
        return super().proba_distribution(2 * action_logits)


def policy(**options):
    return {"policy_kwargs": options}


def replace(place, make, optimizer=True):
    """Exchange a module of the policy for what is made of it, and let the optimizer know."""

    def change(model):
        *path, name = place.split(".")
        parent = model.policy.get_submodule(".".join(path))
        new = make(getattr(parent, name))
        setattr(parent, name, new)
        if optimizer:
            model.policy.optimizer = torch.optim.Adam(model.policy.parameters(), eps=1e-5)

    return change


def behind(make):
    return lambda old: nn.Sequential(make(), old)


def without_bias(old):
    return nn.Linear(old.in_features, old.out_features, bias=False)


def hooked(model):
    model.policy.action_net.register_forward_hook(lambda module, seen, out: out * 2)


def gradient_hooked(model):
    model.policy.value_net.register_full_backward_hook(lambda module, seen, out: (seen[0] * 2,))


def weight_hooked(model):
    model.policy.action_net.weight.register_hook(lambda gradient: gradient * 2)


def own_forward(model):
    net = model.policy.action_net
    net.forward = lambda x: nn.functional.linear(x, net.weight, net.bias).sin()


def own_features(model):
    plain = model.policy.extract_features
    model.policy.extract_features = lambda obs, *rest: plain(obs, *rest) * 2


def shared_layers(model):
    model.policy.mlp_extractor.value_net = model.policy.mlp_extractor.policy_net
    model.policy.optimizer = torch.optim.Adam(model.policy.parameters(), eps=1e-5)


def frozen(model):
    model.policy.mlp_extractor.policy_net[0].weight.requires_grad_(False)


def drawn_weights(model):
    with torch.no_grad():
        for weight in model.policy.parameters():
            weight.add_(0.1 * torch.randn_like(weight))


def peaked(model):
    model.policy.action_dist = Peaked(2)


def squashed(model):
    model.policy._squash_output = True


def loaded(model):
    model.policy.load_state_dict({name: 0.9 * each for name, each in model.policy.state_dict().items()})


HIDDEN = "mlp_extractor.policy_net.1"
# What FastPPO computes itself: games, arguments, and what is changed after the model was made.
SERVED = {
    "relu": (games, policy(activation_fn=nn.ReLU, log_std_init=-0.5)),
    "tanh and all terms": (games, {"clip_range_vf": 0.2, "ent_coef": 0.05, "batch_size": 200}),
    "choices": (partial(games, actions="discrete"), {"ent_coef": 0.05}),
    "lists of choices": (partial(games, actions="multi-discrete"), {"ent_coef": 0.05}),
    "early stop": (games, {"target_kl": 1e-4, "learning_rate": 0.01, "n_epochs": 5}),
    "no clip": (games, {"max_grad_norm": 1e9, "normalize_advantage": False}),
    "schedules": (games, {"learning_rate": lambda left: 1e-3 * left, "clip_range": lambda left: 0.2 * left}),
    "waterfall": (partial(games, observation="waterfall", history=2), {}),
    "statistics": (lambda: VecNormalize(games(), gamma=0.9), {}),
    "frames": (lambda: VecFrameStack(games(), 3), {}),
    "CartPole": (cart_pole, {}),
    "FrozenLake": (partial(make_vec_env, "FrozenLake-v1", 4, seed=1), {}),
    "Pendulum": (pendulum, {"n_steps": 256, **policy(net_arch={"pi": [32], "vf": []})}),
    "no hidden layers": (cart_pole, policy(net_arch=[])),
    "three layers": (cart_pole, policy(net_arch=[16, 8, 8], ortho_init=False)),
    "two extractors": (cart_pole, policy(share_features_extractor=False)),
    "SGD": (cart_pole, policy(optimizer_class=torch.optim.SGD, optimizer_kwargs={"momentum": 0.9})),
    "AdamW": (cart_pole, policy(optimizer_class=torch.optim.AdamW, optimizer_kwargs={"weight_decay": 0.1})),
    "RMSprop": (cart_pole, policy(optimizer_class=RMSpropTFLike)),
    "pictures": (made(spaces.Box(0, 255, (3, 36, 36), np.uint8)), policy(net_arch=[8])),
    "numbers of float64": (made(spaces.Box(-1.0, 1.0, (3,), np.float64)), {}),
    "observed lists": (made(spaces.MultiDiscrete([3, 4])), {}),
    "observed bits": (made(spaces.MultiBinary(4)), {}),
    "actions in rows": (made(chosen=spaces.Box(-2.0, 2.0, (2, 2))), {"ent_coef": 0.01}),
    "single samples": (cart_pole, {"n_steps": 9, "batch_size": 35, "gae_lambda": 0.5}),
    "weights drawn": (games, {}, drawn_weights),
    "weights loaded": (games, {}, loaded),
    "another activation in the critic": (
        games,
        policy(net_arch=[8]),
        replace("mlp_extractor.value_net.1", lambda old: nn.ReLU()),
    ),
}
# What is left to PPO, with words of the reason.
LEFT = {
    "reordered": (games, policy(features_extractor_class=Reordered), None, "Reordered"),
    "flatten afterwards": (games, {}, replace("features_extractor.flatten", nn.Sequential), "layers"),
    "layer norm": (games, {}, replace(HIDDEN, behind(lambda: nn.LayerNorm(64))), "LayerNorm"),
    "ReLU for one Tanh": (games, {}, replace(HIDDEN, lambda old: nn.ReLU()), "layers"),
    "Tanh behind the actions": (
        games,
        {},
        replace("action_net", lambda old: nn.Sequential(old, nn.Tanh())),
        "layers",
    ),
    "own Linear": (games, {}, replace("action_net", lambda old: Halved(64, 9)), "Halved"),
    "no bias": (games, {}, replace("action_net", without_bias), "layers"),
    "shared layers": (games, {}, shared_layers, "layers"),
    "layers that are not optimized": (
        games,
        {},
        replace("action_net", lambda old: nn.Linear(64, 9), False),
        "optim",
    ),
    "hook": (games, {}, hooked, "Linear"),
    "hook of gradients": (games, {}, gradient_hooked, "Linear"),
    "hook of a weight": (games, {}, weight_hooked, "hooked"),
    "own forward": (games, {}, own_forward, "Linear"),
    "own features": (games, {}, own_features, "ActorCriticPolicy"),
    "frozen weights": (games, {}, frozen, "frozen"),
    "own policy": (games, {"policy": OwnPolicy}, None, "OwnPolicy"),
    "own optimizer": (games, policy(optimizer_class=OwnAdam), None, "OwnAdam"),
    "own buffer": (games, {"rollout_buffer_class": OwnBuffer}, None, "buffer"),
    "own distribution": (cart_pole, {}, peaked, "distribution"),
    "use_sde": (games, {"use_sde": True}, None, "use_sde"),
    "squashed actions": (pendulum, {}, squashed, "use_sde"),
    "bits": (made(chosen=spaces.MultiBinary(3)), {}, None, "MultiBinary"),
}


class Rollout(BaseCallback):
    """Keeps the arrays of the last rollout, and the number of steps."""

    def __init__(self):
        super().__init__()
        self.arrays, self.steps = {}, 0

    def _on_step(self):
        self.steps += 1
        return True

    def _on_rollout_end(self):
        buffer = self.model.rollout_buffer
        self.arrays = {name: getattr(buffer, name).copy() for name in ARRAYS}


def learned(kind, make, options, change=None, rollouts=2):
    """A model after some rollouts and updates, from given random numbers."""
    set_random_seed(3)
    model = kind(env=make(), device="cpu", **SIZES | options)
    if change is not None:
        change(model)
    rollout = Rollout()
    model.learn(rollouts * model.n_steps * model.n_envs, rollout)
    return model, rollout


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize("case", SERVED.values(), ids=SERVED)
def test_rollouts_and_updates_are_those_of_ppo(case, caplog):
    (theirs, expected), (ours, rollout) = (learned(kind, *case) for kind in (PPO, FastPPO))
    assert not caplog.records
    assert rollout.steps == expected.steps
    for name in ARRAYS:
        np.testing.assert_allclose(rollout.arrays[name], expected.arrays[name], rtol=1e-3, atol=1e-4)
    before = learned(PPO, case[0], case[1] | {"learning_rate": 0.0}, *case[2:])[0].policy.parameters()
    for start, one, other in zip(before, theirs.policy.parameters(), ours.policy.parameters(), strict=True):
        assert not torch.equal(start, one)
        torch.testing.assert_close(one, other, rtol=0, atol=2e-5)
    assert ours._n_updates == theirs._n_updates
    logs = (theirs.logger.name_to_value, ours.logger.name_to_value)
    assert logs[0].keys() == logs[1].keys()
    for name in (name for name in logs[0] if name.startswith("train/")):
        assert logs[1][name] == pytest.approx(logs[0][name], rel=1e-3, abs=1e-4), name


@pytest.mark.parametrize(("make", "options", "change", "reason"), LEFT.values(), ids=LEFT)
def test_what_it_does_not_serve_is_trained_by_ppo(make, options, change, reason, caplog):
    models = [learned(kind, make, options, change)[0] for kind in (PPO, FastPPO)]
    (record,) = caplog.records
    assert (record.levelno, reason in record.message) == (logging.WARNING, True), record.message
    theirs, ours = (model.policy.state_dict() for model in models)
    for name, value in theirs.items():
        assert torch.equal(value, ours[name]), name


@pytest.mark.parametrize("part", range(3), ids=("value", "log-probability", "entropy"))
@pytest.mark.parametrize("actions", [None, "discrete"])
def test_a_policy_of_another_sb3_is_trained_by_ppo(part, actions, monkeypatch, caplog):
    plain = ActorCriticPolicy.evaluate_actions

    def other(self, obs, actions):
        answers = list(plain(self, obs, actions))
        answers[part] = answers[part] * 1.01
        return tuple(answers)

    monkeypatch.setattr(ActorCriticPolicy, "evaluate_actions", other)
    models = [learned(kind, partial(games, actions=actions), {})[0] for kind in (PPO, FastPPO)]
    (record,) = caplog.records
    assert "computes something else" in record.message
    for one, other in zip(*(model.policy.parameters() for model in models), strict=True):
        assert torch.equal(one, other)


def test_each_call_of_learn_compares_anew(monkeypatch, caplog):
    model, _ = learned(FastPPO, games, {})
    with monkeypatch.context() as patch:
        patch.setattr(ActorCriticPolicy, "evaluate_actions", lambda *_: (torch.zeros(1),) * 3)
        patch.setattr(PPO, "train", lambda self: None)
        model.learn(1024)
    assert len(caplog.records) == 1
    model.learn(1024)
    assert len(caplog.records) == 1
    assert model._agrees


def test_a_layer_that_a_callback_exchanges_is_trained_by_ppo_from_there_on(caplog):
    class Exchange(BaseCallback):
        def _on_rollout_end(self):
            if self.num_timesteps == 1024:
                replace(HIDDEN, behind(lambda: nn.LayerNorm(64)))(self.model)

        def _on_step(self):
            return True

    model = FastPPO("MlpPolicy", games(), n_steps=64, device="cpu")
    model.learn(2048, Exchange())
    (record,) = caplog.records
    assert "LayerNorm" in record.message


def test_a_saved_model_is_one_of_ppo_and_goes_on_as_it_would(tmp_path):
    model, _ = learned(FastPPO, games, {})
    model.save(tmp_path / "model.zip")
    others = [kind.load(tmp_path / "model.zip", env=games(), device="cpu") for kind in (PPO, FastPPO)]
    for other in others:
        set_random_seed(4)
        other.learn(1024, reset_num_timesteps=False)
        assert other.num_timesteps == 2048
    for one, other in zip(*(each.policy.parameters() for each in others), strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=1e-5)


def test_callbacks_may_learn_and_stop_it():
    class Learner(BaseCallback):
        def _on_rollout_start(self):
            assert torch.is_grad_enabled()  # as a rival that learns here needs it

        def _on_step(self):
            return self.num_timesteps < 600

    model = FastPPO(env=games(), device="cpu", **SIZES)
    assert model.learn(2048, Learner()).num_timesteps == 600
