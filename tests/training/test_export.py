import numpy as np
import onnx
import pytest
from stable_baselines3 import A2C, DQN, PPO, SAC, TD3
from stable_baselines3.common.vec_env import VecNormalize

from fpg_bench import make_sb3
from fpg_bench.errors import UserError
from fpg_bench.players.agent import load_agent
from fpg_bench.training.export import export_agent, export_onnx

ABOUT = {
    "algorithm": "x",
    "id": "FPG/AllyVsScripted-v0",
    "scenario": "0",
    "training_seed": 0,
    "training_steps": 0,
}
SMALL = {"net_arch": [16, 16]}


def a_model(algorithm, normalized=False, **options):
    games = make_sb3("FPG/AllyVsScripted-v0", n_envs=4, seed=1)
    if normalized:
        games = VecNormalize(games)
        games.reset()
        for _ in range(50):
            games.step(np.random.default_rng(0).uniform(-1, 1, (4, 9)).astype(np.float32))
    model = algorithm("MlpPolicy", games, seed=0, policy_kwargs=dict(SMALL), device="cpu", **options)
    for parameter in model.policy.parameters():
        parameter.data += 0.3 * parameter.data.new_tensor(
            np.random.default_rng(1).normal(size=parameter.shape)
        )
    return model


@pytest.mark.parametrize(
    ("algorithm", "options"),
    [(PPO, {}), (PPO, {"use_sde": True}), (A2C, {}), (SAC, {}), (TD3, {})],
    ids=["ppo", "ppo-sde", "a2c", "sac", "td3"],
)
@pytest.mark.parametrize("normalized", [False, True])
def test_exported_agents_play_as_the_model_predicts(algorithm, options, normalized, tmp_path):
    model = a_model(algorithm, normalized, **options)
    assert export_agent(model, tmp_path, ABOUT) < 1e-5
    player = load_agent(tmp_path)
    seen = np.random.default_rng(2).uniform(-1, 1, (7, 15)).astype(np.float32)
    normalize = model.get_vec_normalize_env()
    theirs = model.predict(normalize.normalize_obs(seen) if normalize else seen, deterministic=True)[0]
    ours = player.predict(seen)[0]
    assert np.abs(theirs - ours).max() < 1e-5
    assert np.ptp(ours, axis=0).max() > 0.05  # it reads what it sees


def test_nothing_of_this_machine_is_exported(tmp_path):
    data = export_onnx(a_model(PPO))
    assert b"site-packages" not in data
    assert b".py" not in data
    proto = onnx.load_from_string(data)
    assert not proto.metadata_props
    assert not any(node.metadata_props or node.doc_string for node in proto.graph.node)


def test_a_policy_of_another_kind_is_refused():
    model = DQN("MlpPolicy", "CartPole-v1", device="cpu")
    with pytest.raises(UserError, match="DQNPolicy"):
        export_onnx(model)


def test_an_export_that_plays_differently_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("fpg_bench.training.export.largest_difference", lambda *a: float("nan"))
    with pytest.raises(UserError, match="differs"):
        export_agent(a_model(PPO), tmp_path / "agent", ABOUT)
    assert not (tmp_path / "agent").exists()
