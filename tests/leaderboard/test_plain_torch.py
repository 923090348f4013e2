"""The worked example without Stable-Baselines3: its script makes what its submission holds."""

import importlib.util
from pathlib import Path

import torch

from fpg_bench.leaderboard.submission import load_submission, problems
from fpg_bench.players.agent import load_agent
from fpg_bench.players.sandbox.client import check_policy

ROOT = Path(__file__).parents[2]
ENTRY = ROOT / "leaderboard" / "submissions" / "ally" / "plain-torch"


def test_the_script_makes_agents_as_the_submission_s(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("plain", ROOT / "scripts" / "train_plain_torch.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    for name, small in (("TURNS", 2), ("GAMES", 4), ("STEPS", 40)):
        monkeypatch.setattr(script, name, small)
    monkeypatch.setattr(script.learn, "__defaults__", (20,))
    policy = script.train(7)
    script.export(policy, tmp_path / "seed_7", 7)
    agent = load_agent(tmp_path / "seed_7", "ally")
    seen = torch.rand(5, 15) * 2 - 1
    difference = policy(seen).detach().numpy() - agent.predict(seen.numpy())[0]
    assert abs(difference).max() < 1e-6
    assert check_policy(agent.model) == []
    shipped = load_submission(ENTRY)
    assert {p.about["algorithm"] for p in shipped.policies} == {agent.about["algorithm"]}


def test_its_submission_is_sound_and_no_path_is_left_in_it():
    assert problems(ENTRY) == []
    for policy in load_submission(ENTRY).policies:
        assert b"site-packages" not in policy.model
        assert b"train_plain_torch" not in policy.model
