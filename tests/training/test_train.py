"""Training runs: their folders, evaluations and errors, several seeds, and progress without a terminal."""

import dataclasses
import json
import pickle
import re

import numpy as np
import pytest
import torch
import yaml
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from fpg_bench.cli.training import print_scores, train_runs
from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import DUEL
from fpg_bench.common.parallel import Workers
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.policy_evaluator import PolicyEvaluator
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import load_agent
from fpg_bench.training.algorithms import find_algorithm
from fpg_bench.training.callbacks import PLOTTED
from fpg_bench.training.config import RunConfig
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import parse_seeds, train_seeds
from tests.logged import logged
from tests.training.tiny import ALLY, EVALUATION_ROUNDS, SMALL, run_config, settings, train, train_tiny

POLICY = "FPG/OpponentVsPolicy-v0"


# The configuration


def test_a_configuration_is_a_value():
    config = RunConfig("ppo", GameSpec(ALLY, path="circle", knowledge="none"), seed=3)
    assert pickle.loads(pickle.dumps(config)) == config
    assert dataclasses.replace(config, seed=4).game == config.game
    assert config.spec.options() == {"path": "circle", "knowledge": "none"}


def test_the_other_side_is_named_once_and_a_suite_follows_from_the_side():
    assert run_config("ppo", POLICY, against="expert").spec.options() == {"ally": "expert"}
    with pytest.raises(UserError, match="against: names the ally, and so does ally"):
        run_config("ppo", POLICY, against="expert", ally="idle")
    with pytest.raises(UserError, match="both sides learn; omit it"):
        run_config("maddpg", DUEL, against="expert")
    assert RunConfig("maddpg", DUEL).suites() == ["ally-v2", "opponent-v2"]
    assert run_config("ppo", POLICY, path="learned").suites() == ["opponent-learned-v2"]
    assert RunConfig("ppo", ALLY, suite="ally-v2").suites() == ["ally-v2"]
    assert run_config("ppo", ALLY, path="circle", suite="ally-v2").suites() == ["ally-v2"]


@pytest.mark.parametrize(
    ("scenario", "suite", "said"),
    [("link", "ally-v2", "standard, the run link"), (None, "ally-link-v1", "link, the run standard")],
)
def test_a_suite_of_another_scenario_is_refused_by_name(scenario, suite, said):
    said = f"suite {suite}: plays {said}; name one of its scenario"
    with pytest.raises(UserError, match=said):
        run_config("ppo", ALLY, scenario=scenario, suite=suite).suites()


def test_a_score_in_a_scenario_of_ones_own_is_said_to_be_a_return(tmp_path, capsys):
    (tmp_path / "my.yml").write_text("snr_cap_db: 10\n")
    for scenario, what in (("standard", "score"), (tmp_path / "my.yml", "return per step against ally-v")):
        out = tmp_path / what
        train_tiny("ppo", out, scenario=str(scenario), evaluations=1)
        print_scores(RunFolder(out))
        assert capsys.readouterr().out.startswith(f"ally's {what}")


def test_an_id_of_discrete_actions_is_the_plain_id_with_an_option():
    config = RunConfig("dqn", "fpg_bench:FPG/AllyVsScriptedDiscrete-v0")
    assert config.spec == run_config("dqn", ALLY, actions="discrete").spec
    assert config.spec.to_dict() == {"id": ALLY, "actions": "discrete"}
    assert config.suites() == ["ally-v2"]
    with pytest.raises(UserError, match="the id says discrete, got 'continuous'"):
        run_config("dqn", "FPG/AllyVsScriptedDiscrete-v0", actions="continuous")


# A run's folder


@pytest.fixture(scope="module")
def hyperparams(tmp_path_factory):
    """A YAML file of hyper-parameters."""
    file = tmp_path_factory.mktemp("hyperparams") / "tiny.yml"
    file.write_text(yaml.safe_dump({ALLY: settings("ppo", n_timesteps=2400, n_steps=300, batch_size=300)}))
    return file


@pytest.fixture(scope="module")
def run(hyperparams):
    folder = hyperparams.parent / "run"
    train("ppo", ALLY, folder, seed=3, hyperparams=hyperparams, evaluations=2)
    return folder


