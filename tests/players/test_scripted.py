"""Each script's actions, given what it sees."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from fpg_bench.common.ids import ALLIES, OPPONENTS
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.player import Player
from fpg_bench.players.scripted import Scripted, js_db, scenario_scales, separation_m

from .playing import opponent_sees

PLAIN = [*product(["ally"], ALLIES), *product(["opponent"], OPPONENTS)]


@pytest.mark.parametrize(("side", "name"), PLAIN)
def test_a_script_is_a_player_and_takes_one_game_or_many(side, name):
    player = Scripted(side, name, STANDARD)
    assert isinstance(player, Player)
    many, state = player.predict(np.zeros((3, 15), np.float32))
    assert many.shape == (3, 9)
    assert state.tolist() == [1, 1, 1]
    one, _ = Scripted(side, name, STANDARD).predict(np.zeros(15, np.float32))
    assert np.array_equal(one, many[0])


def test_sweep_goes_up_the_band_one_point_a_step_and_round_again():
    player, state, places = Scripted("opponent", "sweep", STANDARD), None, []
    for _ in range(17):
        actions, state = player.predict(opponent_sees(), state)
        assert actions[0, 5] > 0
        assert JAMMING_TYPES[actions[0, :4].argmax()] == "narrowband"
        places.append(round((actions[0, 4] + 1) / 2 * 14))
    assert places == [*range(15), 0, 1]
    assert player.predict(opponent_sees(), state, np.array([True]))[0][0, 4] == -1


def test_a_script_works_out_the_distance_and_the_jamming_over_the_signal():
    """In the middle of the box, and with both in free space."""
    seen, scales = opponent_sees((300.0, -40.0, 12.0))[0], scenario_scales(STANDARD)[0]
    apart_m = np.linalg.norm([300, 40, 12])
    base_m = np.linalg.norm(np.divide(STANDARD.box_m, 2) - STANDARD.base_station_m)
    assert separation_m(seen, scales) == pytest.approx(apart_m, rel=1e-5)
    assert js_db(seen, scales) == pytest.approx(scales["js_db"] + 20 * np.log10(base_m / apart_m), abs=1e-3)


@pytest.mark.parametrize("side", ["ally", "opponent"])
def test_random_fills_the_whole_range_by_the_seeds_it_was_given(side):
    def drawn(seeds, steps=50):
        player, state, found = Scripted(side, "random", STANDARD), None, []
        player.reset(np.ones(len(seeds), bool), seeds)
        for _ in range(steps):
            actions, state = player.predict(np.zeros((len(seeds), 15), np.float32), state)
            found.append(actions)
        return np.array(found)

    seeds = np.arange(100, dtype=np.uint64)
    actions = drawn(seeds)
    assert np.abs(actions.mean(axis=(0, 1))).max() < 0.05
    assert actions.std(axis=(0, 1)) == pytest.approx(np.full(9, 3**-0.5), abs=0.02)
    assert np.abs(actions).max() <= 1
    assert np.array_equal(drawn(seeds[7:8]), actions[:, 7:8])
    assert len(np.unique(actions[:, 0, 0])) == 50


def test_only_the_games_that_begin_take_new_seeds():
    player = Scripted("ally", "random", STANDARD)
    seen, first = np.zeros((2, 15), np.float32), np.array([1, 2], np.uint64)
    player.reset(np.array([True, True]), first)
    before = player.predict(seen)[0]
    player.reset(np.array([True, False]), np.array([9, 9], np.uint64))
    after = player.predict(seen)[0]
    assert not np.array_equal(before[0], after[0])
    assert np.array_equal(before[1], after[1])
