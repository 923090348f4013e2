import dataclasses
from functools import partial

import numpy as np
import onnx
import pytest
import torch
from sb3_contrib import QRDQN, TQC, MaskablePPO, RecurrentPPO
from stable_baselines3 import A2C, DQN, PPO, SAC, TD3
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, FlattenExtractor
from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize
from torch import nn

from fpg_bench import make_sb3
from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.game.scenario import STANDARD
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import OnnxPlayer, load_agent
from fpg_bench.players.registry import as_player
from fpg_bench.training.export import (
    export_agent,
    export_onnx,
    exported_player,
    largest_difference,
    write_exported,
)
from fpg_bench.training.models import ACTIVATIONS

ABOUT = {
    "algorithm": "x",
    "game": {"id": "FPG/AllyVsScripted-v0"},
    "scenario": "0" * 64,
    "training_seed": 0,
    "training_steps": 0,
}
SMALL = {"net_arch": [16, 16]}


def a_model(algorithm, normalized=False, frames=1, games=None, **options):
    games = games or make_sb3("FPG/AllyVsScripted-v0", n_envs=4, seed=1)
    if frames > 1:
        games = VecFrameStack(games, frames)
    if normalized:
        games = VecNormalize(games)
        games.reset()
        for _ in range(50):
            games.step(np.random.default_rng(0).uniform(-1, 1, (4, 9)).astype(np.float32))
    policy = "MlpLstmPolicy" if algorithm is RecurrentPPO else "MlpPolicy"
    kwargs = SMALL | options.pop("policy_kwargs", {})
    model = algorithm(policy, games, seed=0, policy_kwargs=kwargs, device="cpu", **options)
    for parameter in model.policy.parameters():
        parameter.data += 0.3 * parameter.data.new_tensor(
            np.random.default_rng(1).normal(size=parameter.shape)
        )
    return model


SHARED = {"lstm_hidden_size": 6, "shared_lstm": True, "enable_critic_lstm": False}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "frames", "normalized", "options"),
    [
        (PPO, 8, False, {}),
        (PPO, 1, True, {"use_sde": True}),
        (A2C, 1, True, {}),
        (SAC, 3, True, {}),
        (TD3, 1, True, {}),
        (TQC, 1, False, {}),
        (RecurrentPPO, 1, False, {"policy_kwargs": {"lstm_hidden_size": 6, "n_lstm_layers": 2}}),
        (RecurrentPPO, 3, True, {"policy_kwargs": SHARED}),
    ],
    ids=["ppo-stack8", "ppo-sde", "a2c", "sac-stack3", "td3", "tqc", "lstm", "lstm-stack3"],
)
def test_agents_play_as_the_model_does_in_its_own_games(algorithm, frames, normalized, options, tmp_path):
    """Over 220 steps of SB3's own stacking and normalising, in rounds that end at different steps."""
    model = a_model(algorithm, normalized, frames, **options)
    assert write_exported(model, tmp_path, ABOUT) < 1e-5
    games = make_sb3("FPG/AllyVsScripted-v0", n_envs=4, seed=5, stagger=True)
    check_plays_alike(model, [load_agent(tmp_path)], games, 220, frames)


def check_plays_alike(model, players, games, steps, frames=1):
    """Check that players act as the model predicts in games, where two rounds end."""
    core, wrapped = games.core, VecFrameStack(games, frames) if frames > 1 else games
    if (normalize := model.get_vec_normalize_env()) is not None:
        wrapped = VecNormalize(wrapped, training=False)
        wrapped.obs_rms = normalize.obs_rms
    masks = {"action_masks": np.tile(core.choices.mask, (4, 1))} if isinstance(model, MaskablePPO) else {}
    seen, memory, memories, starts = wrapped.reset(), None, [None] * len(players), np.ones(4, bool)
    rounds, spread = 0, []
    for _ in range(steps):
        numbers = getattr(core.duel.batch, f"{core.side}_observations").copy()
        actions, memory = model.predict(seen, memory, starts, deterministic=True, **masks)
        expected = actions if core.choices is None else core.choices.decode(actions, numbers)
        for index, player in enumerate(players):
            answer, memories[index] = player.predict(numbers, memories[index], starts)
            assert np.abs(answer - expected).max() < 1e-4
        spread.append(expected)
        seen, _, starts, _ = wrapped.step(actions)
        rounds += starts.sum()
    assert rounds == 2
    assert np.ptp(spread, axis=0).max() > 0.01