@pytest.mark.slow
def test_a_finished_run_gets_its_picture_when_asked_again_and_never_fails_by_it(
    run, hyperparams, caplog, monkeypatch
):
    given = {"seed": 3, "hyperparams": hyperparams, "evaluations": 2, "resume": True}
    before = (run / "curve.png").read_bytes()
    (run / "curve.png").unlink()  # as after a kill between the agent and the picture
    with monkeypatch.context() as patched:
        patched.setattr("fpg_bench.products.rendering.curves.score_levels", lambda *given: 1 // 0)
        assert train("ppo", ALLY, run, **given) == run / "agent"
    assert caplog.messages == ["no curve.png: integer division or modulo by zero"]
    assert not (run / "curve.png").exists()
    train("ppo", ALLY, run, **given)
    assert (run / "curve.png").read_bytes() == before


@pytest.mark.slow
def test_a_run_describes_how_it_was_made(run, hyperparams):
    about = json.loads((run / "run.json").read_text())
    assert about["finished"]
    assert about["command"] is None  # but of Python
    assert about["steps_done"] == 2400
    assert about["hyperparameters"]["n_steps"] == 300
    assert about["versions"]["torch"].startswith("2.")
    assert about["suite"] == "ally-v2"
    assert about["scenario_fields"] == {}
    # Seconds are written in tenths, and the speed without a fraction
    assert about["seconds"] == pytest.approx(2400 / about["steps_per_s"], abs=0.06, rel=0.02)
    assert (run / "model.zip").exists()
    assert (run / "normalize.npz").exists()
    assert not (run / "checkpoints").exists()
    agent = load_agent(run / "agent", "ally").card.to_dict()
    assert (agent["algorithm"], agent["training_seed"], agent["training_steps"]) == ("ppo", 3, 2400)


@pytest.mark.slow
def test_the_policy_is_evaluated_during_training(run):
    rows = RowFile(run / "evaluations.jsonl").read()
    assert [row["steps"] for row in rows] == [0, 1200, 2400]
    for row in rows:
        assert row.keys() == {"side", "steps", "seconds", "score", "return", "rivals", "measures"}
        assert row["side"] == "ally"
        assert len(row["rivals"]) == 15
    seconds = [row["seconds"] for row in rows]
    assert seconds == sorted(seconds)
    assert rows[0]["score"] != rows[-1]["score"]
    assert (run / "curve.png").read_bytes().startswith(b"\x89PNG")
    result = PolicyEvaluator("ally-v2", EVALUATION_ROUNDS).score(load_agent(run / "agent"))
    assert result["score"] == pytest.approx(rows[-1]["score"], abs=2)


@pytest.mark.slow
def test_tensorboard_shows_the_game(run):
    events = EventAccumulator(str(run))
    events.Reload()
    tags = set(events.Tags()["scalars"])
    assert min(tags).startswith("eval/")  # listed first
    assert {"rollout/ep_rew_mean", "eval/score"} <= tags
    for group in ("eval", "game"):
        assert {f"{group}/{name}" for name in PLOTTED} <= tags
    assert len(tags) <= 40
    assert all(0 <= event.value <= 1 for event in events.Scalars("game/jamming_success_rate"))


@pytest.mark.slow
def test_a_finished_run_is_not_repeated_and_no_other_is_overwritten(run, hyperparams, tmp_path):
    before = (run / "run.json").read_text()
    options = {"hyperparams": hyperparams, "seed": 3}
    assert train("ppo", ALLY, run, **options) == run / "agent"
    assert (run / "run.json").read_text() == before
    with pytest.raises(UserError, match="holds another run"):
        train("ppo", ALLY, run, **options | {"seed": 4})
    with pytest.raises(UserError, match="which differs in hyperparameters;"):
        train("ppo", ALLY, run, **options | {"hyperparams": settings("ppo", n_timesteps=2400)})
    with pytest.raises(UserError, match=r"with 2,400 steps, and its budget cannot change; .* --start"):
        train("ppo", ALLY, run, steps=4800, resume=True, **options)
    (tmp_path / "run.json").write_text(json.dumps(json.loads(before) | {"finished": False}))
    with pytest.raises(UserError, match="unfinished"):
        train("ppo", ALLY, tmp_path, **options)
    train("ppo", ALLY, tmp_path, restart=True, **options)
    assert json.loads((tmp_path / "run.json").read_text())["finished"]
    with pytest.raises(UserError, match="holds other files, but no training run"):
        train("ppo", ALLY, run.parent, **options)


# Errors


@pytest.mark.parametrize(
    ("changes", "evaluations"),
    [
        ({"learning_rate": 1e30}, 2),
        ({"learning_rate": 30.0, "policy_kwargs": SMALL | {"log_std_init": -100.0}}, 0),
        ({"learning_rate": 1e30, "n_steps": 300}, 0),
    ],
    ids=["evaluation", "spread", "last update"],
)
def test_training_that_diverges_is_one_line(changes, evaluations, tmp_path):
    with pytest.raises(UserError, match=r"run: training diverged by [\d,]+ steps, .* smaller learning_rate"):
        train_tiny("ppo", tmp_path / "run", changes, evaluations=evaluations)


def test_a_policy_that_cannot_act_is_refused_before_anything_is_written(tmp_path):
    torch.distributions.Distribution.set_default_validate_args(False)  # as torch.onnx.export leaves it
    changes = {"policy_kwargs": SMALL | {"log_std_init": -200.0}}
    with pytest.raises(UserError, match="of ppo: the new policy draws no finite actions"):
        train_tiny("ppo", tmp_path / "run", changes)
    assert not (tmp_path / "run").exists()


def test_a_network_that_is_not_written_is_refused_before_anything_is_written(tmp_path):
    prelu = {"policy_kwargs": SMALL | {"activation_fn": torch.nn.PReLU}}
    with pytest.raises(UserError, match=r"PReLU cannot be written as ONNX .* with fpg_bench.write_agent"):
        train_tiny("ppo", tmp_path / "run", prelu)
    assert not (tmp_path / "run").exists()


class NaNPlayer:
    """An opponent whose actions are no numbers."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full((len(observation), 9), np.nan, np.float32), state


def test_an_opponent_with_nan_actions_is_not_called_divergence(tmp_path):
    with pytest.raises(UserError, match="opponent action of game 0: index 0 is nan"):
        train_tiny("ppo", tmp_path / "run", env_id="FPG/AllyVsPolicy-v0", opponent=NaNPlayer())


def test_unknown_and_impossible_options_are_refused(tmp_path):
    imitating = settings("dqn", imitate={"teacher": "expert"})
    for algorithm, env_id, options, message in (
        ("ppo", DUEL, {}, "ppo: trains one side, not both, as in FPG/duel_v0"),
        ("maddpg", ALLY, {}, "maddpg: trains both sides, in FPG/duel_v0"),
        ("maddpg", DUEL, {"suite": "ally-v2"}, "each side of FPG/duel_v0 is scored on its own suite"),
        ("maddpg", DUEL, {"opponent": "tone"}, "unexpected keyword argument 'opponent'"),
        ("dqn", ALLY, {"steps": 1000}, "add --actions discrete"),
        ("stable_baselines3:DQN", ALLY, {"steps": 1, "actions": "multi-discrete"}, "add --actions discrete"),
        ("sac", ALLY, {"steps": 1000, "actions": "discrete"}, "add --actions continuous"),
        (
            "dqn",
            ALLY,
            {"hyperparams": imitating, "actions": "discrete"},
            "only PPO and the like without an LSTM",
        ),
    ):
        with pytest.raises(UserError, match=message):
            train(algorithm, env_id, tmp_path / "run", **options)
    assert not (tmp_path / "run").exists()


def test_far_more_steps_than_were_asked_for_are_said(tmp_path):
    values = settings("ppo")
    rollout = values["n_envs"] * values["n_steps"]
    for steps, is_said in ((rollout + 1, True), (10 * rollout - 1, False)):
        with logged() as messages:
            train("ppo", ALLY, tmp_path / str(steps), hyperparams=values, steps=steps)
        line = f"steps: {2 * rollout:,} are played, not {steps:,}: a rollout is {rollout:,} steps "
        assert any(message.startswith(line) for message in messages) == is_said


# Several seeds


def train_several(out, seeds, *, workers=2, evaluations=0, **options):
    config = run_config("ppo", **{"hyperparams": settings("ppo")} | options)
    with logged() as messages:
        train_seeds(config, out, seeds, evaluations=evaluations, workers=workers)
    return messages


def test_several_seeds_say_how_far_each_is(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr("fpg_bench.common.output.LINE_EVERY_S", 0.0)
    train_several(tmp_path, [0, 2], workers=1)
    said = capfd.readouterr().err
    assert all(re.search(f"seed_{seed}, .* steps/s.*: 1,200 of 1,200\n", said) for seed in (0, 2))


@pytest.mark.process
def test_each_seed_is_trained_once_and_a_failure_does_not_hold_up_the_others(tmp_path):
    (tmp_path / "seed_2").mkdir()
    (tmp_path / "seed_2" / "mine.txt").touch()
    with pytest.raises(UserError, match=r"seed_2: .*holds other files, but no training run"):
        train_several(tmp_path, [0, 2], workers=1)
    (tmp_path / "seed_2" / "mine.txt").unlink()
    lines = train_several(tmp_path, [0, 2], workers=1)
    assert [line.split(":")[0] for line in lines] == ["seed_2"]
    for seed in (0, 2):
        assert load_agent(tmp_path / f"seed_{seed}" / "agent").card.training_seed == seed
    with pytest.raises(
        UserError, match="seed_0: holds this run with 1,200 steps, and its budget cannot change"
    ):
        train_several(tmp_path, [0, 2], steps=2400, workers=1)


@pytest.mark.process
def test_workers_train_the_policies_that_one_process_does(tmp_path):
    found = []
    for workers in (1, 2):
        train_several(tmp_path / str(workers), [0, 1], workers=workers)
        agents = [tmp_path / str(workers) / f"seed_{seed}" / "agent" for seed in (0, 1)]
        found.append([(agent / "policy.onnx").read_bytes() for agent in agents])
    assert found[0] == found[1]
    assert found[0][0] != found[0][1]


@pytest.mark.process
def test_several_seeds_have_one_curve(tmp_path):
    train_several(tmp_path, [0, 1], evaluations=1, workers=1)
    assert [path.parent for path in tmp_path.rglob("curve.png")] == [tmp_path]
    (tmp_path / "curve.png").unlink()
    (tmp_path / "seed_1" / "evaluations.jsonl").unlink()
    lines = train_several(tmp_path, [0, 1], evaluations=1, workers=1)
    assert any("no curve.png" in line and "seed_1 holds no evaluations" in line for line in lines)


@pytest.mark.process
def test_options_are_checked_before_any_seed_begins(tmp_path):
    with pytest.raises(UserError, match="'tonee' is not a script; did you mean 'tone'"):
        train_several(tmp_path, [0, 1], opponent="tonee")
    with pytest.raises(UserError, match="a language model plans for one run at a time"):
        train_several(tmp_path, [0], planner="llm")
    assert not list(tmp_path.glob("seed_*"))


def test_seeds_are_ranges_and_lists():
    assert [parse_seeds(text) for text in ("3-3", "0-2", "0,4-5")] == [[3], [0, 1, 2], [0, 4, 5]]
    for text in ("", "a", "1-", "-1", "3-1", "0,0", "1.5"):
        with pytest.raises(UserError, match="seeds: "):
            parse_seeds(text)
    with pytest.raises(UserError, match="--seed 5 for this seed alone, --seeds 0-4 for 5 seeds"):
        parse_seeds("5")
    with pytest.raises(UserError, match=r"--seed 1 for this seed alone$"):
        parse_seeds("1")


@pytest.mark.slow
def test_rivals_that_a_training_never_meets_are_named_before_it_and_not_once_it_is_finished(tmp_path, capsys):
    config = run_config("ppo", hyperparams=settings("ppo"))
    for is_told in (True, False):
        train_runs(config, tmp_path / "run", None, None, 1, False, False, Workers(1))
        said = capsys.readouterr().out
        assert ("of its 15 rivals are never met here" in said) == is_told
        assert ("already finished" in said) != is_told


@pytest.mark.parametrize(("algorithm", "is_told"), [("ppo-fast", False), ("tests.training.own:Losing", True)])
def test_an_agent_that_earns_less_than_its_training_is_told(
    tmp_path, caplog, monkeypatch, algorithm, is_told
):
    monkeypatch.setattr("time.process_time", lambda: 0.0)  # it is never given up for its time
    values = load_hyperparameters(find_algorithm("ppo-fast"), GameSpec(ALLY), None)
    train(algorithm, ALLY, tmp_path / "run", steps=150_000, hyperparams=values.entry())
    told = [record.message for record in caplog.records if "in the training's games" in record.message]
    assert ["it lacks something that the training had" in line for line in told] == [True] * is_told
