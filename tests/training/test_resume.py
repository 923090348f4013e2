"""A run that was stopped goes on where it was, ends as it would have, and never loses a good checkpoint."""

import base64
import errno
import json
import pickle
import re
import signal
import threading
import zipfile

import numpy as np
import pytest
import torch
from stable_baselines3.common.callbacks import BaseCallback
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch.utils.tensorboard import SummaryWriter

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.seeds import training_seed
from fpg_bench.game.batch import check_seeds
from fpg_bench.players.agent import load_agent
from fpg_bench.training import checkpoint, train
from fpg_bench.training.checkpoint import newest_checkpoint
from tests.logged import logged
from tests.programs import held_elsewhere
from tests.training.tiny import settings, train_tiny

ALGORITHMS = ["sac", "dqn", "recurrent-ppo", "ppo-stack3", "ppo-fast"]


class Watched(BaseCallback):
    """Stands where the progress bar would, after all that keeps; stops a run, and sees what its model was."""

    def __init__(self, at=None, by_signal=False):
        super().__init__()
        self.at, self.seen, self.seeds, self.counts, self.rates = at, None, None, 0, []
        self.by_signal = by_signal

    def _on_rollout_start(self):
        self.rates.append(self.model.lr_schedule(self.model._current_progress_remaining))
        stops = self.at is not None and self.num_timesteps >= self.at
        if self.seen is None or stops:
            self.seeds = self.seeds or self.training_env.unwrapped.core.duel.batch.games["seed"].tolist()
            self.seen = snapshot(self.model)
            self.counts = round(self.model.get_vec_normalize_env().obs_rms.count)
        if stops and self.by_signal:
            signal.raise_signal(signal.SIGINT)
        elif stops:
            raise KeyboardInterrupt

    def _on_step(self):
        return True

    def close(self):
        """Nothing to close."""


def snapshot(model):
    """Everything that must be the same after a stop, as plain numbers."""
    state = {"steps": model.num_timesteps, "updates": model._n_updates}
    for name, part in model.get_parameters().items():
        states = part["state"] if "optimizer" in name else part
        state[name] = json.dumps(states, default=lambda x: np.asarray(x).tolist())
    returns = model.get_vec_normalize_env().ret_rms
    state["returns"] = [float(returns.mean), float(returns.var), float(returns.count)]
    if (buffer := getattr(model, "replay_buffer", None)) is not None:
        state["buffer"] = [buffer.pos, buffer.observations[: buffer.pos].tolist(), buffer.rewards.tolist()]
    return state


def watched(monkeypatch, at=None):
    """Return a callback that the next runs are watched by."""
    watch = Watched(at)
    monkeypatch.setattr(train, "ProgressCallback", lambda budget: watch)
    return watch


def stopped(algorithm, out, monkeypatch, at=600, **options):
    """A run that is stopped at a step, right after its checkpoint was written; it will export nothing."""
    monkeypatch.setattr(train, "write_exported", lambda *a: 0.0)
    monkeypatch.setattr("fpg_bench.training.callbacks.SAVE_EVERY_S", -1.0)
    watch = watched(monkeypatch, at)
    with pytest.raises(KeyboardInterrupt):
        train_tiny(algorithm, out, progress=True, **options)
    return watch


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_resumed_run_continues_from_its_checkpoint_to_its_budget(algorithm, tmp_path, monkeypatch):
    policy = settings(algorithm)["policy_kwargs"] | {"activation_fn": "ELU"}
    options = {"changes": {"learning_rate": "lin_0.001", "policy_kwargs": policy}}
    if algorithm == "dqn":
        options["actions"] = "discrete"
    first = stopped(algorithm, tmp_path / "run", monkeypatch, **options)
    with pytest.raises(UserError, match="unfinished; continue it with --resume"):
        train_tiny(algorithm, tmp_path / "run", **options)
    second = watched(monkeypatch)
    train_tiny(algorithm, tmp_path / "run", progress=True, resume=True, **options)
    assert first.seen["steps"] >= 600
    assert second.seen == first.seen
    # The games' first observations are normalised, and counted, at each beginning
    assert second.counts == first.counts + 4
    assert any(isinstance(layer, torch.nn.ELU) for layer in second.model.policy.modules())
    assert set(second.seeds).isdisjoint(first.seeds)
    assert (first.seeds[0], second.seeds[0]) == (0, 1)
    assert second.rates[-1] <= second.rates[0] == first.rates[-1] < first.rates[0]
    about = json.loads((tmp_path / "run" / "run.json").read_text())
    assert about["steps_done"] == 1200
    assert (about["finished"], about["part"]) == (True, 1)
    assert not (tmp_path / "run" / "checkpoints").exists()


