import json
import pickle
import shutil
import zipfile
from collections import OrderedDict
from functools import partial

import numpy as np
import pytest
import torch
import yaml
from stable_baselines3 import PPO, TD3
from stable_baselines3.common.vec_env import VecFrameStack

import fpg_bench
from fpg_bench.cli.training import export
from fpg_bench.common.errors import UserError
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import agent_folder, load_agent
from fpg_bench.products.sb3_zip.zip_file import load_zip
from fpg_bench.training.export import export_agent
from tests.training.tiny import ALLY, train_tiny

OF_AN_AGENT = ["agent.json", "policy.onnx"]
ID = "FPG/OpponentVsScripted-v0"
export_verb = partial(export, game={})
SMALL = {"net_arch": [16, 8]}
SEEN = np.random.default_rng(0).uniform(-1, 1, (5, 15)).astype(np.float32)


def games(frames=1, view=ID):
    made = fpg_bench.make_sb3(view, 2, 0)
    return made if frames == 1 else VecFrameStack(made, frames)


def saved(kind, folder, frames=1, **options):
    model = kind("MlpPolicy", games(frames), device="cpu", seed=1, **options)
    model.save(folder / "model.zip")
    return model


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "algorithm", "frames", "options"),
    [
        (PPO, "ppo", 3, {"policy_kwargs": SMALL | {"activation_fn": torch.nn.ELU}}),
        (TD3, "td3", 1, {"policy_kwargs": SMALL | {"n_critics": 1}, "buffer_size": 10}),
    ],
)
def test_a_zip_is_read_without_its_pickles(kind, algorithm, frames, options, tmp_path, monkeypatch):
    model = saved(kind, tmp_path, frames, **options)
    load_zip(tmp_path / "model.zip", algorithm, ID)  # compiles the game, whose cache is pickled
    with monkeypatch.context() as without:
        without.setattr(pickle, "loads", None)
        without.setattr("cloudpickle.loads", None)
        found = load_zip(tmp_path / "model.zip", algorithm, ID)
    assert export_agent(found, tmp_path / "seed_0", training_seed=0) < 1e-5
    seen = np.zeros((5, 15 * frames), np.float32)
    seen[:, -15:] = SEEN
    theirs = model.predict(seen, deterministic=True)[0]
    assert np.abs(load_agent(tmp_path / "seed_0").predict(SEEN)[0] - theirs).max() < 1e-5


def test_a_zip_that_cannot_be_read_safely_names_the_alternative(tmp_path):
    sigmoid = SMALL | {"activation_fn": torch.nn.LogSigmoid}
    for options, algorithm, message in (
        ({"use_sde": True}, "ppo", "use_sde"),
        ({"policy_kwargs": sigmoid}, "ppo", "activation is 'LogSigmoid'"),
        ({"policy_kwargs": SMALL | {"normalize_images": False}}, "ppo", "normalize_images"),
        ({}, "sac", "no plain MlpPolicy of sac"),
        ({}, "dqn", "algorithm 'dqn'"),
    ):
        saved(PPO, tmp_path, **options)
        with pytest.raises(UserError, match=message) as raised:
            load_zip(tmp_path / "model.zip", algorithm, ID)
        assert "fpg_bench.export_agent(model, folder" in str(raised.value)


def test_a_file_that_is_no_model_is_refused_before_its_options(tmp_path):
    for name in ("text.zip", "other.zip", "normalize.pkl"):
        (tmp_path / name).write_text("no zip")
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as archive:
        archive.writestr("data", json.dumps({}))
    for name in ("text.zip", "other.zip"):
        with pytest.raises(UserError, match="is not a zip written by save"):
            load_zip(tmp_path / name, "ppo", ID)
    with pytest.raises(UserError, match=r"normalize\.pkl is not a zip .* that of a run is model\.zip"):
        export_verb(tmp_path / "normalize.pkl", tmp_path / "mine")
    with pytest.raises(UserError, match="nowhere does not exist"):
        export_verb(tmp_path / "nowhere", tmp_path / "mine")


@pytest.mark.slow
def test_export_reads_runs_and_zips(tmp_path, capsys):
    train_tiny("ppo", tmp_path / "run", seed=3)
    mine = tmp_path / "mine"
    export_verb(tmp_path / "run", mine / "seed_3")
    assert capsys.readouterr().out.startswith(f"agent: {mine}/seed_3\nlargest difference from predict(): ")
    assert load_agent(mine / "seed_3").card.training_seed == 3
    with pytest.raises(UserError, match="holds an agent"):
        export_verb(tmp_path / "run", mine / "seed_3")
    shutil.copy(tmp_path / "run" / "model.zip", tmp_path / "model.zip")
    with pytest.raises(UserError, match="--not-normalized"):
        export_verb(tmp_path / "model.zip", mine / "seed_7", algo="ppo")
    plain = {"algo": "ppo", "not_normalized": True}
    with pytest.raises(UserError, match=r"--algo ppo.*; add --seed.*; add --id and.*; add --not-normalized"):
        export_verb(tmp_path / "model.zip", mine)
    with pytest.raises(UserError, match=r"statistics are in .*/normalize\.npz; export the run, .*/run"):
        export_verb(tmp_path / "run" / "model.zip", mine / "seed_7", **plain)
    for told in ({}, {"env_id": ALLY}):
        with pytest.raises(UserError, match="does not name its game; add --id and --scenario"):
            export_verb(tmp_path / "model.zip", mine / "seed_7", **plain, **told)
    with pytest.raises(UserError, match="scenario: is of the game of --id, which is not given"):
        export_verb(tmp_path / "model.zip", mine / "seed_7", **plain, game={"scenario": "link"})
    export_verb(tmp_path / "model.zip", mine / "seed_7", **plain, env_id=ALLY, game={"scenario": "standard"})
    assert load_agent(mine / "seed_7").card.training_seed == 7
    assert load_agent(mine / "seed_7").card.game == GameSpec(ALLY, scenario="standard")


