"""The real thing, with budgets of a few rounds."""

import dataclasses
import json
import re

import numpy as np
import optuna
import pytest
import yaml
from optuna.trial import TrialState

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.seeds import training_seed
from fpg_bench.training.tuning.confirm import confirm
from fpg_bench.training.tuning.report import write_report
from fpg_bench.training.tuning.task import FRESH_SEED, TRIAL_SEED, make_task
from fpg_bench.training.tuning.trial import Diverged, Objective
from fpg_bench.training.tuning.tune import tune

pytestmark = pytest.mark.slow

VIEW = "FPG/OpponentVsScripted-v0"
HYPERPARAMS = f"""\
{VIEW}:
  policy: MlpPolicy
  n_envs: 4
  n_timesteps: 2400
  normalize: {{norm_obs: true, norm_reward: true}}
  n_steps: 75
  batch_size: 300
  n_epochs: 1
  learning_rate: 0.001
  policy_kwargs: {{net_arch: [8]}}
"""
SPACE = """\
learning_rate: {kind: float, low: 1.0e-4, high: 1.0e-2, log: true}
policy_kwargs.net_arch: {kind: choice, choices: [[8], [16]]}
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tune")
    (folder / "mine.yml").write_text(HYPERPARAMS)
    (folder / "space.yml").write_text(SPACE)
    return folder


@pytest.fixture(scope="module")
def words(files):
    return {"hyperparams": files / "mine.yml", "space": files / "space.yml", "rounds": 2}


@pytest.fixture(scope="module")
def study(files, words):
    return tune("ppo", VIEW, files / "study", trials=3, say=lambda line: None, **words)


def test_a_study_has_its_trials_and_what_it_tunes(study):
    assert [trial.state.is_finished() for trial in study.trials] == [True] * 3
    assert study.trials[0].params == {"learning_rate": 0.001, "policy_kwargs.net_arch": "[8]"}
    task = study.user_attrs["task"]
    assert (task["steps"], task["seeds"], task["suite"]) == (1200, 2, "opponent-v1")
    assert study.trials[0].state == TrialState.COMPLETE
    assert sorted(study.trials[0].intermediate_values) == [1, 2, 3, 4, 5, 6, 7]
    low, high, over = study.trials[0].user_attrs["interval"]
    assert over == "training seeds"
    assert (low + high) / 2 == pytest.approx(study.trials[0].value)


def test_the_same_command_goes_on_and_another_space_is_refused(study, files, words):
    tune("ppo", VIEW, files / "study", trials=3, say=lambda line: None, **words)
    assert len(study.trials) == 3
    (files / "other.yml").write_text(SPACE.replace("[16]", "[32]"))
    other = words | {"space": files / "other.yml"}
    with pytest.raises(UserError, match=r"made with another search space \(policy_kwargs.net_arch\)"):
        tune("ppo", VIEW, files / "study", **other)
    with pytest.raises(UserError, match="made with steps 1200, not 600"):
        tune("ppo", VIEW, files / "study", steps=600, **words)
    assert len(study.trials) == 3


def test_a_score_can_be_made_again_and_is_the_mean_over_its_seeds(words):
    task = make_task("ppo", VIEW, seeds=2, **words)
    values = {"learning_rate": 0.002, "policy_kwargs.net_arch": [16]}
    reports = []
    objective = Objective(task)
    both = objective(values, [7, 8], lambda value, step: reports.append((step, value)))
    alone = [objective(values, [seed], lambda value, step: None).value for seed in (7, 8)]
    assert both.value == pytest.approx(np.mean(alone))
    assert dict(reports)[4] == pytest.approx(alone[0])  # between the seeds
    assert [step for step, _ in reports] == [1, 2, 3, 4, 5, 6, 7]


def test_a_policy_is_scored_in_the_scenario_that_is_tuned_on(words, files):
    (files / "short.yml").write_text("steps_per_round: 50\n")
    task = make_task("ppo", VIEW, seeds=1, **words)
    other = dataclasses.replace(task, options={"scenario": str(files / "short.yml")})
    values = {"learning_rate": 0.002}
    assert len({Objective(t)(values, [7], lambda value, step: None).value for t in (task, other)}) == 2


def test_pruning_stops_training(words):
    task = make_task("ppo", VIEW, seeds=2, **words)
    looked = []

    def report(value, step):
        looked.append(step)
        raise optuna.TrialPruned

    with pytest.raises(optuna.TrialPruned):
        Objective(task)({"learning_rate": 0.002}, [7, 8], report)
    assert looked == [1]


def test_seeds_of_trials_and_fresh_ones_are_not_those_that_are_shipped(study):
    assert study.user_attrs["task"]["first_seed"] == TRIAL_SEED
    assert training_seed(10_000) < training_seed(TRIAL_SEED) < training_seed(FRESH_SEED)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3"])
def test_training_that_comes_to_no_numbers_is_said_so(algorithm):
    task = make_task(algorithm, VIEW, seeds=1, steps=1200, rounds=2)
    small = {"n_envs": 4, "n_steps": 75, "batch_size": 50} if algorithm == "ppo" else {"learning_starts": 100}
    values = {"learning_rate": 1e30} | small
    with pytest.raises(Diverged, match="numbers that are none"):
        Objective(task)(values, [7], lambda value, step: None)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"algorithm": "pqo"}, "did you mean 'ppo'"),
        ({"env_id": "FPG/OpponentVsScriptd-v0"}, f"did you mean '{VIEW}'"),
        ({"trials": 0}, "trials"),
        ({"seeds": 0}, "seeds"),
        ({"steps": 0}, "steps"),
        ({"rounds": 0}, "rounds"),
        ({"suite": "oponent-v1"}, "did you mean 'opponent-v1'"),
        ({"suite": "ally-v1"}, "measures the ally"),
        ({"ally": "exprt"}, "did you mean 'expert'"),
        ({"ally": object()}, "name everything by words"),
        ({"storage": "nonsense"}, "expected a URL"),
        ({"hyperparams": None, "space": "nowhere.yml"}, "cannot be read"),
    ],
)
def test_bad_words(tmp_path, words, changes, message):
    wanted = {"algorithm": "ppo", "env_id": VIEW} | words | changes
    with pytest.raises(UserError, match=message):
        tune(wanted.pop("algorithm"), wanted.pop("env_id"), tmp_path / "study", **wanted)
    assert not (tmp_path / "study").exists()


def test_a_name_that_the_algorithm_does_not_know_is_refused_before_any_trial(tmp_path, words):
    (tmp_path / "space.yml").write_text("learning_rat: {kind: float, low: 0.1, high: 0.2}")
    with pytest.raises(UserError, match="did you mean 'learning_rate'"):
        tune("ppo", VIEW, tmp_path / "study", **words | {"space": tmp_path / "space.yml"})
    assert not (tmp_path / "study").exists()


def test_the_best_are_trained_again_on_fresh_seeds_once(study, files):
    lines = []
    found = confirm(files / "study", best=2, seeds=2, steps=600, say=lines.append)
    complete = [trial for trial in study.trials if trial.state == TrialState.COMPLETE]
    expected = sorted(complete, key=lambda trial: -trial.value)[:2]
    assert {confirmed.trial for confirmed in found} == {trial.number for trial in expected}
    assert list(found[0].seeds) == [FRESH_SEED, FRESH_SEED + 1]
    assert found[0].score.value == max(confirmed.score.value for confirmed in found)
    assert found[0].score.low < found[0].score.value < found[0].score.high
    assert len([line for line in lines if ": score" in line]) == 2 * len(found)
    again = []
    assert confirm(files / "study", best=2, seeds=2, steps=600, say=again.append) == found
    assert again == []
    confirm(files / "study", best=1, seeds=3, steps=600, say=again.append)
    (line,) = [line for line in again if ": score" in line]  # the third seed alone
    assert line.startswith(f"trial {found[0].trial} again, seed {FRESH_SEED + 2}: score")
    with pytest.raises(UserError, match="made with steps 600, not 1200"):
        confirm(files / "study", best=1, seeds=1)


def test_nothing_to_confirm_or_show(tmp_path):
    for function in (confirm, write_report):
        with pytest.raises(UserError, match="holds no study"):
            function(tmp_path / "nowhere")
        assert not (tmp_path / "nowhere").exists()


def test_the_report_is_one_page_that_needs_no_network(study, files):
    page = write_report(files / "study").read_text()
    headings = (
        "The best score so far",
        "Scores along the way",
        "Which values matter",
        "Scores by each value",
    )
    for heading in (*headings, "Trials"):
        assert f"<h2>{heading}</h2>" in page
    assert not re.search("Objective Value|Intermediate Value|Feasible Trial|Hyperparameter", page)
    assert page.count("Plotly.newPlot") >= 3
    assert not re.search(r"<(script|link)[^>]+(src|href)=", page)
    assert f"<td>{study.best_value:.1f}" in page
    assert json.loads(json.dumps(yaml.safe_load(SPACE))).keys() <= set(re.findall(r"[\w.]+", page))
