"""Each script's actions, given what it sees."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from fpg_bench.common.ids import ALLIES, OPPONENTS
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import STANDARD, preset
from fpg_bench.players.player import Player
from fpg_bench.players.scripted import Scripted

from .playing import ally_sees, opponent_sees

HOP, SPREAD, SPEED, PREFERENCE, KNOWLEDGE = range(5)


def acts(side, name, seen, state=None):
    return Scripted(side, name, STANDARD).predict(seen, state)[0][0]


def gates(action):
    return tuple(bool(action[i] > 0) for i in (HOP, SPREAD, KNOWLEDGE))


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


NONE, HOPS, EXPERT, HIDES = (False,) * 3, (True, False, False), (True, False, True), (True, True, True)


@pytest.mark.parametrize(
    ("name", "seen", "expected"),
    [
        ("idle", ally_sees(0, covered=True), NONE),
        ("reactive", ally_sees(8.1, covered=True), NONE),
        ("reactive", ally_sees(7.9), HOPS),
        ("expert", ally_sees(29.9, covered=True), EXPERT),
        ("expert", ally_sees(30.1, covered=True), NONE),
        ("expert", ally_sees(0, covered=False), NONE),
        ("expert-spread", ally_sees(29.9, covered=True), HIDES),
        ("expert-spread", ally_sees(60), NONE),
        ("always-hop", ally_sees(60), HOPS),
    ],
)
def test_when_an_ally_hops_spreads_and_asks_the_knowledge_base(name, seen, expected):
    action = acts("ally", name, seen)
    assert gates(action) == expected
    assert action[SPEED] == 1


def test_the_constants_of_scripts_are_those_of_the_scenario():
    """In link, expert leaves alone what 10 dB keep going, and adaptive jams wide from farther away."""
    link = preset("link")
    for snr, hops in ((9.9, True), (10.1, False)):
        seen = ally_sees(snr * STANDARD.snr_scale_db / link.snr_scale_db, covered=True)
        action = Scripted("ally", "expert", link).predict(seen, None)[0][0]
        assert gates(action) == (EXPERT if hops else NONE)
    for metres, kind in ((79, "broadband"), (119, "comb"), (121, "narrowband")):
        action = Scripted("opponent", "adaptive", link).predict(opponent_sees((metres, 0, 0)), None)[0][0]
        assert JAMMING_TYPES[action[:4].argmax()] == kind


def test_expert_spread_spreads_for_eight_seconds():
    spreading_s, lasted = 0, 0
    for k in range(20):
        seen = ally_sees(20, covered=True) if k == 0 else ally_sees(60, spreading_s=spreading_s)
        spread = gates(acts("ally", "expert-spread", seen))[1]
        spreading_s = spreading_s + 1 if spread else 0
        lasted += spread
    assert lasted == 8


@pytest.mark.parametrize("kind", JAMMING_TYPES)
def test_a_plain_jammer_jams_its_type_at_the_known_frequency(kind):
    action = acts("opponent", kind, opponent_sees())
    assert int(action[:4].argmax()) == JAMMING_TYPES.index(kind)
    assert action[4] == 0
    assert action[5] < 0


@pytest.mark.parametrize(
    ("away_m", "age_s", "kind"),
    [
        ((300, 0, 0), 0, "tone"),
        ((10, 0, 0), 0, "tone"),
        ((34, 0, 0), 1, "broadband"),
        ((0, 36, 0), 1, "comb"),
        ((0, 0, -89), 3, "comb"),
        ((0, 91, 0), 1, "narrowband"),
        ((60, 60, 60), 60, "narrowband"),
    ],
)
def test_adaptive_jams_by_the_age_of_what_it_knows_and_the_distance(away_m, age_s, kind):
    action = acts("opponent", "adaptive", opponent_sees(away_m, age_s))
    assert JAMMING_TYPES[action[:4].argmax()] == kind


@pytest.mark.parametrize(
    ("age_s", "jammed", "known", "kind"),
    [
        (0, None, 0.2, "tone"),
        (0, ("narrowband", 0.2), 0.2, "tone"),
        (0, ("tone", 0.2), -0.4, "narrowband"),
        (1, ("tone", 0.2), 0.2, "tone"),
        (1, ("narrowband", 0.2), 0.2, "broadband"),
    ],
)
def test_watchful_keeps_a_tone_on_an_ally_that_stays(age_s, jammed, known, kind):
    seen = opponent_sees((20, 0, 0), age_s)
    seen[0, 6] = known
    if jammed is not None:
        seen[0, 9], seen[0, 10 + JAMMING_TYPES.index(jammed[0])] = jammed[1], 1
    assert JAMMING_TYPES[acts("opponent", "watchful", seen)[:4].argmax()] == kind


def test_sweep_goes_up_the_band_one_point_a_step_and_round_again():
    player, state, places = Scripted("opponent", "sweep", STANDARD), None, []
    for _ in range(17):
        actions, state = player.predict(opponent_sees(), state)
        assert actions[0, 5] > 0
        assert JAMMING_TYPES[actions[0, :4].argmax()] == "narrowband"
        places.append(round((actions[0, 4] + 1) / 2 * 14))
    assert places == [*range(15), 0, 1]
    assert player.predict(opponent_sees(), state, np.array([True]))[0][0, 4] == -1


@pytest.mark.parametrize(
    ("away_m", "velocity"),
    [
        ((300, 0, 0), (1, 0, 0)),
        ((-30, 0, 40), (-0.6, 0, 0.8)),
        ((0, 5, 0), (0, 0.5, 0)),
        ((0, 0, 0), (0, 0, 0)),
    ],
)
def test_where_it_flies_itself_a_script_flies_at_the_ally_and_slows_down(away_m, velocity):
    assert acts("opponent", "tone", opponent_sees(away_m))[6:] == pytest.approx(velocity, abs=1e-5)


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