def discrete_games(mode="discrete", **options):
    """Games of an opponent that flies itself and may not jam by broadband."""
    options = {"path": "learned", "jamming_types": ("tone", "narrowband", "comb"), **options}
    return make_sb3("FPG/OpponentVsScripted-v0", n_envs=4, seed=1, actions=mode, **options)


@pytest.mark.full
@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "mode", "options"),
    [
        (PPO, "multi-discrete", {}),
        (DQN, "discrete", {}),
        (QRDQN, "discrete", {"policy_kwargs": {"n_quantiles": 5}}),
        (MaskablePPO, "multi-discrete", {}),
        (RecurrentPPO, "discrete", {"policy_kwargs": {"lstm_hidden_size": 6}}),
    ],
    ids=["ppo", "dqn", "qr-dqn", "maskable-ppo", "lstm"],
)
def test_discrete_agents_play_the_choices_that_the_model_predicts(algorithm, mode, options, tmp_path):
    allowed = {} if algorithm is MaskablePPO else {"jamming_types": None}
    model = a_model(algorithm, frames=2, games=discrete_games(mode, **allowed), **options)
    assert write_exported(model, tmp_path, ABOUT | {"id": "FPG/OpponentVsScripted-v0"}) < 1e-5
    check_no_paths((tmp_path / "policy.onnx").read_bytes())
    player = load_agent(tmp_path)
    assert player.card.game.actions == mode
    check_plays_alike(model, [player], discrete_games(mode, stagger=True, **allowed), 220, 2)


@pytest.mark.full
def test_agents_hop_to_the_points_that_their_games_draw(tmp_path):
    """In games that end at different steps: exported, sandboxed, by predict and as the model itself."""
    games = make_sb3("FPG/AllyVsScripted-v0", n_envs=4, seed=1, stagger=True, actions="uniform-hop")
    model = a_model(PPO, frames=2, games=games)
    assert export_agent(model, tmp_path, training_seed=0) < 1e-6
    agent = load_agent(tmp_path)
    assert (agent.noise_size, agent.card.game.actions) == (1, "uniform-hop")
    others = [load_agent(tmp_path, trusted=False), exported_player(model), model]
    rows = evaluate(
        {"agent": agent} | {str(k): other for k, other in enumerate(others)}, "ally-v2", matches=2
    )
    assert len({row.score for row in rows}) == 1
    assert rows[0].pooled.measures["hop_rate"] > 0.01


def test_a_users_own_dqn_is_exported_and_evaluated(tmp_path):
    model = DQN("MlpPolicy", "FPG/AllyVsScriptedDiscrete-v0", policy_kwargs=SMALL, seed=0, device="cpu")
    assert export_agent(model, tmp_path / "agent", training_seed=0) == 0
    assert load_agent(tmp_path / "agent").card.game.id == "FPG/AllyVsScripted-v0"
    both = {"model": model, "agent": str(tmp_path / "agent")}
    returns = {row.entry: row.score for row in evaluate(both, "ally-v2", matches=2)}
    assert returns["model"] == returns["agent"]
    model.save(tmp_path / "model.zip")
    loaded = DQN.load(tmp_path / "model.zip")  # without games
    for game in (None, "FPG/AllyVsScriptedDiscrete-v0"):  # of a scenario that nothing tells
        with pytest.raises(UserError, match="give the game that it was trained in, as game=GameSpec"):
            export_agent(loaded, tmp_path / "other", training_seed=0, game=game)
    game = GameSpec("FPG/AllyVsScriptedDiscrete-v0", scenario="standard")
    export_agent(loaded, tmp_path / "other", training_seed=0, game=game)
    files = [(tmp_path / name / "policy.onnx").read_bytes() for name in ("agent", "other")]
    assert files[0] == files[1]
    game = GameSpec("FPG/OpponentVsScriptedDiscrete-v0", scenario="standard")
    with pytest.raises(UserError, match="the model chooses from Discrete"):
        export_agent(loaded, tmp_path / "other", training_seed=0, game=game)


