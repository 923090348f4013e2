"""Scripts with memory: when each hops, rests, spreads, and where it jams."""

from __future__ import annotations

import re

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import ALL_TACTICS, SCRIPTED
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import STANDARD, preset
from fpg_bench.players.player import SIDES, Player
from fpg_bench.players.registry import as_player
from fpg_bench.players.seeded import SeededPolicy
from fpg_bench.players.tactics import Tactic, draw_variants

from .playing import ally_sees, mean, opponent_sees

LINK = preset("link")


def hops(player: SeededPolicy, snr_db: list[float]) -> list[bool]:
    """Return in which steps an ally hops that sees these values of the SNR."""
    state, found = None, []
    for value in snr_db:
        action, state = player.predict(ally_sees(value), state)
        assert action[0, 1] < 0 < action[0, 2]
        assert action[0, 4] == action[0, 0]  # by the knowledge base
        found.append(bool(action[0, 0] > 0))
    return found


def hit_by(kind: int | None) -> np.ndarray:
    """Return what an ally sees that is covered by jamming of a type; None: by none."""
    seen = ally_sees(covered=kind is not None)
    seen[0, 10:14] = np.arange(4) == kind
    return seen


def jams(player: SeededPolicy, seen: list[np.ndarray]) -> list[tuple[str, float, bool]]:
    """Return the type, the tuning and its reference in each step."""
    state, found = None, []
    for one in seen:
        action, state = player.predict(one, state)
        found.append(
            (JAMMING_TYPES[action[0, :4].argmax()], round(float(action[0, 4]), 3), bool(action[0, 5] > 0))
        )
    return found


def moved(known: float, jammed: float, age_s: float = 0.0) -> np.ndarray:
    """Return what an opponent sees whose tone was at ``jammed`` and who knows the frequency ``known``."""
    seen = opponent_sees(age_s=age_s)
    seen[0, 6], seen[0, 9], seen[0, 10] = known, jammed, 1
    return seen


@pytest.mark.parametrize(("side", "name"), [(side, name) for side in SIDES for name in ALL_TACTICS[side]])
def test_each_is_a_player_and_plays_a_game_of_a_batch_as_it_plays_it_alone(side, name):
    player, rng = Tactic(side, name, STANDARD), np.random.default_rng(0)
    assert isinstance(player, Player)
    seen = rng.uniform(-1, 1, (40, 5, 15)).astype(np.float32)
    starts = rng.random((40, 5)) < 0.1
    state, alone = None, [None] * 5
    players = [Tactic(side, name, STANDARD) for _ in range(5)]
    for game, single in enumerate((player, *players), -1):
        seeds = np.arange(5) if single is player else np.array([game])
        single.reset(np.ones(len(seeds), bool), seeds.astype(np.uint64))
    for step in range(40):
        actions, state = player.predict(seen[step], state, starts[step])
        for game in range(5):
            one, alone[game] = players[game].predict(
                seen[step, game : game + 1], alone[game], starts[step, game : game + 1]
            )
            assert np.array_equal(one[0], actions[game])


def test_sulk_hops_three_times_and_then_stays_for_half_a_minute():
    out, well = 0.0, 20.0
    assert hops(Tactic("ally", "sulk", STANDARD), [well, out, out, well, out]) == [
        False,
        True,
        True,
        False,
        True,
    ]
    long = hops(Tactic("ally", "sulk", STANDARD), [out] * 37)
    assert long == [*[True] * 3, *[False] * 30, *[True] * 3, False]
    assert hops(Tactic("ally", "sulk", STANDARD, patience_hops=1, rest_s=2), [out] * 5) == [
        True,
        False,
        False,
        True,
        False,
    ]


