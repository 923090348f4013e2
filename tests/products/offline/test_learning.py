"""Offline algorithms: they learn from a data set, play nothing, and export as all others."""

import os
import signal

import numpy as np
import pytest
import torch
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize
from typer.testing import CliRunner

from fpg_bench.cli.main import app
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_json
from fpg_bench.envs.sb3_vec_env import FPGVecEnv, make_sb3
from fpg_bench.evaluation.entry import entries_of
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.players.agent import load_agent
from fpg_bench.products.offline.learning import BC, Transitions
from fpg_bench.products.offline.make import make_dataset
from fpg_bench.products.offline.read import open_dataset
from fpg_bench.products.offline.rounds import play_rounds
from fpg_bench.training.algorithms import OFFLINE
from fpg_bench.training.config import RunConfig
from fpg_bench.training.train import train
from tests.products.offline.making import metadata, tiny
from tests.training.tiny import settings

NETS = {"net_arch": [32, 32]}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("datasets")


@pytest.fixture(scope="module")
def mixed(folder):
    return open_dataset(make_dataset(tiny(12), folder))


@pytest.fixture(scope="module")
def discrete(folder):
    return open_dataset(make_dataset(tiny(12, name="tiny-discrete-v0", actions="discrete"), folder))


@pytest.fixture(scope="module")
def expert(folder):
    spec = tiny(60, name="tiny-expert-v0", behaviour="script", players=("expert",))
    return open_dataset(make_dataset(spec, folder))


def learn(algorithm, data, out, steps=300, evaluations=0, resume=False, **changes):
    """Train a small network and return the agent's folder."""
    entry = {
        "policy": "MlpPolicy",
        "n_envs": 1,
        "n_timesteps": steps,
        "normalize": {"norm_obs": False, "norm_reward": True},
        "batch_size": 64,
        "learning_rate": 0.003,
        "policy_kwargs": NETS,
    }
    config = RunConfig.offline(algorithm, data, hyperparams=entry | changes)
    return train(config, out, evaluations=evaluations, progress=False, resume=resume)


@pytest.mark.slow
def test_a_clone_acts_as_the_script_does(expert, tmp_path):
    agent = load_agent(learn("bc", expert, tmp_path, steps=800))
    rounds = play_rounds(expert.spec, range(10))  # of seeds that it has not seen
    seen, actions = rounds.observations[:, :-1].reshape(-1, 15), rounds.actions.reshape(-1, 9)
    error = np.square(agent.predict(seen)[0] - actions).mean()
    assert error < 0.2 * actions.var(axis=0).mean()


@pytest.mark.full
@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "loss"),
    [
        ("bc", "cloning_loss"),
        ("bc-stack3", "cloning_loss"),
        ("td3-bc", "cloning_loss"),
        ("cql", "conservative_gap"),
        ("iql", "value_loss"),
        ("discrete-cql", "conservative_gap"),
    ],
)
def test_each_algorithm_lowers_its_loss_and_exports_an_agent_that_plays(
    algorithm, loss, mixed, discrete, tmp_path, monkeypatch
):
    losses = []
    record = Logger.record

    def kept(self, key, value, *more):
        if key == f"train/{loss}":
            losses.append(value)
        record(self, key, value, *more)

    def stepped(self):
        raise AssertionError("a game was played")

    monkeypatch.setattr(Logger, "record", kept)
    monkeypatch.setattr(FPGVecEnv, "step_wait", stepped)
    monkeypatch.setattr("fpg_bench.training.export.difference_in_own_games", lambda *_: None)  # plays a copy
    data = discrete if algorithm.startswith("discrete") else mixed
    agent = learn(algorithm, data, tmp_path, **({"n_actions": 2} if algorithm == "cql" else {}))
    assert losses[-1] < losses[0]
    assert (tmp_path / "model.zip").stat().st_size < 200_000  # without the data
    about = read_json(agent / "agent.json", "agent")
    assert about["offline"] == {
        "dataset": data.spec.dataset_id,
        "content_sha256": metadata(data.path.parent)["fpg_bench"]["content_sha256"],
        "transitions": 3600,
    }
    assert (about["training_steps"], about["algorithm"]) == (300, algorithm)
    assert about["game"].get("actions", "continuous") == data.spec.actions
    player = load_agent(agent, "ally")
    actions, _ = player.predict(data.read()[0][:, 0])
    assert actions.shape == (12, 9)
    assert np.ptp(actions, axis=0).max() > 0


