"""The real thing, with budgets of a few rounds."""

import logging
import pickle
from functools import partial

import numpy as np
import optuna
import pytest
import yaml
from optuna.trial import TrialState

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.policy_evaluator import PolicyEvaluator
from fpg_bench.evaluation.seeds import training_seed
from fpg_bench.evaluation.statistics import mean_interval
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.products.tuning.export import FRESH_SEED, export_values
from fpg_bench.products.tuning.objective import Diverged, Objective
from fpg_bench.products.tuning.study import FIRST_SEED, make_task
from fpg_bench.products.tuning.tune import _work, tune
from fpg_bench.training.export import export_onnx

pytestmark = pytest.mark.slow

ENV_ID = "FPG/OpponentVsScripted-v0"
HYPERPARAMS = f"""\
{ENV_ID}:
  policy: MlpPolicy
  n_envs: 4
  n_timesteps: 960
  normalize: {{norm_obs: true, norm_reward: true}}
  n_steps: 30
  batch_size: 120
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
    return tune("ppo", ENV_ID, files / "study", n_trials=3, **words)


def test_a_study_has_its_trials_and_what_it_tunes(study):
    assert [trial.state.is_finished() for trial in study.trials] == [True] * 3
    first, task = study.trials[0], study.user_attrs["task"]
    assert first.params == {"learning_rate": 0.001, "policy_kwargs.net_arch": "[8]"}
    assert (task["steps"], task["n_seeds"], task["suite"]) == (480, 2, "opponent-v2")
    assert first.state == TrialState.COMPLETE
    assert sorted(first.intermediate_values) == [1, 2, 3, 4, 5, 6, 7]
    low, high, over = first.user_attrs["interval"]
    assert over == "training seeds"
    assert (low + high) / 2 == pytest.approx(first.value)
    # Seeds of trials, and fresh ones, are not those that are shipped
    assert make_task("ppo", ENV_ID, n_seeds=2).seeds == [FIRST_SEED, FIRST_SEED + 1]
    assert training_seed(10_000) < training_seed(FIRST_SEED) < training_seed(FRESH_SEED)


def test_the_same_command_goes_on(study, files, words, caplog):
    caplog.set_level(logging.INFO, "fpg_bench")
    tune("ppo", ENV_ID, files / "study", n_trials=3, **words)
    assert len(study.trials) == 3
    assert caplog.messages[0] == "this study was already finished; nothing was trained"
    best = study.best_trial
    pruned = sum(trial.state == TrialState.PRUNED for trial in study.trials)
    counted = f"3 finished ({pruned} pruned)" if pruned else "3 finished"
    expected = f"{counted}, best: {best.value:.1f} (trial {best.number}): learning_rate "
    assert caplog.messages[1].startswith(expected)


def test_a_study_of_another_algorithm_goes_into_another_folder_or_by_name(study, files, words):
    own = {"steps": 480, "n_seeds": 1, **words}
    with pytest.raises(UserError, match=r"another study \(ppo FPG/.*\); name this one with --study-name"):
        tune("ppo-stack2", ENV_ID, files / "study", n_trials=1, **own)
    assert optuna.get_all_study_names(study._storage) == [study.study_name]


def test_a_score_can_be_made_again_and_is_the_mean_over_its_seeds(words):
    task = make_task("ppo", ENV_ID, n_seeds=2, **words)
    values = {"learning_rate": 0.002, "policy_kwargs.net_arch": [16]}
    reports = []
    objective = Objective(task)
    both = objective.train(values, [7, 8], lambda value, step: reports.append((step, value)))
    alone = [objective.train(values, [seed]).value for seed in (7, 8)]
    assert both.value == pytest.approx(np.mean(alone))
    assert dict(reports)[4] == pytest.approx(alone[0])  # between the seeds
    assert [step for step, _ in reports] == [1, 2, 3, 4, 5, 6, 7]


def test_a_policy_is_scored_in_the_scenario_that_is_tuned_on(words, files):
    (files / "short.yml").write_text("steps_per_round: 50\n")
    task = make_task("ppo", ENV_ID, n_seeds=1, **words)
    other = task.model_copy(update={"game": GameSpec(ENV_ID, scenario=files / "short.yml")})
    with pytest.raises(UserError, match="suite ally-v2: plays standard, the run link"):
        make_task("ppo", GameSpec.of(ENV_ID, scenario="link"), n_seeds=1, suite="ally-v2")
    values = {"learning_rate": 0.002}
    assert len({Objective(t).train(values, [7]).value for t in (task, other)}) == 2


@pytest.mark.parametrize("side", ["ally", "opponent"])
def test_both_sides_are_trained_and_that_of_the_suite_is_scored(side):
    task = make_task("maddpg", "fpg_bench:FPG/duel_v0", n_seeds=1, steps=960, suite=f"{side}-v2", rounds=2)
    assert (task.game.id, make_task("maddpg", "FPG/duel_v0", n_seeds=1).suite) == ("FPG/duel_v0", "ally-v2")
    values = {"learning_starts": 200, "batch_size": 16, "policy_kwargs.net_arch": [8]}
    objective, models = Objective(task), []
    make = objective._model
    objective._model = lambda *given: models.append(make(*given)) or models[-1]
    score = objective.train(values, [7])
    trained = dict(zip(("ally", "opponent"), models[-1].players, strict=True))
    evaluator = PolicyEvaluator(f"{side}-v2", 2, side=side)
    played = evaluator.score(OnnxPlayer(export_onnx(trained[side])))
    assert score.value == pytest.approx(played["score"], abs=1e-3)


def test_pruning_stops_training(words):
    task = make_task("ppo", ENV_ID, n_seeds=2, **words)
    steps = []

    def report(value, step):
        steps.append(step)
        raise optuna.TrialPruned

    with pytest.raises(optuna.TrialPruned):
        Objective(task).train({"learning_rate": 0.002}, [7, 8], report)
    assert steps == [1]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("algorithm", ["ppo", "td3"])
def test_training_that_diverges_says_so(algorithm):
    task = make_task(algorithm, ENV_ID, n_seeds=1, steps=1200, rounds=2)
    small = {"n_envs": 4, "n_steps": 75, "batch_size": 50} if algorithm == "ppo" else {"learning_starts": 100}
    values = {"learning_rate": 1e30} | small
    with pytest.raises(Diverged, match="diverged to NaN"):
        Objective(task).train(values, [7])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"workers": 0}, "^n_jobs: "),
        *(({name: 0}, f"^{name}: ") for name in ("n_trials", "n_seeds", "steps", "rounds")),
        ({"suite": "ally-v2"}, "measures the ally"),
        ({"ally": object()}, "ally: object is an object of this program, which cannot be written down"),
        ({"storage": "nonsense"}, "expected a URL"),
        ({"hyperparams": None, "space": "nowhere.yml"}, "cannot be read"),
        ({"space": "torn.yml"}, "did you mean 'learning_rate'"),
    ],
)
def test_bad_words(tmp_path, words, changes, message, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "torn.yml").write_text("learning_rat: {kind: float, low: 0.1, high: 0.2}")
    arguments = {"algorithm": "ppo", "env_id": ENV_ID} | words | changes
    ally = arguments.pop("ally", None)

    def start():
        game = GameSpec(arguments.pop("env_id"), ally=ally)
        tune(arguments.pop("algorithm"), game, tmp_path / "study", **arguments)

    with pytest.raises(UserError, match=message):
        start()
    assert not (tmp_path / "study").exists()


def test_the_best_are_retrained_on_fresh_seeds_once(study, files, caplog):
    caplog.set_level(logging.INFO, "fpg_bench")
    file = files / "best.yml"
    export = partial(export_values, files / "study", file, steps=240, force=True)
    for other in ("mine.yml", "mine.yml/new.yml"):  # before anything is trained
        with pytest.raises(UserError, match=r"mine\.yml"):
            export_values(files / "study", files / other, n_best=1, n_seeds=2)
    confirmed = export(n_best=2, n_seeds=2)
    complete = [trial for trial in study.trials if trial.state == TrialState.COMPLETE]
    expected = sorted(complete, key=lambda trial: -trial.value)[:2]
    assert {trial.trial for trial in confirmed} == {trial.number for trial in expected}
    assert list(confirmed[0].seeds) == [FRESH_SEED, FRESH_SEED + 1]
    assert confirmed[0].score.value == max(trial.score.value for trial in confirmed)
    assert confirmed[0].score.low < confirmed[0].score.value < confirmed[0].score.high
    has_present = study.trials[0] in expected
    assert caplog.text.count(": score") == 2 * (len(confirmed) + (not has_present))
    written = yaml.safe_load(file.read_text())[ENV_ID]
    assert written["learning_rate"] == confirmed[0].values["learning_rate"]
    caplog.clear()
    assert export(n_best=2, n_seeds=2) == confirmed
    assert ": score" not in caplog.text
    export(n_best=2, n_seeds=3)
    lines = [line for line in caplog.messages if ": score" in line]  # the third seed alone
    assert len(lines) == len(expected) + (not has_present)
    assert all(f" again, seed {FRESH_SEED + 2}, 240 steps: score" in line for line in lines)


@pytest.mark.parametrize(("tuned", "present", "is_refused"), [(-158.0, 20.0, True), (24.0, 20.0, False)])
def test_values_that_score_less_than_the_present_ones_need_force(
    tuned, present, is_refused, study, files, tmp_path, monkeypatch, caplog
):
    caplog.set_level(logging.INFO, "fpg_bench")
    study.add_trial(
        optuna.trial.create_trial(
            params={"learning_rate": 0.002, "policy_kwargs.net_arch": "[16]"},
            distributions=study.trials[0].distributions,
            value=1e6,
        )
    )

    def train(self, values, seeds):
        return mean_interval(np.array([tuned if values else present]), "matches")

    monkeypatch.setattr(Objective, "train", train)
    file, steps = tmp_path / "mine.yml", 900 + is_refused
    options = {"n_best": 1, "n_seeds": 2, "steps": steps}
    if is_refused:
        with pytest.raises(UserError, match=r"scores -158.0, less than the present values with 20.0"):
            export_values(files / "study", file, **options)
        assert not file.exists()
    export_values(files / "study", file, **options, force=is_refused)
    assert yaml.safe_load(file.read_text())[ENV_ID]["learning_rate"] == 0.002
    assert f"present values: {present} on fresh seeds" in caplog.messages


@pytest.mark.parametrize("gains", [(4.4, 4.6), (30.0, -21.0)])
def test_what_the_values_gain_is_told_seed_by_seed(gains, study, files, tmp_path, monkeypatch, caplog):
    caplog.set_level(logging.INFO, "fpg_bench")

    def train(self, values, seeds):
        (seed,) = seeds  # seeds differ far more than the values do
        base = 1000.0 * (seed - FRESH_SEED)
        return mean_interval(np.array([base + (gains[seed - FRESH_SEED] if values else 0.0)]), "matches")

    monkeypatch.setattr(Objective, "train", train)
    steps = 1200 + int(gains[0])
    export_values(files / "study", tmp_path / "mine.yml", n_best=1, n_seeds=2, steps=steps, force=True)
    (line,) = (line for line in caplog.messages if "less the present values" in line)
    assert "less the present values: 4.5 [" in line
    assert ("not told apart" in line) == (min(gains) < 0)


def test_nothing_is_written_if_no_trial_could_be_retrained(study, files, tmp_path, monkeypatch):
    monkeypatch.setattr("fpg_bench.products.tuning.export.run_jobs", lambda *words: {"trial 0": "failed"})
    with pytest.raises(UserError, match="no trial could be retrained on all fresh seeds"):
        export_values(files / "study", tmp_path / "mine.yml", steps=700)
    assert not (tmp_path / "mine.yml").exists()


def fail(*arguments):
    raise ZeroDivisionError("by zero")


def test_a_trial_that_fails_is_pruned_and_says_why(tmp_path, words, monkeypatch, caplog):
    caplog.set_level(logging.INFO, "fpg_bench")
    monkeypatch.setattr(Objective, "train", fail)
    study = tune("ppo", ENV_ID, tmp_path / "study", n_trials=1, **words)
    assert study.trials[0].state == TrialState.PRUNED
    assert study.trials[0].user_attrs["error"].startswith("ZeroDivisionError: by zero, in ")
    assert any(line.startswith("trial 0: failed (ZeroDivisionError: by zero, ") for line in caplog.messages)


def test_two_workers_share_the_trials(tmp_path, words, monkeypatch):
    """One after the other, as a worker would unpickle its job; ``test_worker.py`` has two at once."""

    def run_here(jobs, workers):
        assert len(jobs) == min(workers.n_jobs, 2)  # of three workers for two trials, one has none
        for job in jobs:
            pickle.loads(pickle.dumps(job.run))()
        return {}

    monkeypatch.setattr("fpg_bench.products.tuning.tune.run_jobs", run_here)
    options = words | {"n_seeds": 1, "steps": 120}
    study = tune("ppo", ENV_ID, tmp_path / "study", n_trials=2, workers=3, **options)
    assert [trial.state.is_finished() for trial in study.trials] == [True] * 2


def test_a_worker_that_does_not_see_the_study_needs_a_database(tmp_path, words):
    task = make_task("ppo", ENV_ID, n_seeds=1, **words)
    with pytest.raises(UserError, match=r"does not see .*study.db; set a database with --storage"):
        _work(task, tmp_path, None, "study", 1, None, ())
