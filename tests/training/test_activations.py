"""Activations by name: each is exported as torch computes it, and goes where hyper-parameters go."""

import json

import numpy as np
import onnxruntime
import pytest
import torch
from torch import nn

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import DUEL
from fpg_bench.envs.sb3_vec_env import make_sb3_duel
from fpg_bench.players.agent import load_agent
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import ACTIVATIONS, as_activation, make_games, make_model
from fpg_bench.training.tuning.space import load_space, merged
from tests.training.tiny import ALLY, settings, train_tiny


class Each(nn.Module):
    """All activations of the same numbers, one row each."""

    def __init__(self):
        super().__init__()
        self.kinds = nn.ModuleList(kind() for kind in ACTIVATIONS.values())

    def forward(self, seen):
        return torch.stack([kind(seen) for kind in self.kinds])


@pytest.mark.slow
def test_onnx_computes_each_of_them_as_torch_does(tmp_path):
    module, seen = Each().eval(), torch.linspace(-30, 30, 4001)
    torch.onnx.export(module, (seen,), str(tmp_path / "each.onnx"), dynamo=True, verbose=False)
    session = onnxruntime.InferenceSession(tmp_path / "each.onnx")
    (found,) = session.run(None, {session.get_inputs()[0].name: seen.numpy()})
    differences = np.abs(found - module(seen).numpy()).max(axis=1)
    assert max(zip(differences, ACTIVATIONS, strict=True)) < (2e-5, "")
    assert len({row.tobytes() for row in found}) == len(ACTIVATIONS) - 1  # CELU's alpha of 1 makes it ELU


def test_none_of_them_has_weights_or_chance():
    seen = torch.linspace(-3, 3, 100)
    for kind in ACTIVATIONS.values():
        made = kind().train()
        assert not list(made.parameters())
        assert torch.equal(made(seen), made(seen))


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["ppo", "td3"])
def test_a_name_in_the_hyperparameters_is_what_is_trained_and_exported(algorithm, tmp_path):
    agent = train_tiny(algorithm, tmp_path / "run", with_activation(algorithm, "ELU"))
    for file in (tmp_path / "run" / "run.json", agent / "agent.json"):
        told = json.loads(file.read_text())["hyperparameters"]
        assert told["policy_kwargs"] == {"net_arch": [8], "activation_fn": "ELU"}
    assert load_agent(agent).about["largest_difference"] < 1e-5
    assert b"Elu" in (agent / "policy.onnx").read_bytes()


def test_a_search_space_may_hold_names(tmp_path):
    line = "policy_kwargs.activation_fn: {kind: choice, choices: [Tanh, Mish]}"
    (tmp_path / "space.yml").write_text(line)
    space = load_space("ppo", tmp_path / "space.yml")
    held = with_activation("ppo", "Mish")
    assert space.params_of(held) == {"policy_kwargs.activation_fn": "Mish"}
    values = space.values({"policy_kwargs.activation_fn": "Mish"})
    assert isinstance(
        a_model("ppo", merged(settings("ppo"), values)).policy.mlp_extractor.policy_net[1], nn.Mish
    )


def test_both_sides_of_maddpg_take_it():
    policy = {"net_arch": [8, 8], "activation_fn": "SiLU"}
    given = {"policy": "JointPolicy", "n_envs": 2, "n_timesteps": 10, "policy_kwargs": policy}
    parameters = load_hyperparameters("maddpg", DUEL, given)
    model = make_model("maddpg", make_sb3_duel(2, 0), parameters, 0)
    for network in (*model.policy.actors, *model.policy.critics):
        assert sum(isinstance(layer, nn.SiLU) for layer in network.modules()) >= 1
        assert not any(isinstance(layer, nn.ReLU) for layer in network.modules())


@pytest.mark.parametrize(
    ("found", "message"),
    [
        ("Rellu", "unknown activation 'Rellu'; did you mean 'ReLU'"),
        ("relu", "did you mean 'ReLU'"),
        ("LEAKYRELU", "did you mean 'LeakyReLU'"),
        ("Softmax", "unknown activation 'Softmax'; "),
        ("torch.nn.ReLU", "unknown activation 'torch.nn.ReLU'; "),
        ("__import__('os').system('touch evaluated')", "unknown activation .*; known: CELU, ELU"),
        (3, "expected the name of an activation, ReLU for instance, got 3"),
        (None, "expected the name of an activation"),
        (str, "expected the name of an activation"),
    ],
)
def test_what_is_no_activation_is_one_line_and_nothing_is_begun(found, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=f"hyper-parameters of ppo: activation_fn: .*({message})") as told:
        train_tiny("ppo", tmp_path / "run", with_activation("ppo", found))
    assert "\n" not in str(told.value)
    assert not list(tmp_path.iterdir())


def test_a_class_of_torch_s_is_taken_from_python():
    assert as_activation(nn.GELU, "here") is nn.GELU


def with_activation(algorithm, found):
    return settings(algorithm, policy_kwargs={"net_arch": [8], "activation_fn": found})


def a_model(algorithm, values):
    parameters = load_hyperparameters(algorithm, ALLY, values)
    return make_model(algorithm, make_games(ALLY, parameters, 0), parameters, 0)
