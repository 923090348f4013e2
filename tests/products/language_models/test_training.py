"""Training against a language model that plans beside the game, on a server of the tests."""

from __future__ import annotations

import json

import pytest

from tests.products.language_models.fault_server import FaultServer, ok
from tests.products.language_models.playing import path_text
from tests.training.tiny import train

LLM = "FPG/AllyVsLLM-v0"
TINY = {"policy": "MlpPolicy", "n_envs": 2, "n_timesteps": 3600, "n_steps": 300, "batch_size": 300}
TINY |= {"n_epochs": 1, "policy_kwargs": {"net_arch": [8]}}


def lines(path, kind):
    return [row for row in map(json.loads, path.read_text().splitlines()) if row["kind"] == kind]


@pytest.mark.slow
def test_a_run_is_repeated_from_its_transcript_without_a_server(tmp_path, monkeypatch):
    with FaultServer([ok(path_text(shift)) for shift in range(40)]) as server:
        monkeypatch.setenv("FPG_LLM_BASE_URL", server.url)
        monkeypatch.setenv("FPG_LLM_MODEL", "tiny")
        agent = train("ppo", LLM, tmp_path / "live", hyperparams=TINY)
    monkeypatch.delenv("FPG_LLM_BASE_URL")
    transcript = tmp_path / "live" / "transcript.jsonl"
    flown = lines(transcript, "flown")
    assert len(flown) == 2 * 7  # the first of seven rounds of two games are cut
    assert any(line["planned_round"] is not None for line in flown)
    assert 0 < len(lines(transcript, "attempt")) == len(server.requests)

    plans = json.loads((agent / "agent.json").read_text())["plans"]
    assert sum(plans.values()) == len(flown)
    assert set(plans) == {"held", "ok"}

    again = train(
        "ppo", LLM, tmp_path / "again", planner_options={"transcript": transcript}, hyperparams=TINY
    )
    assert (again / "policy.onnx").read_bytes() == (agent / "policy.onnx").read_bytes()
    assert not (tmp_path / "again" / "transcript.jsonl").exists()


@pytest.mark.slow
def test_caps_hold_in_training_and_a_restart_keeps_the_transcript(tmp_path, monkeypatch):
    with FaultServer([ok(path_text())]) as server:
        monkeypatch.setenv("FPG_LLM_BASE_URL", server.url)
        monkeypatch.setenv("FPG_LLM_MODEL", "tiny")
        train("ppo", LLM, tmp_path / "run", planner_options={"calls": 2}, hyperparams=TINY)
        assert len(server.requests) == 2
        about = json.loads((tmp_path / "run" / "run.json").read_text())
        assert about["options"] == {"calls": 2}
        (tmp_path / "run" / "run.json").write_text(json.dumps(about | {"finished": False}))
        before = (tmp_path / "run" / "transcript.jsonl").read_bytes()
        train("ppo", LLM, tmp_path / "run", planner_options={"calls": 2}, restart=True, hyperparams=TINY)
        assert (tmp_path / "run" / "transcript-1.jsonl").read_bytes() == before
        assert len(server.requests) == 4