def test_a_model_without_its_games_has_the_choices_of_its_scenario(tmp_path):
    game = GameSpec("FPG/OpponentVsScriptedDiscrete-v0", scenario="link")
    model = DQN("MlpPolicy", make_sb3(game), policy_kwargs=SMALL, seed=0, device="cpu")
    export_agent(model, tmp_path / "agent", training_seed=0)
    model.save(tmp_path / "model.zip")
    export_agent(DQN.load(tmp_path / "model.zip"), tmp_path / "other", training_seed=0, game=game)
    cards = [load_agent(tmp_path / name).card.to_dict() for name in ("agent", "other")]
    assert cards[0]["scenario"] != STANDARD.hash
    assert cards[0] == cards[1]
    on_standard = dataclasses.replace(game, scenario="standard")
    export_agent(DQN.load(tmp_path / "model.zip"), tmp_path / "wrong", training_seed=0, game=on_standard)
    files = [(tmp_path / name / "policy.onnx").read_bytes() for name in ("agent", "other", "wrong")]
    assert files[0] == files[1] != files[2]


@pytest.mark.slow
def test_memory_gives_the_same_bits_in_a_batch_and_alone():
    model = a_model(RecurrentPPO, True, 3, policy_kwargs={"lstm_hidden_size": 6})
    player = OnnxPlayer(export_onnx(model))
    seen = np.random.default_rng(0).uniform(-1, 1, (20, 33, 15)).astype(np.float32)
    pairs, memory, alone = [], None, None
    for row in seen:
        actions, memory = player.predict(row, memory)
        single, alone = player.predict(row[7:8], alone)
        pairs.append((actions[7], single[0]))
    assert all((a == b).all() for a, b in pairs)
    assert (memory[0][7] == alone[0][0]).all()


def check_no_paths(data):
    assert b"site-packages" not in data
    assert b".py" not in data
    proto = onnx.load_from_string(data)
    assert not proto.metadata_props
    assert not any(node.metadata_props or node.doc_string for node in proto.graph.node)


def test_models_of_another_kind_are_refused():
    for word in ({"batch_first": True}, {"bidirectional": True}, {"proj_size": 3}):
        model = a_model(RecurrentPPO, policy_kwargs={"lstm_hidden_size": 6, "lstm_kwargs": word})
        with pytest.raises(UserError, match=f"lstm_kwargs: .*{next(iter(word))}"):
            export_onnx(model)
    with pytest.raises(UserError, match="has no games that define the choices"):
        export_onnx(DQN("MlpPolicy", "CartPole-v1", device="cpu"))


@pytest.mark.slow
def test_an_export_that_plays_differently_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("fpg_bench.training.export.largest_difference", lambda *a, **k: float("nan"))
    with pytest.raises(UserError, match="differs"):
        write_exported(a_model(PPO), tmp_path / "agent", ABOUT)
    assert not (tmp_path / "agent").exists()


ACTIVATION_CHANGES = (
    partial(nn.GELU, approximate="tanh"),
    partial(nn.LeakyReLU, 0.3),
    partial(nn.Hardtanh, -0.5, 0.7),
    partial(nn.CELU, 0.7),
    partial(nn.Softshrink, 0.2),
)


@pytest.mark.parametrize("kind", [*ACTIVATIONS.values(), *ACTIVATION_CHANGES])
def test_all_activations_are_written(kind):
    model = a_model(PPO, policy_kwargs={"activation_fn": kind})
    assert largest_difference(model, exported_player(model)) < 1e-5


def test_an_lstm_without_biases_is_written():
    words = {"lstm_hidden_size": 6, "lstm_kwargs": {"bias": False}}
    model = a_model(RecurrentPPO, policy_kwargs=words)
    assert largest_difference(model, exported_player(model)) < 1e-5


