"""All environments keep one contract, and its checks find what breaks it."""

from __future__ import annotations

from functools import partial

import gymnasium
import pytest

from fpg_bench import make_duel, make_sb3
from fpg_bench.envs.pettingzoo_env import parallel_env
from fpg_bench.envs.sb3_vec_env import make_sb3_duel

from .contract import CHECKS
from .playing import IDS, SHORT

GAMES = 3
ENVS = {
    **{f"single {name}": partial(gymnasium.make, name, scenario=SHORT) for name in IDS},
    **{f"batch {name}": partial(gymnasium.make_vec, name, GAMES, scenario=SHORT) for name in IDS},
    **{f"sb3 {name}": partial(make_sb3, name, GAMES, scenario=SHORT) for name in IDS},
    "sb3 of both sides": partial(make_sb3_duel, GAMES, scenario=SHORT),
    "duel": partial(make_duel, GAMES, scenario=SHORT),
    "duel with a planner": partial(make_duel, GAMES, scenario=SHORT, planner="random"),
    "pettingzoo": partial(parallel_env, scenario=SHORT),
}


@pytest.mark.parametrize("check", CHECKS)
@pytest.mark.parametrize("kind", ENVS)
def test_the_contract_holds(kind, check):
    CHECKS[check](ENVS[kind])


# A env of one game that is spoilt in one place; ``sound`` is what it did before
