"""FPG/AllyVsLLM-v0: the planner view with a language model, which is never replaced by anything else."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

import fpg_bench
from fpg_bench.envs.sb3 import make_sb3
from fpg_bench.errors import UserError
from tests.planning.llm.fault_server import FaultServer, ok, status
from tests.planning.llm.playing import path, path_text

LLM = "FPG/AllyVsLLM-v0"


@pytest.fixture(autouse=True)
def no_endpoint(monkeypatch):
    for name in ("BASE_URL", "MODEL", "API_KEY", "SERVER"):
        monkeypatch.delenv(f"FPG_LLM_{name}", raising=False)


def configure(monkeypatch, server):
    monkeypatch.setenv("FPG_LLM_BASE_URL", server.url)
    monkeypatch.setenv("FPG_LLM_MODEL", "tiny")


@pytest.mark.parametrize(
    "make", [gymnasium.make, gymnasium.make_vec, make_sb3], ids=lambda make: make.__name__
)
def test_without_an_endpoint_it_says_in_one_line_what_to_set(make):
    with pytest.raises(UserError, match="FPG_LLM_BASE_URL") as caught:
        make(LLM)
    assert "\n" not in str(caught.value)


def test_what_the_model_plans_is_flown(monkeypatch):
    with FaultServer([ok(path_text(shift)) for shift in (0, 40, 80)]) as server:
        configure(monkeypatch, server)
        env = gymnasium.make(LLM)
        env.reset(seed=1)
        for shift in (0, 40):
            (plan,) = env.unwrapped.core.duel.plans
            assert (plan.source, plan.status) == ("llm", "ok")
            assert np.array_equal(plan.waypoints, path(shift))
            while not env.step(env.action_space.sample())[3]:
                pass
            env.reset()
        assert len(server.requests) == 3


def test_a_server_that_fails_shows_in_the_status(monkeypatch):
    with FaultServer([status(500)]) as server:
        configure(monkeypatch, server)
        games = fpg_bench.make_sb3(LLM, n_envs=2, seed=0)
        games.reset()
        assert [plan.status for plan in games.core.duel.plans] == ["fallback-http"] * 2
        assert {plan.source for plan in games.core.duel.plans} == {"circle"}


def test_it_has_ten_rounds_a_match_and_takes_any_planner(monkeypatch):
    env = gymnasium.make(LLM, planner="hold")
    env.reset(seed=0)
    assert env.unwrapped.core.scenario.rounds_per_match == 10
    assert env.unwrapped.core.duel.plans[0].source == "hold"