@pytest.mark.parametrize(
    ("kind", "snr_db", "covered", "spreading_s", "expected"),
    [
        ("tone", 9.9, True, 0, "spread"),
        ("tone", 10.1, True, 0, "stay"),
        ("tone", 30, True, 3, "spread"),
        ("tone", 30, False, 3, "stay"),
        ("comb", 9.9, True, 3, "hop"),
        ("comb", 10.1, True, 0, "stay"),
        ("broadband", 0, False, 0, "stay"),
    ],
)
def test_by_type_spreads_against_a_tone_and_hops_away_from_all_else(
    kind, snr_db, covered, spreading_s, expected
):
    seen = ally_sees(snr_db * STANDARD.snr_scale_db / LINK.snr_scale_db, covered, spreading_s)
    seen[0, 10 + JAMMING_TYPES.index(kind)] = 1
    action = Tactic("ally", "by-type", LINK).predict(seen)[0][0]
    assert (bool(action[0] > 0), bool(action[1] > 0)) == (expected == "hop", expected == "spread")


def test_scan_and_alternate_go_round_the_band():
    scan = jams(Tactic("opponent", "scan", STANDARD), [opponent_sees()] * 6)
    assert scan == [("narrowband", place, True) for place in (-0.8, -0.4, 0, 0.4, 0.8, -0.8)]
    alternate = jams(Tactic("opponent", "alternate", STANDARD), [opponent_sees()] * 3)
    assert alternate == [("broadband", place, True) for place in (-0.5, 0.5, -0.5)]
    slow = jams(Tactic("opponent", "alternate", STANDARD, hold_s=2), [opponent_sees()] * 3)
    assert [place for _, place, _ in slow] == [-0.5, -0.5, 0.5]


def test_guard_steps_a_comb_over_three_points_when_near_and_jams_beside_when_far():
    near = jams(Tactic("opponent", "guard", STANDARD), [opponent_sees((88, 0, 0))] * 4)
    point = round(100 / 14 / 50, 3)
    assert near == [("comb", place, False) for place in (-point, 0, point, -point)]
    assert jams(Tactic("opponent", "guard", STANDARD), [opponent_sees((90, 0, 0))]) == [
        ("narrowband", 0.28, False)
    ]


def test_herd_alternates_once_two_checks_found_the_ally_elsewhere():
    seen = [
        moved(0.2, 0.2),
        moved(0.4, 0.2),
        moved(0.4, 0.4, 3),
        moved(0.4, 0.4),
        moved(0.1, 0.4),
        moved(0.1, 0.1),
    ]
    types = jams(Tactic("opponent", "herd", STANDARD), seen)
    assert [kind for kind, _, _ in types[:4]] == ["tone", "narrowband", "tone", "tone"]
    assert types[4:] == [("broadband", -0.5, True), ("broadband", 0.5, True)]


def test_all_opponents_fly_at_the_ally():
    for name in ALL_TACTICS["opponent"]:
        action = Tactic("opponent", name, STANDARD).predict(opponent_sees((30, 0, -40)))[0][0]
        np.testing.assert_allclose(action[6:], (0.6, 0, -0.8), atol=1e-6)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sulk(rest=3)", "sulk: no constant 'rest'; did you mean 'rest_s'"),
        ("sulk(rest_s=0)", "sulk: rest_s: expected a whole number from 1 to 300, got 0"),
        ("sulk(rest_s=2.5)", "expected a whole number from 1 to 300, got 2.5"),
        ("sulk(rest_s=nan)", "got nan"),
        ("sulk(rest_s)", "sulk: expected NAME=NUMBER, got 'rest_s'"),
        ("sulc(rest_s=3)", "ally 'sulc' has no constants; did you mean 'sulk'?; these have: sulk, by-type"),
        ("alternate(centres=3)", "'alternate' plays the opponent; name a player of the ally"),
    ],
)
def test_constants_that_cannot_be_had_are_named(name, message):
    with pytest.raises(UserError, match=re.escape(message)):
        as_player(name, "ally", STANDARD)


def test_a_script_is_named_with_its_constants():
    slow = jams(
        as_player("alternate(type=1, centres=4, hold_s=2)", "opponent", STANDARD), [opponent_sees()] * 3
    )
    assert slow == [("narrowband", place, True) for place in (-0.75, -0.75, -0.25)]