def write_as_rl_zoo3(folder, options=None, **config):
    """The files that rl-zoo3 writes beside a zip."""
    args = {"algo": "ppo", "env": ID, "env_kwargs": options, "seed": 5}
    (folder / "files").mkdir(parents=True)
    for name, content in (("args", args), ("config", config)):
        (folder / f"files/{name}.yml").write_text(yaml.dump(OrderedDict(content)))
    (folder / "files/vecnormalize.pkl").write_bytes(b"never opened")


def test_a_zip_of_rl_zoo3_needs_no_options_but_that_of_normalized_observations_is_refused(tmp_path):
    kinds = {"plain": {"norm_obs": False}, "normalized": {}, "as_text": "dict(norm_obs=True)"}
    for name, config in kinds.items():
        write_as_rl_zoo3(tmp_path / name, {"path": "circle"}, policy="MlpPolicy", normalize=config)
        saved(PPO, tmp_path / name, policy_kwargs=SMALL)
    export_verb(tmp_path / "plain/model.zip", tmp_path / "mine")
    card = load_agent(tmp_path / "mine").card
    assert (card.game, card.training_seed) == (GameSpec(ID, scenario="standard", path="circle"), 5)
    assert card.algorithm == "ppo"
    for name in ("normalized", "as_text"):
        with pytest.raises(UserError, match=r"statistics are in .*files/vecnormalize\.pkl, a pickle, never"):
            export_verb(tmp_path / name / "model.zip", tmp_path / "other", not_normalized=True)
    (tmp_path / "plain/files/args.yml").write_text("!!python/object/apply:os.system [exit]")
    with pytest.raises(UserError, match=r"args\.yml: not valid YAML"):
        export_verb(tmp_path / "plain/model.zip", tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_a_model_of_another_game_is_not_asked_for_options(tmp_path):
    PPO("MlpPolicy", "CartPole-v1", device="cpu").save(tmp_path / "model.zip")
    with pytest.raises(UserError, match=r"reads 4 numbers, and no game .*; train a model in a game first"):
        export_verb(tmp_path / "model.zip", tmp_path / "mine")


def test_a_zip_in_the_folder_of_its_run_has_the_run_s_game(tmp_path):
    game = GameSpec("FPG/AllyVsPolicy-v0", scenario="link", opponent=("tone", "sweep"))
    model = PPO("MlpPolicy", fpg_bench.make_sb3(game), device="cpu", policy_kwargs=SMALL)
    model.save(tmp_path / "model.zip")
    about = {"algorithm": "ppo", "game": game.to_dict() | {"opponent": ["tone", "mine:Player"]}}
    (tmp_path / "run.json").write_text(json.dumps(about))
    export_verb(tmp_path / "model.zip", tmp_path / "seed_2", algo="ppo", not_normalized=True)
    card = load_agent(tmp_path / "seed_2").card
    assert card.scenario == game.resolve().hash
    assert card.game.opponent == ("tone", "mine:Player")  # named, not imported


def test_export_of_a_folder_of_runs_is_one_agent_for_each_seed(tmp_path):
    for k in (0, 1):
        shutil.copytree(agent_folder(f"ally-scripted/ppo/seed_{k}"), tmp_path / f"runs/seed_{k}/agent")
    (tmp_path / "runs/seed_2").mkdir()
    with pytest.raises(UserError, match="seed_2 holds no agent; is the run finished"):
        export_verb(tmp_path / "runs", tmp_path / "mine")
    assert not (tmp_path / "mine").exists()
    (tmp_path / "runs/seed_2").rmdir()
    with pytest.raises(UserError, match=r"lies in the agent .*seed_0/agent; name a folder outside of it"):
        export_verb(tmp_path / "runs", tmp_path / "runs/seed_0/agent")
    assert sorted(path.name for path in (tmp_path / "runs/seed_0/agent").iterdir()) == OF_AN_AGENT
    with pytest.raises(UserError, match="name a folder outside of it"):
        export_verb(tmp_path / "runs/seed_0", tmp_path / "runs/seed_0/agent")
    export_verb(tmp_path / "runs", tmp_path / "mine")
    assert [load_agent(tmp_path / f"mine/seed_{k}").card.training_seed for k in (0, 1)] == [0, 1]