class Mixed(BaseFeaturesExtractor):
    """An extractor of the user's own, of known layers and operators."""

    def __init__(self, observation_space, scale=1.0):
        super().__init__(observation_space, 21)
        self.scale = scale
        self.shift = nn.Parameter(torch.linspace(-0.5, 0.5, 15))
        self.layers = nn.Sequential(nn.Linear(5, 4), nn.SiLU())
        self.windows = nn.Sequential(nn.Conv2d(1, 3, (2, 3), (1, 2), (1, 0), bias=False), nn.Flatten())

    def forward(self, observations):
        shifted = self.scale * (observations - self.shift) / 2
        parts = [self.layers(shifted[:, 3:8]), torch.tanh(shifted[:, 13:]), 1 - shifted]
        seen = torch.cat(parts, dim=1)
        return seen + 0 * self.windows(seen.reshape(-1, 1, 3, 7)).sum(1).clip(-1, 1).unsqueeze(1)


def test_an_extractor_of_known_layers_is_written_from_its_code(tmp_path):
    options = {"features_extractor_class": Mixed, "features_extractor_kwargs": {"scale": 1.7}}
    model = a_model(PPO, policy_kwargs=options)
    assert write_exported(model, tmp_path, ABOUT) < 1e-5
    assert load_agent(tmp_path, trusted=False).card.algorithm == "x"  # as the board takes it


class Sorted(FlattenExtractor):
    """Layers of a user's own, by a function that is not written."""

    def forward(self, observations):
        return super().forward(observations).sort(1).values


class Gapped(FlattenExtractor):
    """Takes every second number of the first fourteen, and stays as wide."""

    def forward(self, observations):
        return torch.cat([observations[:, :14:2], observations[:, 7:]], dim=1)


def with_layer(layer):
    def change(model):
        model.policy.mlp_extractor.policy_net[1] = layer

    return change


def hooked(model):
    model.policy.action_net.register_forward_hook(lambda module, seen, output: 2 * output)


@pytest.mark.parametrize(
    ("options", "change", "message"),
    [
        ({"features_extractor_class": Sorted}, None, r"Sorted cannot be written as ONNX \(AttributeError"),
        ({"features_extractor_class": Gapped}, None, "only the last axis is cut, without gaps"),
        ({"activation_fn": nn.PReLU}, None, "PReLU cannot be written"),
        ({}, with_layer(nn.Softplus(beta=2)), r"Softplus cannot be written as ONNX \(has beta 2"),
        ({}, with_layer(nn.Flatten(0, 0)), r"Flatten cannot be written as ONNX \(flattens 0 to 0"),
        ({}, hooked, "has hooks or replaced methods"),
    ],
    ids=["own", "gapped", "prelu", "softplus", "flatten", "hooked"],
)
def test_networks_that_are_not_written_are_refused_and_play_by_their_predict(options, change, message):
    model = a_model(PPO, policy_kwargs=options)
    if change:
        change(model)
    with pytest.raises(UserError, match=f"{message}.*agent of it with fpg_bench.write_agent"):
        export_onnx(model)
    (row,) = evaluate({"mine": model}, "ally-v2", matches=1)
    assert np.isfinite(row.score.value)


class Shy(PPO):
    """A model that does not play what its network says."""

    def predict(self, *args, **kwargs):
        actions, state = super().predict(*args, **kwargs)
        return 0 * actions, state


def test_a_live_model_plays_as_its_export_unless_its_predict_says_otherwise(tmp_path):
    model = a_model(PPO, True, 2)
    export_agent(model, tmp_path, training_seed=0)
    assert isinstance(as_player(model, "ally", STANDARD), OnnxPlayer)
    rows = evaluate({"live": model, "agent": str(tmp_path)}, "ally-v2", matches=1)
    assert len({row.score.value for row in rows}) == 1
    shy = a_model(Shy)
    assert not isinstance(player := as_player(shy, "ally", STANDARD), OnnxPlayer)
    assert not player.predict(np.ones((1, 15), np.float32))[0].any()
