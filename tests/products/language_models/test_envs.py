"""FPG/AllyVsLLM-v0: a language model plans, and nothing ever replaces it."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.envs.sb3_vec_env import make_sb3
from fpg_bench.players.planner import Plan, as_planner
from fpg_bench.products.language_models.background import BackgroundPlanner
from fpg_bench.products.language_models.llm_planner import LLM_CONTROLS
from tests.products.language_models.fault_server import FaultServer, ok
from tests.products.language_models.playing import path, path_text

LLM = "FPG/AllyVsLLM-v0"


class Circling:
    """A planner that borrows a language model's name."""

    name, tier = "llm", "history"

    def plan(self, history, current_position, limits, rng):
        return Plan(np.zeros((limits.waypoints, 3)), self.name)


@pytest.fixture(autouse=True)
def no_endpoint(monkeypatch):
    for name in ("BASE_URL", "MODEL", "API_KEY", "SERVER"):
        monkeypatch.delenv(f"FPG_LLM_{name}", raising=False)


def configure(monkeypatch, url):
    monkeypatch.setenv("FPG_LLM_BASE_URL", url)
    monkeypatch.setenv("FPG_LLM_MODEL", "tiny")


every_kind = pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec, make_sb3])


def test_what_the_model_plans_is_flown(monkeypatch):
    with FaultServer([ok(path_text(shift)) for shift in (0, 40, 80)]) as server:
        configure(monkeypatch, server.url)
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


@pytest.mark.parametrize("spec", LLM_CONTROLS)
def test_it_has_ten_rounds_a_match_and_takes_every_planner_that_asks_a_model(monkeypatch, spec):
    configure(monkeypatch, "http://127.0.0.1:9/v1")  # never asked

    def beside(scenario):
        return BackgroundPlanner(as_planner(spec, scenario))

    for planner in (spec, beside):
        core = gymnasium.make(LLM, planner=planner).unwrapped.core
        assert core.scenario.rounds_per_match == 10
        assert core.planner.name.removesuffix("-beside") == spec


@every_kind
@pytest.mark.parametrize("spec", ["interceptor", Circling])
def test_it_refuses_a_planner_that_asks_no_language_model(make, spec):
    with pytest.raises(UserError, match="does not use one; FPG/AllyVsPlanner-v0 takes any planner"):
        make(LLM, planner=spec)