@pytest.mark.slow
def test_choices_are_cloned(discrete, tmp_path):
    agent = load_agent(learn("bc", discrete, tmp_path, steps=100))
    assert agent.card.game.actions == "discrete"


def test_transitions_are_those_that_the_wrapped_games_show(mixed):
    """Stacking, normalization and its statistics are SB3's."""
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (300, 3, 9)).astype(np.float32)

    def play(env):
        shown, rewards = [env.reset()], []
        for step in range(300):
            seen, reward, dones, infos = env.step(actions[step])
            last = np.stack([info.get("terminal_observation", row) for info, row in zip(infos, seen)])  # noqa: B905
            shown.append(last if dones.all() else seen)
            rewards.append(reward)
        return np.stack(shown, 1), np.stack(rewards, 1)

    def games():
        return make_sb3("FPG/AllyVsPolicy-v0", 3, 5)

    raw, raw_rewards = play(games())
    env = VecNormalize(VecFrameStack(games(), 2), norm_obs=True, gamma=0.9)
    play(env)
    fresh = VecNormalize(VecFrameStack(games(), 2), norm_obs=True, gamma=0.9)
    data = Transitions(raw, actions.swapaxes(0, 1), raw_rewards, 0.9, 2, fresh)
    assert fresh.ret_rms.var == pytest.approx(env.ret_rms.var, rel=1e-5)
    np.testing.assert_allclose(fresh.obs_rms.mean, env.obs_rms.mean, atol=0.01)  # of one step more
    np.random.seed(0)  # noqa: NPY002
    batch = data.sample(200)
    np.random.seed(0)  # noqa: NPY002
    rounds, steps = (np.random.randint(0, high, 200) for high in (3, 300))  # noqa: NPY002
    stacked = np.concatenate([np.pad(raw, ((0, 0), (1, 0), (0, 0)))[:, :-1], raw], axis=2)
    for got, at in ((batch.observations, steps), (batch.next_observations, steps + 1)):
        np.testing.assert_allclose(got, fresh.normalize_obs(stacked[rounds, at]), rtol=1e-6)
    rewards = fresh.normalize_reward(raw_rewards)
    np.testing.assert_allclose(batch.rewards[:, 0], rewards[rounds, steps], rtol=1e-5)
    tail = rewards.mean() / (1 - 0.9)
    expected = [
        sum(0.9**k * reward for k, reward in enumerate([*rewards[i, t:], tail]))
        for i, t in zip(rounds, steps, strict=True)
    ]
    np.testing.assert_allclose(batch.returns[:, 0], expected, rtol=1e-4, atol=1e-4)
    assert torch.equal(batch.actions, torch.as_tensor(actions[steps, rounds]))


@pytest.mark.slow
def test_a_stopped_run_goes_on(mixed, tmp_path, monkeypatch):
    update = BC._update

    def stopped(self, batch):
        if self._n_updates == 150:
            os.kill(os.getpid(), signal.SIGINT)
        return update(self, batch)

    monkeypatch.setattr(BC, "_update", stopped)
    with pytest.raises(KeyboardInterrupt, match="saved at 200 steps"):
        learn("bc", mixed, tmp_path, steps=450)
    with pytest.raises(UserError, match="unfinished; continue it with --resume"):
        learn("bc", mixed, tmp_path, steps=450)
    learn("bc", mixed, tmp_path, steps=450, resume=True)
    about = read_json(tmp_path / "run.json", "run")
    assert (about["finished"], about["steps_done"], about["part"]) == (True, 450, 1)
    monkeypatch.setattr(BC, "_update", None)
    learn("bc", mixed, tmp_path, steps=450)  # finished: nothing is learned again


@pytest.mark.slow
def test_ppo_starts_from_a_clone(mixed, tmp_path):
    clone = learn("bc", mixed, tmp_path / "bc", steps=100)
    hyperparams = settings(
        "ppo",
        normalize={"norm_obs": False, "norm_reward": True},
        policy_kwargs=NETS,
        learning_rate=1e-9,
        n_timesteps=400,
    )
    config = RunConfig("ppo", "FPG/AllyVsScripted-v0", hyperparams=hyperparams, start=tmp_path / "bc")
    agent = train(config, tmp_path / "ppo", evaluations=0, progress=False)
    seen = mixed.read()[0][:, 7]
    actions = [load_agent(each).predict(seen)[0] for each in (clone, agent)]
    np.testing.assert_allclose(*actions, atol=1e-4)
    learn("td3-bc", mixed, tmp_path / "td3", steps=100)
    for algorithm, start in (("ppo", "td3"), ("sac", "bc")):
        other = RunConfig(algorithm, config.game, hyperparams=settings(algorithm), start=tmp_path / start)
        with pytest.raises(UserError, match=f"start .*: algorithm is '.*' there, expected '{algorithm}'"):
            train(other, tmp_path / "other", evaluations=0, progress=False)


