"""Games from a distribution in every interface, and in what a training writes down."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

import fpg_bench
from fpg_bench.common.errors import UserError
from fpg_bench.envs.pettingzoo_env import parallel_env
from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.game.spec import GameSpec

ID = "FPG/AllyVsScripted-v0"
RANGES = {"preset": "link", "opponent_power_dbm": [30, 42], "hop_airtime_s": [0.1, 0.5]}


def rows(envs, count: int, seed: int = 5) -> np.ndarray:
    """The rules of the first rounds of a vector environment, and of the next ones."""
    envs.reset(seed=seed)
    first = envs.core.batch.games["rules"].copy()
    envs.reset()
    return np.array([first, envs.core.batch.games["rules"]])


@pytest.mark.parametrize("scenario", [["link", "link-fast-hop"], RANGES])
def test_every_interface_draws_the_same_rules(scenario):
    envs = gymnasium.make_vec(ID, num_envs=6, scenario=scenario)
    of_batch = rows(envs, 6)
    games = fpg_bench.make_sb3(ID, 6, seed=5, scenario=scenario)
    games.reset()
    assert np.array_equal(games.core.batch.games["rules"], of_batch[0])
    env = gymnasium.make(ID, scenario=scenario).unwrapped
    duel = parallel_env(scenario=scenario)
    for number in range(2):
        env.reset(seed=None if number else 5)
        duel.reset(seed=None if number else 5)
        assert env.core.batch.games["rules"][0] == of_batch[number, 0] == duel.duel.batch.games["rules"][0]
    assert len(np.unique(of_batch)) > 1


def test_a_specification_keeps_what_is_drawn():
    spec = GameSpec(ID, scenario=["link", RANGES])
    kept = spec.to_dict()["scenario"]
    assert kept["preset"] == "link"
    assert kept["variants"][1]["opponent_power_dbm"] == [30.0, 42.0]
    assert GameSpec.from_dict(spec.to_dict()) == spec
    assert GameSpec.from_dict(spec.to_dict()).hash == spec.hash != GameSpec(ID, scenario="link").hash


def test_a_training_on_a_distribution_writes_it_down_and_is_played_elsewhere(tmp_path):
    config = fpg_bench.RunConfig("ppo-fast", GameSpec(ID, scenario=RANGES), steps=1000)
    fpg_bench.train(config, tmp_path / "run")
    run = fpg_bench.Run(tmp_path / "run")
    assert run.description.played == as_scenario(RANGES)
    card = fpg_bench.load_agent(tmp_path / "run" / "agent").card
    assert Scenario.from_dict(card.scenario_fields) == as_scenario(RANGES)
    assert not card.fits(as_scenario("link"))
    assert run.evaluate("ally-link-shifted-v1", matches=1).table()


def test_games_that_cannot_draw_their_rules_say_so():
    with pytest.raises(UserError, match="footprint_half_widths_mhz is drawn, and a waterfall shows one"):
        gymnasium.make(
            ID,
            observation="waterfall",
            scenario={"variants": [{"footprint_half_widths_mhz": [1, 1, 1, 1]}]},
        )
