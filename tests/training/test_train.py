import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from stable_baselines3 import PPO
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import fpg_bench
from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import ENVS
from fpg_bench.common.rows import RowFile
from fpg_bench.envs.sb3_vec_env import make_sb3
from fpg_bench.evaluation.policy_evaluator import PolicyEvaluator
from fpg_bench.players.agent import baselines_folder, load_agent
from fpg_bench.training.algorithms import ALGORITHMS
from fpg_bench.training.callbacks import LOGGED_MEASURES
from fpg_bench.training.checkpoint import newest_checkpoint
from fpg_bench.training.export import export_onnx
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import make_model
from tests.training.tiny import settings, train, train_tiny

TINY = """\
FPG/AllyVsScripted-v0:
  policy: MlpPolicy
  n_envs: 4
  n_timesteps: 2400
  normalize: {norm_obs: true, norm_reward: true}
  n_steps: 300
  batch_size: 300
  n_epochs: 1
  policy_kwargs: {net_arch: [8]}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("train")
    (folder / "tiny.yml").write_text(TINY)
    train(
        "ppo",
        "FPG/AllyVsScripted-v0",
        folder / "run",
        seed=3,
        hyperparams=folder / "tiny.yml",
        evaluations=2,
    )
    return folder / "run"


@pytest.mark.slow
def test_a_run_says_how_it_was_made(run):
    about = json.loads((run / "run.json").read_text())
    assert about["finished"]
    command = "fpg-bench train ppo FPG/AllyVsScripted-v0 --seed 3 --steps 2400 --hyperparams"
    assert about["command"] == f"{command} {run.parent / 'tiny.yml'}"
    assert about["steps_done"] == 2400
    assert about["hyperparameters"]["n_steps"] == 300
    assert about["versions"]["torch"].startswith("2.")
    assert about["suite"] == "ally-v1"
    assert about["scenario_fields"] == {}
    assert 2400 / about["steps_per_s"] == pytest.approx(about["seconds"], abs=0.06)  # written in tenths
    assert (run / "model.zip").exists()
    assert (run / "normalize.pkl").exists()
    assert not (run / "checkpoints").exists()


@pytest.mark.slow
def test_its_git_revision_is_that_of_the_code(run):
    root = Path(fpg_bench.__file__).parents[1]
    if not (root / ".git").exists():
        pytest.skip("not a checkout")
    head = subprocess.check_output(["git", "rev-parse", "HEAD"], cwd=root, text=True).strip()
    assert json.loads((run / "run.json").read_text())["revision"].rstrip("+") == head


@pytest.mark.slow
def test_it_says_how_good_its_policy_was_on_the_way(run):
    rows = RowFile(run / "evaluations.jsonl").read()
    assert [row["steps"] for row in rows] == [0, 1200, 2400]
    for row in rows:
        assert row.keys() == {"side", "steps", "seconds", "score", "return", "rivals", "measures"}
        assert row["side"] == "ally"
        assert len(row["rivals"]) == 10
    seconds = [row["seconds"] for row in rows]
    assert seconds == sorted(seconds)
    assert rows[0]["score"] != rows[-1]["score"]
    assert (run / "curve.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_the_last_score_is_the_agents(run):
    found = PolicyEvaluator("ally-v1").score(load_agent(run / "agent"))
    assert found["score"] == pytest.approx(RowFile(run / "evaluations.jsonl").read()[-1]["score"], abs=2)


@pytest.mark.slow
def test_the_agent_plays_without_torch_or_sb3(run):
    player = load_agent(run / "agent", "ally")
    about = json.loads((run / "agent" / "agent.json").read_text())
    assert player.about == about
    assert (about["algorithm"], about["training_seed"], about["training_steps"]) == ("ppo", 3, 2400)


@pytest.mark.slow
def test_tensorboard_shows_the_game(run):
    events = EventAccumulator(str(run))
    events.Reload()
    tags = set(events.Tags()["scalars"])
    assert {f"game/{name}" for name in LOGGED_MEASURES} | {"rollout/ep_rew_mean", "suite/score"} <= tags
    assert {"outage", "capacity_mbit_s", "opponent_return"} < set(LOGGED_MEASURES)
    assert all(0 <= event.value <= 1 for event in events.Scalars("game/jamming_success_rate"))


@pytest.mark.slow
def test_a_finished_run_is_not_repeated_and_no_other_overwritten(run, tmp_path):
    before = (run / "run.json").read_text()
    arguments = ("ppo", "FPG/AllyVsScripted-v0", run)
    options = {"hyperparams": run.parent / "tiny.yml"}
    assert train(*arguments, seed=3, **options) == run / "agent"
    assert (run / "run.json").read_text() == before
    with pytest.raises(UserError, match="holds another run"):
        train(*arguments, seed=4, **options)
    (tmp_path / "other.yml").write_text(TINY.replace("[8]", "[9]"))
    with pytest.raises(UserError, match="other hyper-parameters"):
        train(*arguments, seed=3, hyperparams=tmp_path / "other.yml")
    with pytest.raises(UserError, match=r"with 2,400 steps, and its budget stays; .* --start"):
        train(*arguments, seed=3, steps=4800, resume=True, **options)
    about = json.loads(before) | {"finished": False}
    (tmp_path / "other.yml").unlink()
    (tmp_path / "run.json").write_text(json.dumps(about))
    with pytest.raises(UserError, match="unfinished"):
        train("ppo", "FPG/AllyVsScripted-v0", tmp_path, seed=3, **options)
    train("ppo", "FPG/AllyVsScripted-v0", tmp_path, seed=3, restart=True, **options)
    assert json.loads((tmp_path / "run.json").read_text())["finished"]
    with pytest.raises(UserError, match="no run's folder"):
        train("ppo", "FPG/AllyVsScripted-v0", run.parent, seed=3, **options)


@pytest.mark.slow
def test_a_run_that_was_killed_before_it_said_anything_begins_again(tmp_path):
    (tmp_path / "tiny.yml").write_text(TINY)
    (tmp_path / "run").mkdir()
    for left in ("evaluations.jsonl", ".run.json.ab12"):
        (tmp_path / "run" / left).touch()
    given = {"hyperparams": tmp_path / "tiny.yml"}
    train("ppo", "FPG/AllyVsScripted-v0", tmp_path / "run", resume=True, **given)
    assert json.loads((tmp_path / "run" / "run.json").read_text())["finished"]


def test_a_stopped_run_leaves_its_model(tmp_path, monkeypatch):
    (tmp_path / "tiny.yml").write_text(TINY)

    def stop(self):
        raise KeyboardInterrupt

    monkeypatch.setattr("fpg_bench.training.callbacks.GameMeasuresCallback._on_rollout_end", stop)
    with pytest.raises(KeyboardInterrupt):
        train(
            "ppo",
            "FPG/AllyVsScripted-v0",
            tmp_path / "run",
            hyperparams=tmp_path / "tiny.yml",
            evaluations=20,
        )
    assert newest_checkpoint(tmp_path / "run" / "checkpoints").name == f"{0:012d}"
    assert not json.loads((tmp_path / "run" / "run.json").read_text())["finished"]


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_shipped_hyperparameters_make_a_model_for_every_id(algorithm, monkeypatch):
    monkeypatch.setenv("FPG_LLM_BASE_URL", "http://127.0.0.1:9/v1")  # never asked
    monkeypatch.setenv("FPG_LLM_MODEL", "none")
    for env_id in ENVS:
        parameters = load_hyperparameters(algorithm, env_id)
        make_model(algorithm, make_sb3(env_id, n_envs=2), parameters, seed=0)


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
def test_actions_may_begin_with_a_noise_each():
    file = baselines_folder() / "hyperparams" / "ppo-learned.yml"
    parameters = load_hyperparameters("ppo", "FPG/OpponentVsScripted-v0", file)
    games = make_sb3("FPG/OpponentVsScripted-v0", n_envs=2, path="learned")
    model = make_model("ppo", games, parameters, seed=0)
    assert model.policy.log_std.tolist() == pytest.approx([-1.2] * 4 + [-3.5, -0.7] + [-2.0] * 3)


def test_shipped_files_hold_nothing_to_evaluate():
    for path in (baselines_folder() / "hyperparams").glob("*.yml"):
        words = [value for entry in yaml.safe_load(path.read_text()).values() for value in entry.values()]
        assert {word for word in words if isinstance(word, str)} <= {
            "MlpPolicy",
            "JointPolicy",
            "MlpLstmPolicy",
            "normal",
            "auto_0.1",
            "lin_0.005",
            "lin_0.0007",
        }, path


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("n_steps: 300", "n_step: 300", "unknown key 'n_step'; did you mean 'n_steps'"),
        ("n_steps: 300", "n_steps: 300\n  seed: 3", "unknown key 'seed'"),
        ("norm_obs", "norm_obz", "normalize: unknown key 'norm_obz'; did you mean 'norm_obs'"),
        ("net_arch", "net_arc", "net_arc"),
        ("net_arch", "log_std_init: [-1.0, 0.3], net_arch", "expected a number, or 9 of them"),
        ("n_steps: 300", "n_steps: 300\n  learning_rate: line_3", "or lin_<number>, got 'line_3'"),
        ("n_steps: 300", "n_steps: 300\n  learning_rate: 1e-3", "1.0e-4, not 1e-4"),
        ("n_steps: 300", "n_steps: 300\n  gamma: abc", "gamma: expected a number"),
        ("n_steps: 300", "n_steps: 2.5", "n_steps: expected a whole number"),
        ("norm_obs: true", "norm_obs: 3", "norm_obs: expected true or false"),
        ("norm_obs: true", "clip_obs: abc", "normalize: clip_obs: expected a number"),
        ("policy_kwargs: ", "policy_kwargs: 3  # ", "policy_kwargs: expected a mapping"),
        ("n_steps: 300", "n_steps: 300\n  noise_std: 0.1", "noise_type"),
        (
            "n_steps: 300",
            "n_steps: 300\n  noise_type: normal\n  noise_std: [1, 2]",
            "noise_std: expected a number",
        ),
        ("n_steps: 300", "n_steps: 300\n  frame_stack: 0", "frame_stack: expected a whole number"),
        ("n_envs: 4", "n_envs: four", "n_envs"),
        ("normalize: {norm_obs: true, norm_reward: true}", "normalize: true", "expected a mapping"),
        ("AllyVsScripted", "AllyVsScriptd", "did you mean 'FPG/AllyVsScriptd-v0'"),
    ],
)
def test_bad_hyperparameters(tmp_path, old, new, message):
    path = tmp_path / "mine.yml"
    path.write_text(TINY.replace(old, new))
    with pytest.raises(UserError, match=message):
        train("ppo", "FPG/AllyVsScripted-v0", tmp_path / "run", hyperparams=path)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("evaluations", [0, 2])
@pytest.mark.parametrize(
    "changes",
    [
        {"learning_rate": float("inf")},
        {"learning_rate": 30.0, "policy_kwargs": {"net_arch": [8], "log_std_init": -100.0}},
        {"learning_rate": float("inf"), "n_steps": 300},  # in the last update
    ],
    ids=["weights", "spread", "end"],
)
def test_training_that_diverges_is_one_line(changes, evaluations, tmp_path):
    with pytest.raises(UserError, match=r"run: training diverged by [\d,]+ steps, .* smaller learning_rate"):
        train_tiny("ppo", tmp_path / "run", changes, evaluations=evaluations)


@pytest.mark.parametrize("spread", [-200.0, float("nan")])
def test_a_policy_that_cannot_act_is_refused_before_anything_is_written(spread, tmp_path):
    torch.distributions.Distribution.set_default_validate_args(False)  # as torch.onnx.export leaves it
    changes = {"policy_kwargs": {"net_arch": [8], "log_std_init": spread}}
    with pytest.raises(UserError, match="hyper-parameters of ppo: the new policy draws no finite actions"):
        train_tiny("ppo", tmp_path / "run", changes)
    assert not (tmp_path / "run").exists()


def test_a_policy_that_the_exporter_refuses_is_refused_before_anything_is_written(tmp_path, monkeypatch):
    def broken(*args, **kwargs):
        raise RuntimeError("no such pass")

    monkeypatch.setattr(torch.onnx, "export", broken)
    mish = {"policy_kwargs": {"net_arch": [8], "activation_fn": "Mish"}}
    with pytest.raises(UserError, match=r"by torch .*, onnx .*, onnxscript .*: RuntimeError: no such pass$"):
        train_tiny("ppo", tmp_path / "run", mish)
    assert not (tmp_path / "run").exists()


def test_the_trial_export_leaves_chance_and_checks_as_they_are():
    games = make_sb3("FPG/AllyVsScripted-v0", n_envs=2, seed=0)
    words = {"activation_fn": torch.nn.Mish}  # for which the exporter is asked
    model = PPO("MlpPolicy", games, n_steps=4, batch_size=8, policy_kwargs=words)
    before = torch.get_rng_state()
    export_onnx(model)
    assert torch.equal(torch.get_rng_state(), before)
    with pytest.raises(ValueError, match="Expected parameter"):
        torch.distributions.Normal(0.0, -1.0)


def test_an_opponent_that_answers_nan_is_not_called_divergence(tmp_path):
    given = {"hyperparams": settings("ppo")}
    with pytest.raises(UserError, match="opponent action of game 0: index 0 is nan"):
        train("ppo", "FPG/AllyVsPolicy-v0", tmp_path / "run", opponent=Nowhere(), **given)


class Nowhere:
    """An opponent without an answer."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full((len(observation), 9), np.nan, np.float32), state


def test_unknown_words(tmp_path):
    with pytest.raises(UserError, match="did you mean 'ppo'"):
        train("pppo", "FPG/AllyVsScripted-v0", tmp_path)
    with pytest.raises(UserError, match="did you mean 'FPG/AllyVsScripted-v0'"):
        train("ppo", "FPG/AllyVsScript-v0", tmp_path)


@pytest.mark.parametrize(
    ("algorithm", "env_id", "words", "message"),
    [
        ("ppo", "FPG/duel_v0", {}, "ppo: trains one side, not both, as in FPG/duel_v0"),
        ("maddpg", "FPG/AllyVsScripted-v0", {}, "maddpg: trains both sides, in FPG/duel_v0"),
        ("maddpg", "FPG/duel_v0", {"suite": "ally-v1"}, "each side of FPG/duel_v0 is scored by its own"),
        ("maddpg", "FPG/duel_v0", {"opponent": "tone"}, "unexpected keyword argument 'opponent'"),
    ],
)
def test_one_side_or_both(tmp_path, algorithm, env_id, words, message):
    with pytest.raises(UserError, match=message):
        train(algorithm, env_id, tmp_path / "run", **words)
    assert not (tmp_path / "run").exists()