@pytest.mark.slow
def test_agents_of_other_data_sets_are_other_entries(mixed, expert, tmp_path):
    for name, data in (("a", mixed), ("b", expert)):
        learn("bc", data, tmp_path / name, steps=10)
    agents = [str(tmp_path / name / "agent") for name in ("a", "b")]
    entries = entries_of([*agents, "ally-scripted/ppo/seed_0"], load_suite("ally-v2"))
    assert len({entry.name for entry in entries}) == 3


@pytest.mark.slow
def test_the_verb_learns_several_seeds_and_scores_them(mixed, tmp_path, monkeypatch):
    file = tmp_path / "bc.yml"
    file.write_text(
        "FPG/AllyVsPolicy-v0: {policy: MlpPolicy, n_envs: 1, n_timesteps: 100, batch_size: 32, "
        "policy_kwargs: {net_arch: [8]}}\n"
    )
    words = [
        *("offline", "bc", str(mixed.path.parent), "--out", str(tmp_path / "runs"), "--seeds", "0-1"),
        *("--hyperparams", str(file), "--n-evals", "1", "--n-jobs", "1"),
    ]
    output = CliRunner().invoke(app, words, catch_exceptions=False).output
    assert "seed 1: ally's score on ally-v2 at the end of training" in output
    assert load_agent(tmp_path / "runs/seed_1/agent").card.training_seed == 1
    monkeypatch.setattr(BC, "_update", None)
    assert CliRunner().invoke(app, words, catch_exceptions=False).exit_code == 0  # nothing is repeated


def test_unfit_input_is_one_line(mixed, discrete, tmp_path, monkeypatch):
    with pytest.raises(UserError, match=r"discrete-cql: does not learn .*: bc, td3-bc, cql, iql$"):
        RunConfig.offline("discrete-cql", mixed)
    for algorithm in ("td3-bc", "cql", "iql"):
        with pytest.raises(UserError, match=f"^{algorithm}: .* discrete .*these do: bc, discrete-cql$"):
            RunConfig.offline(algorithm, discrete)
    with pytest.raises(UserError, match=r"^ppo: does not learn from a data set"):
        RunConfig.offline("ppo", mixed)
    with pytest.raises(UserError, match=r"unknown algorithm 'td3bc'.*td3-bc"):
        RunConfig.offline("td3bc", mixed)
    with pytest.raises(UserError, match="suite opponent-v2: measures the opponent, not the ally"):
        train(RunConfig.offline("bc", mixed, suite="opponent-v2"), tmp_path / "run", progress=False)
    with pytest.raises(UserError, match="bc: is trained by fpg-bench offline ALGORITHM DATASET"):
        train(RunConfig("bc", "FPG/AllyVsScripted-v0"), tmp_path / "run", progress=False)
    with pytest.raises(UserError, match="unknown key 'beta'; known: action_noise, alpha, batch_size"):
        learn("td3-bc", mixed, tmp_path / "run", beta=3.0)
    assert not (tmp_path / "run").exists()
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    with pytest.raises(UserError, match=r"is not in .*; make it with fpg-bench dataset make ally-mixed-v0$"):
        open_dataset("ally-mixed-v0")


def test_a_data_set_is_found_by_its_name_and_has_to_be_the_only_one(folder, mixed, discrete, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    for name in ("tiny-v0", "fpg/tiny-v0", folder / "fpg/tiny-v0", mixed.path):
        assert open_dataset(name).sha256 == mixed.sha256
    with pytest.raises(UserError, match=r"holds . data sets; name one"):
        open_dataset(folder)


def test_every_algorithm_has_hyper_parameters_for_both_sides():
    from fpg_bench.training.hyperparameters import load_hyperparameters

    for algorithm in OFFLINE:
        for side in ("Ally", "Opponent"):
            assert load_hyperparameters(algorithm, f"FPG/{side}VsPolicy-v0").n_timesteps > 0