@pytest.mark.slow
def test_runs_of_neighbouring_seeds_play_other_matches(tmp_path, monkeypatch):
    seeds = []
    for seed in (0, 1):
        watch = stopped("ppo", tmp_path / str(seed), monkeypatch, at=400, seed=seed)
        seeds.append(watch.seeds)
    assert seeds == [check_seeds(training_seed(seed), 4).tolist() for seed in (0, 1)]
    assert not set(seeds[0]) & set(seeds[1])


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_run_that_stopped_before_any_saved_step_ends_as_if_it_had_not(algorithm, tmp_path, monkeypatch):
    runs = [tmp_path / "stopped", tmp_path / "uninterrupted", tmp_path / "not exported"]
    with monkeypatch.context() as patched:
        watched(patched, at=400)
        with pytest.raises(KeyboardInterrupt):  # its only checkpoint is that of the first evaluation
            train_tiny(algorithm, runs[0], progress=True, evaluations=1)
    assert newest_checkpoint(runs[0] / "checkpoints").name == f"{0:012d}"
    with monkeypatch.context() as patched:
        patched.setattr(train, "write_exported", interrupt)
        with pytest.raises(KeyboardInterrupt):
            train_tiny(algorithm, runs[2], evaluations=1)
    agents = [load_agent(train_tiny(algorithm, run, resume=True, evaluations=1)) for run in runs]
    assert len({agent.card.policy_sha256 for agent in agents}) == 1
    assert json.loads((runs[2] / "run.json").read_text())["part"] == 0


def interrupt(*arguments):
    raise KeyboardInterrupt


