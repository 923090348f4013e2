"""fpg-bench: the benchmark suite for the UAV frequency point game.

Importing registers the ids with Gymnasium and PettingZoo, turns the telemetry of libraries off and loads
nothing heavy; the names below load what they need when they are first used.
"""
# ruff: noqa: E402

from __future__ import annotations

from fpg_bench.common.starting import stop_in_one_line

stop_in_one_line()

import importlib
from typing import TYPE_CHECKING, Any

import gymnasium
import pettingzoo

from fpg_bench.common.errors import UserError
from fpg_bench.common.extras import turn_off_telemetry
from fpg_bench.common.ids import DUEL, registered_ids
from fpg_bench.common.products import offered
from fpg_bench.version import __version__

if TYPE_CHECKING:
    from fpg_bench.envs.sb3_vec_env import make_sb3
    from fpg_bench.envs.supersuit_bridge import supersuit_vec_env
    from fpg_bench.envs.two_player import make_duel
    from fpg_bench.evaluation.evaluate import evaluate
    from fpg_bench.evaluation.log_evaluation import log_evaluation
    from fpg_bench.evaluation.policy_evaluator import PolicyEvaluator
    from fpg_bench.game.scenario import Scenario, preset
    from fpg_bench.game.spec import GameSpec
    from fpg_bench.players.agent import load_agent, write_agent
    from fpg_bench.training.config import RunConfig
    from fpg_bench.training.export import export_agent
    from fpg_bench.training.fast_ppo import FastPPO
    from fpg_bench.training.run import Run
    from fpg_bench.training.train import train

_HOMES = {
    "Scenario": "fpg_bench.game.scenario",
    "preset": "fpg_bench.game.scenario",
    "make_duel": "fpg_bench.envs.two_player",
    "GameSpec": "fpg_bench.game.spec",
    "make_sb3": "fpg_bench.envs.sb3_vec_env",
    "supersuit_vec_env": "fpg_bench.envs.supersuit_bridge",
    "evaluate": "fpg_bench.evaluation.evaluate",
    "log_evaluation": "fpg_bench.evaluation.log_evaluation",
    "PolicyEvaluator": "fpg_bench.evaluation.policy_evaluator",
    "load_agent": "fpg_bench.players.agent",
    "write_agent": "fpg_bench.players.agent",
    "export_agent": "fpg_bench.training.export",
    "FastPPO": "fpg_bench.training.fast_ppo",
    "Run": "fpg_bench.training.run",
    "RunConfig": "fpg_bench.training.config",
    "train": "fpg_bench.training.train",
}

__all__ = [
    "FastPPO",
    "GameSpec",
    "PolicyEvaluator",
    "Run",
    "RunConfig",
    "Scenario",
    "UserError",
    "__version__",
    "evaluate",
    "export_agent",
    "load_agent",
    "log_evaluation",
    "make_duel",
    "make_sb3",
    "preset",
    "supersuit_vec_env",
    "train",
    "write_agent",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'fpg_bench' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)


def _register() -> None:
    if hasattr(pettingzoo, "register"):  # since PettingZoo 1.27
        for kind in ("parallel", "aec"):
            for game in (DUEL, *offered("game")):
                place = f"fpg_bench.envs.pettingzoo_env:{kind}_env"
                pettingzoo.register(kind, game, place, kwargs={"game": game})
    for name in registered_ids():
        gymnasium.register(
            id=name,
            entry_point="fpg_bench.envs.gymnasium_env:FPGEnv",
            vector_entry_point="fpg_bench.envs.gymnasium_vector:FPGVectorEnv",
            kwargs={"env_id": name},
        )


turn_off_telemetry()
_register()
