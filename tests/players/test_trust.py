"""Policies play in the user's own process only if the user trusts them."""

import shutil

import numpy as np
import pytest

from fpg_bench import load_agent, write_agent
from fpg_bench.players.agent import OnnxPlayer, baselines_folder
from fpg_bench.players.trust import is_exported_here
from fpg_bench.products.sandbox.agent import SandboxedAgent
from tests.products.leaderboard.making import policy, write_seed, write_submission

SEEN = np.linspace(-1, 1, 60, dtype=np.float32).reshape(4, 15)
ABOUT = {"algorithm": "x", "id": "FPG/AllyVsScripted-v0", "training_seed": 0, "training_steps": 1}


def test_an_agent_of_the_package_and_one_that_was_exported_here_are_trusted(tmp_path):
    assert type(load_agent("ally-scripted/ppo/seed_0")) is OnnxPlayer
    assert type(load_agent(baselines_folder() / "agents/ally-scripted/ppo/seed_0")) is OnnxPlayer
    write_agent(tmp_path / "mine", policy(7), **ABOUT)
    assert type(load_agent(tmp_path / "mine")) is OnnxPlayer
    shutil.copytree(tmp_path / "mine", tmp_path / "copied")
    assert type(load_agent(tmp_path / "copied")) is OnnxPlayer


@pytest.mark.parametrize("is_copied", [False, True])
def test_a_strangers_policy_is_sandboxed_wherever_its_folder_lies(tmp_path, is_copied):
    folder = write_submission(tmp_path / "theirs", ()) / "seed_0"
    write_seed(folder, 0, policy(8))
    if is_copied:  # out of the submission, so that nothing beside it says where it comes from
        folder = shutil.copytree(folder, tmp_path / "agent")
    player = load_agent(folder)
    assert type(player) is SandboxedAgent
    trusted = load_agent(folder, trusted=True)
    assert type(trusted) is OnnxPlayer
    assert (player.predict(SEEN)[0] == trusted.predict(SEEN)[0]).all()


def test_the_caller_can_distrust_any_agent():
    assert type(load_agent("ally-scripted/ppo/seed_0", trusted=False)) is SandboxedAgent


def test_where_nothing_can_be_kept_policies_are_sandboxed(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "file"))
    write_agent(tmp_path / "mine", policy(9), **ABOUT)
    agent = load_agent(tmp_path / "mine")
    assert type(agent) is SandboxedAgent
    assert not is_exported_here(agent.card.policy_sha256)
