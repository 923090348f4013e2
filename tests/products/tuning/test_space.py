import optuna
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import baselines_folder
from fpg_bench.products.tuning.objective import Objective
from fpg_bench.products.tuning.space import from_params, load_space, merge_values, suggest, to_params
from fpg_bench.products.tuning.study import make_task
from fpg_bench.training.hyperparameters import load_hyperparameters

SPACE = """\
learning_rate: {kind: float, low: 1.0e-4, high: 1.0e-2, log: true}
n_epochs: {kind: int, low: 2, high: 4}
gamma: {kind: choice, choices: [0.9, 0.99]}
policy_kwargs.net_arch: {kind: choice, choices: [[8], [16, 16]]}
"""


@pytest.fixture
def space(tmp_path):
    (tmp_path / "space.yml").write_text(SPACE)
    return load_space("ppo", tmp_path / "space.yml")


def test_values_lie_in_the_space_and_come_back_from_a_study(space):
    study = optuna.create_study()
    suggested = [suggest(space, study.ask()) for _ in range(30)]
    assert all(1e-4 <= values["learning_rate"] <= 1e-2 for values in suggested)
    assert {values["n_epochs"] for values in suggested} == {2, 3, 4}
    assert {values["gamma"] for values in suggested} == {0.9, 0.99}
    assert {str(values["policy_kwargs.net_arch"]) for values in suggested} == {"[8]", "[16, 16]"}
    assert [from_params(space, trial.params) for trial in study.trials] == suggested
    assert all(len(f"{values['learning_rate']:g}") <= 9 for values in suggested)  # short enough to be written


def test_values_go_where_their_names_lead(space):
    held = {"n_envs": 4, "policy_kwargs": {"net_arch": [64], "log_std_init": 0.5}}
    values = {"policy_kwargs.net_arch": [8], "gamma": 0.9, "normalize.norm_obs": True}
    assert merge_values(held, values) == {
        "n_envs": 4,
        "policy_kwargs": {"net_arch": [8], "log_std_init": 0.5},
        "gamma": 0.9,
        "normalize": {"norm_obs": True},
    }
    assert held["policy_kwargs"]["net_arch"] == [64]


def test_present_values_are_tried_as_far_as_they_lie_in_the_space(space):
    held = {"learning_rate": 0.001, "n_epochs": 5, "gamma": 0.99, "policy_kwargs": {"net_arch": [16, 16]}}
    assert to_params(space, held) == {
        "learning_rate": 0.001,
        "gamma": 0.99,
        "policy_kwargs.net_arch": "[16, 16]",
    }
    assert to_params(space, {"learning_rate": "lin_0.001", "policy_kwargs": None}) == {}


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("gamma: {kind: float, low: 1e-4, high: 1}", r"gamma.low: expected a number \(1.0e-4, not 1e-4\)"),
        ("gamma: {kind: float, low: 2, high: 1}", "low 2 is above high 1"),
        ("gamma: {kind: float, low: 0, high: 1, log: true}", "must start above 0"),
        ("gamma: {kind: choice, choices: [0.5, .inf]}", "expected words or finite numbers, got"),
        ("gamma: {kind: choice, choices: [0.5, 2024-01-01]}", "expected words or finite numbers, got"),
        ("gamma: {kind: choice, choices: []}", "choices: expected a list"),
        ("n_timesteps: {kind: int, low: 1, high: 2}", "'n_timesteps' is not a hyper-parameter that can be"),
        ("1: {kind: int, low: 1, high: 2}", "1 is not a hyper-parameter"),
        ("{}", "names no hyper-parameter"),
    ],
)
def test_a_file_that_is_no_space_is_refused(tmp_path, line, message):
    (tmp_path / "space.yml").write_text(line)
    with pytest.raises(UserError, match=message) as found:
        load_space("ppo", tmp_path / "space.yml")
    assert "space.yml" in str(found.value)


def test_an_algorithm_without_a_space():
    with pytest.raises(
        UserError, match=r"no search space for 'mine:Own'; known: dqn, maddpg, ppo, ppo-discrete, sac, td3"
    ):
        load_space("mine:Own")


def id_of(algorithm):
    """An id that an algorithm can be trained in."""
    return "FPG/duel_v0" if algorithm == "maddpg" else "FPG/AllyVsScripted-v0"


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3", "recurrent-ppo", "ppo-stack8", "maddpg"])
def test_shipped_spaces_hold_names_that_their_algorithms_know(algorithm, monkeypatch):
    monkeypatch.setattr("fpg_bench.products.tuning.objective.PolicyEvaluator", lambda *words, **options: None)
    env_id = id_of(algorithm)
    task = make_task(algorithm, env_id, n_seeds=2)
    Objective(task)
    half = load_hyperparameters(algorithm, env_id).n_timesteps // 2
    assert task.steps == half


def test_what_is_shipped_lies_in_the_space_but_for_little():
    for file in (baselines_folder() / "search").glob("*.yml"):
        is_discrete = file.stem in ("dqn", "ppo-discrete")
        actions = "discrete" if is_discrete else None
        algorithm = file.stem.removesuffix("-discrete")
        env_id = id_of(algorithm)
        task = make_task(algorithm, GameSpec(env_id, actions=actions), n_seeds=2)
        missing = task.space.keys() - to_params(task.space, task.hyperparameters).keys()
        assert len(missing) <= 3, missing