@pytest.mark.slow
def test_a_truncated_checkpoint_is_one_clear_line(tmp_path, monkeypatch):
    stopped("sac", tmp_path / "run", monkeypatch)
    for name in ("model.zip", "normalize.npz", "replay_buffer.npz", "progress.json"):
        path = newest_checkpoint(tmp_path / "run" / "checkpoints") / name
        whole = path.read_bytes()
        path.write_bytes(whole[: len(whole) // 2])
        with pytest.raises(UserError, match=r"checkpoint .*0600: cannot be read .*--restart"):
            train_tiny("sac", tmp_path / "run", resume=True)
        path.write_bytes(whole)
    train_tiny("sac", tmp_path / "run", resume=True)


class Intruder:
    """Its pickle makes a file where it is opened."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return open, (str(self.file), "w")


@pytest.mark.slow
@pytest.mark.parametrize("how", ["resume", "start"])
def test_no_pickle_of_a_run_is_opened(tmp_path, monkeypatch, how):
    if how == "resume":
        stopped("sac", tmp_path / "run", monkeypatch)
        folder = newest_checkpoint(tmp_path / "run" / "checkpoints")
    else:
        train_tiny("sac", tmp_path / "run")
        folder = tmp_path / "run"
    evil = pickle.dumps(Intruder(tmp_path / "opened"))
    with zipfile.ZipFile(folder / "model.zip") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    data = json.loads(members["data"])
    data["lr_schedule"] = {":type:": "x", ":serialized:": base64.b64encode(evil).decode()}
    with zipfile.ZipFile(folder / "model.zip", "w") as archive:
        for name, content in (members | {"data": json.dumps(data).encode()}).items():
            archive.writestr(name, content)
    for name in ("normalize.pkl", "replay_buffer.pkl"):
        (folder / name).write_bytes(evil)
    if how == "resume":
        train_tiny("sac", tmp_path / "run", resume=True)
    else:
        train_tiny("sac", tmp_path / "next", start=tmp_path / "run")
    assert not (tmp_path / "opened").exists()


@pytest.mark.slow
def test_an_incomplete_checkpoint_leaves_the_one_before(tmp_path, monkeypatch):
    real = checkpoint.write_json
    written = []

    def fail(path, content):
        written.append(path)
        if len(written) == 3:
            raise OSError(errno.ENOSPC, "no space left")
        real(path, content)

    monkeypatch.setattr(checkpoint, "write_json", fail)
    with pytest.raises(OSError, match="no space"):
        stopped("td3", tmp_path / "run", monkeypatch)
    folder = tmp_path / "run" / "checkpoints"
    assert newest_checkpoint(folder).name == f"{200:012d}"  # at 0 and at 200, not at 400
    assert (folder / f".{400:012d}").exists()
    train_tiny("td3", tmp_path / "run", resume=True)


def test_another_run_is_not_resumed_and_a_resumed_one_says_that_its_policy_is_another(tmp_path, monkeypatch):
    stopped("ppo", tmp_path / "run", monkeypatch)
    for options, message in (
        ({"restart": True}, "give only one of them"),
        ({"steps": 2400}, r"holds this run with 1,200 steps, .* --start"),
        ({"opponent": "tone"}, "holds another run"),
    ):
        with pytest.raises(UserError, match=message):
            train_tiny("ppo", tmp_path / "run", resume=True, **options)
    message = "run: another process is writing there; wait until it ends"
    with held_elsewhere(tmp_path / "run" / "run.json"), pytest.raises(UserError, match=message):
        train_tiny("ppo", tmp_path / "run", resume=True)
    with logged() as messages:
        train_tiny("ppo", tmp_path / "run", resume=True)
    (line,) = [line for line in messages if "resumed" in line]
    assert re.search(r"resumed at 800 steps .* differs from that of an uninterrupted run", line)


@pytest.mark.slow
def test_a_resumed_run_has_each_evaluation_once(tmp_path, monkeypatch):
    stopped("ppo", tmp_path / "run", monkeypatch, at=800, evaluations=3)
    train_tiny("ppo", tmp_path / "run", resume=True, evaluations=3)
    rows = RowFile(tmp_path / "run" / "evaluations.jsonl").read()
    assert [row["steps"] for row in rows] == [0, 400, 800, 1200]
    assert [row["seconds"] for row in rows] == sorted(row["seconds"] for row in rows)


@pytest.mark.slow
def test_tensorboard_does_not_go_back_behind_a_kill(tmp_path, monkeypatch):
    """Values that a killed process logged behind its last checkpoint are dropped."""
    stopped("ppo", tmp_path / "run", monkeypatch, at=800)
    with SummaryWriter(tmp_path / "run") as killed:
        for step in (700, 800, 1000, 5000):
            killed.add_scalar("killed", 0, step)
    train_tiny("ppo", tmp_path / "run", resume=True)
    events = EventAccumulator(str(tmp_path / "run"))
    events.Reload()
    assert [event.step for event in events.Scalars("killed")] == [700, 800]
    steps = [event.step for event in events.Scalars("time/fps")]
    assert steps == sorted(steps)
    assert steps[-1] == 1200


@pytest.mark.slow
def test_ctrl_c_saves_the_run_before_it_ends(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(train, "ProgressCallback", lambda budget: Watched(400, by_signal=True))
    with pytest.raises(KeyboardInterrupt):
        train_tiny("ppo", tmp_path / "run", progress=True)
    assert "stopping as soon as the run can be saved" in capfd.readouterr().err
    assert int(newest_checkpoint(tmp_path / "run" / "checkpoints").name) >= 400


# In a process of its own


@pytest.mark.slow
def test_ctrl_c_is_heard_in_the_main_thread_only(tmp_path):
    before, ended = signal.getsignal(signal.SIGINT), []
    thread = threading.Thread(target=lambda: ended.append(train_tiny("ppo", tmp_path / "run", steps=400)))
    thread.start()
    thread.join()
    assert ended
    assert signal.getsignal(signal.SIGINT) is before
