"""Self-play of two learners: they take turns, meet each other's present policy, and resume together."""

import numpy as np
import pytest
from stable_baselines3.common.callbacks import BaseCallback

from fpg_bench.common.errors import UserError
from fpg_bench.players.agent import load_agent, read_card
from fpg_bench.training import callbacks, train
from fpg_bench.training.actor import ActorPlayer
from fpg_bench.training.config import RunConfig
from fpg_bench.training.run_folder import RunFolder
from tests.training.tiny import run_config, settings

LEARNER, RIVAL = "FPG/AllyVsPolicy-v0", "FPG/OpponentVsPolicy-v0"


def pair(algorithm="ppo", steps=1200, **changes):
    """An ally that also meets a script, and an opponent that is paid for its loss."""
    given = {"hyperparams": settings(algorithm, **changes), "steps": steps}
    learner = run_config(algorithm, LEARNER, actions="uniform-hop", opponent="tone", **given)
    return learner, run_config(algorithm, RIVAL, seed=7, actions="discrete", reward="zero_sum", **given)


def games_made(monkeypatch):
    """The games that trainings make from here on: of each pair the learner's, then the rival's."""
    games, real = [], train.make_sb3

    def make(game, *rest, **options):
        games.append(real(game, *rest, **options))
        return games[-1]

    monkeypatch.setattr(train, "make_sb3", make)
    return games


class Stopped(BaseCallback):
    """Stops a training at a step, after its checkpoint."""

    def __init__(self, at):
        super().__init__()
        self.at = at

    def _on_rollout_start(self):
        if self.num_timesteps >= self.at:
            raise KeyboardInterrupt

    def _on_step(self):
        return True

    def close(self):
        """Nothing to close."""


def test_both_sides_learn_and_each_meets_the_present_policy_of_the_other(tmp_path, monkeypatch):
    seen, real = [], ActorPlayer.update

    def update(player, model):
        real(player, model)
        seen.append((id(player), model.num_timesteps))

    monkeypatch.setattr(ActorPlayer, "update", update)
    games = games_made(monkeypatch)
    agent = train.train_together(*pair(), tmp_path, weight=3, progress=False)
    ally_games, opponent_games = (each.core for each in games)
    tone, *rivals = ally_games._runner.players
    (ally,) = opponent_games._runner.players
    assert len(rivals) == 3
    assert len(set(map(id, rivals))) == 1
    assert type(tone) is not ActorPlayer
    steps = {id(player): [count for who, count in seen if who == id(player)] for player in (ally, rivals[0])}
    assert sorted(set(steps[id(ally)])) == [0, 400, 800, 1200]
    assert sorted(set(steps[id(rivals[0])])) == [0, 400, 800, 1200]
    folder = RunFolder(tmp_path)
    for run in (folder, RunFolder(tmp_path / train.RIVAL)):
        about = run.read()
        assert (about.finished, about.steps_done) == (True, 1200)
        card = read_card(run.agent)
        assert card.sample
        assert card.options["rival"]["algorithm"] == "ppo"
    assert read_card(folder.agent).options["rival"]["weight"] == 3
    assert (load_agent(agent).noise_size, load_agent(tmp_path / train.RIVAL / "agent").noise_size) == (2, 1)
    observations = np.random.default_rng(0).uniform(-1, 1, (40, 15)).astype(np.float32)
    for player, exported in ((ally, agent), (rivals[0], tmp_path / train.RIVAL / "agent")):
        other = load_agent(exported)
        keys = np.arange(40, dtype=np.uint64)
        for each in (player, other):
            each.reset(np.ones(40, bool), keys)
        np.testing.assert_allclose(player.predict(observations)[0], other.predict(observations)[0], atol=1e-5)


def test_a_live_policy_with_memory_plays_some_games_as_its_exported_agent_does(tmp_path, monkeypatch):
    games = games_made(monkeypatch)
    agent = load_agent(train.train_together(*pair("ppo-stack3", steps=400), tmp_path, progress=False))
    (live,) = games[1].core._runner.players
    rng, keys = np.random.default_rng(0), np.arange(30, dtype=np.uint64)
    for each in (live, agent):
        each.reset(np.ones(30, bool), keys)
    one = other = None
    for step in range(8):
        rows = np.flatnonzero(rng.random(30) < 0.7)
        seen = rng.uniform(-1, 1, (30, 15)).astype(np.float32)
        starts = np.full(30, step == 0) | (rng.random(30) < 0.1)
        played, one = live.predict_rows(rows, seen, one, starts)
        expected, other = agent.predict_rows(rows, seen, other, starts)
        np.testing.assert_allclose(played, expected, atol=1e-5)


def test_a_stopped_pair_ends_with_both_budgets(tmp_path, monkeypatch):
    monkeypatch.setattr(callbacks, "SAVE_EVERY_S", -1.0)
    real = train.ProgressCallback
    monkeypatch.setattr(train, "ProgressCallback", lambda budget: Stopped(800))
    with pytest.raises(KeyboardInterrupt):
        train.train_together(*pair(), tmp_path)
    for run in (RunFolder(tmp_path), RunFolder(tmp_path / train.RIVAL)):
        assert not run.read().finished
        assert [path.name for path in run.checkpoints.iterdir()] == [f"{800:012d}"]
    monkeypatch.setattr(train, "ProgressCallback", real)
    train.train_together(*pair(), tmp_path, progress=False)
    for run in (RunFolder(tmp_path), RunFolder(tmp_path / train.RIVAL)):
        about = run.read()
        assert (about.finished, about.steps_done, about.part) == (True, 1200, 1)
        assert not run.checkpoints.exists()
    before = (tmp_path / "agent" / "policy.onnx").read_bytes()
    train.train_together(*pair(), tmp_path, progress=False)
    assert (tmp_path / "agent" / "policy.onnx").read_bytes() == before
    with pytest.raises(UserError, match="differs in options"):
        train.train_together(*pair(), tmp_path, weight=2, progress=False)


def test_a_pair_that_was_killed_between_its_exports_is_not_trained_again(tmp_path, monkeypatch):
    real = train._Run.finish

    def finish(run):
        if run.sides == ("ally",):
            raise KeyboardInterrupt
        real(run)

    monkeypatch.setattr(train._Run, "finish", finish)
    with pytest.raises(KeyboardInterrupt):
        train.train_together(*pair(), tmp_path, progress=False)
    rival = (tmp_path / train.RIVAL / "agent" / "policy.onnx").read_bytes()
    monkeypatch.setattr(train._Run, "finish", real)
    train.train_together(*pair(), tmp_path, progress=False)
    assert (tmp_path / train.RIVAL / "agent" / "policy.onnx").read_bytes() == rival
    assert (RunFolder(tmp_path).read().part, RunFolder(tmp_path).read().finished) == (0, True)


def test_what_does_not_learn_from_rollouts_is_refused_before_anything_is_written(tmp_path):
    learner, rival = pair("ppo")
    dqn = RunConfig("dqn", learner.game, 0, 100, settings("dqn"))
    with pytest.raises(UserError, match="dqn: does not learn from rollouts"):
        train.train_together(dqn, rival, tmp_path / "run")
    assert not (tmp_path / "run").exists()