def test_evidence_hops_once_hits_in_a_row_are_unlikely_to_be_blind():
    player = as_player("evidence(tone=10, broadband=2, least=2.5, most=2.5)", "ally", STANDARD)
    tone, broadband = 0, 2

    def hopped(*hits: int | None) -> list[bool]:
        state, found = None, []
        for hit in hits:
            action, state = player.predict(hit_by(hit), state)
            found.append(bool(action[0, 0] > 0))
        return found

    assert hopped(tone, tone, None, tone) == [False, True, False, False]  # 2 log 10 is above 2.5
    assert hopped(*[broadband] * 5) == [False, False, False, True, False]  # so is 4 log 2
    assert hopped(*[broadband] * 3, None, *[broadband] * 2) == [False] * 6


def test_evidence_and_clock_hop_to_any_point_with_equal_chance():
    player = as_player("clock(least=0, most=0)", "ally", STANDARD)
    player.reset(np.ones(600, bool), np.arange(600, dtype=np.uint64))
    actions, _ = player.predict(np.tile(hit_by(0), (600, 1)))
    assert (actions[:, 0] > 0).all()
    assert (actions[:, 4] < 0).all()
    counts, _ = np.histogram(actions[:, 3], bins=4, range=(-1, 1))
    assert counts.min() > 110


def test_clock_spreads_when_a_check_is_due_and_the_opponent_is_far():
    far = hit_by(0)
    far[0, 3] = 0.9
    player = as_player(
        "clock(spread_from_s=3, spread_to_s=4, spread_s=0, most=20, least=20)", "ally", STANDARD
    )
    state, spread = None, []
    for covered in (1, -1, -1, -1, -1, -1):
        far[0, 14] = covered
        actions, state = player.predict(far, state)
        spread.append(bool(actions[0, 1] > 0))
    assert spread == [False, False, False, True, True, False]
    far[0, 3] = 0.0
    assert player.predict(far, state)[0][0, 1] < 0


def test_hunter_jams_a_known_point_narrowly_and_otherwise_a_random_half():
    player, state, jammed = as_player("hunter", "opponent", STANDARD), None, []
    player.reset(np.ones(1, bool), np.array([5], np.uint64))
    for age_s in (0, 1, 2, 3, 4, 5, 6, 7):
        actions, state = player.predict(opponent_sees(age_s=age_s), state)
        jammed.append((int(actions[0, :4].argmax()), float(actions[0, 4]), bool(actions[0, 5] > 0)))
    assert jammed[:2] == [(1, 0.0, False)] * 2
    assert {kind for kind, *_ in jammed[2:]} == {2}
    assert {tuning for _, tuning, _ in jammed[2:]} == {-0.5, 0.5}


def test_the_new_scripts_are_not_part_of_all_scripted():
    assert "hunter" not in SCRIPTED["opponent"]
    assert not {"evidence", "clock"} & set(SCRIPTED["ally"])


@pytest.mark.parametrize("side", SIDES)
def test_variants_are_scripts_that_can_be_played_and_a_seed_gives_the_same(side):
    names = draw_variants(side, 40, LINK, seed=3)
    assert names == draw_variants(side, 40, LINK, seed=3)
    assert len(set(names)) == 40
    assert {name.split("(")[0] for name in names} == set(ALL_TACTICS[side]) & set(SCRIPTED[side])
    for name in names:
        as_player(name, side, LINK)


def test_herd_earns_more_than_watchful_from_an_ally_that_hops_and_as_much_from_one_that_stays():
    assert mean("opponent_return", "expert", "herd") > mean("opponent_return", "expert", "watchful") + 3
    assert mean("opponent_return", "idle", "herd") == mean("opponent_return", "idle", "watchful")


def test_sulk_earns_more_than_expert_from_opponents_that_keep_it_hopping():
    assert mean("ally_return", "sulk", "alternate") > mean("ally_return", "expert", "alternate") + 1


def test_by_type_earns_more_than_other_scripts_in_link_over_two_types():
    earned = {
        name: sum(mean("ally_return", name, opponent, LINK) for opponent in ("tone", "comb"))
        for name in ("by-type", "expert", "expert-spread", "sulk")
    }
    assert max(earned, key=earned.__getitem__) == "by-type"
