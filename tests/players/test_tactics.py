"""Scripts with memory: when each hops, rests, spreads, and where it jams."""

from __future__ import annotations

import re

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import ALL_TACTICS, SCRIPTED
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import STANDARD, preset
from fpg_bench.game.sensing import KNOWN_FREQUENCY
from fpg_bench.players.player import SIDES, Player
from fpg_bench.players.registry import as_player
from fpg_bench.players.seeded import SeededPolicy
from fpg_bench.players.tactics import Tactic, draw_variants

from .playing import ally_sees, opponent_sees

LINK = preset("link")


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


def test_split_jams_halves_from_the_second_after_a_move_until_the_ally_stays():
    """Checks find the ally at 0.5, elsewhere, elsewhere again, and then where it was."""
    player, state, jammed = as_player("split", "opponent", STANDARD), None, []
    player.reset(np.ones(1, bool), np.array([5], np.uint64))
    finds = ((0, 0.5), (1, 0.5), (0, -0.2), (1, -0.2), (2, -0.2), (0, 0.4), (1, 0.4), (0, 0.4), (1, 0.4))
    for age_s, known in finds:
        seen = opponent_sees(age_s=age_s)
        seen[0, KNOWN_FREQUENCY] = known
        actions, state = player.predict(seen, state)
        jammed.append((int(actions[0, :4].argmax()), float(actions[0, 4]), bool(actions[0, 5] > 0)))
    narrow = (1, 0.0, False)
    assert [each == narrow for each in jammed] == [True, True, True, False, False, True, False, True, True]
    blind = [each for each in jammed if each != narrow]
    assert {(kind, is_in_band) for kind, _, is_in_band in blind} == {(2, True)}
    assert {tuning for _, tuning, _ in blind} <= {-0.5, 0.5}


def test_the_new_scripts_are_not_part_of_all_scripted():
    assert not {"hunter", "split"} & set(SCRIPTED["opponent"])
    assert not {"evidence", "clock"} & set(SCRIPTED["ally"])


@pytest.mark.parametrize("side", SIDES)
def test_variants_are_scripts_that_can_be_played_and_a_seed_gives_the_same(side):
    names = draw_variants(side, 40, LINK, seed=3)
    assert names == draw_variants(side, 40, LINK, seed=3)
    assert len(set(names)) == 40
    assert {name.split("(")[0] for name in names} == set(ALL_TACTICS[side]) & set(SCRIPTED[side])
    for name in names:
        as_player(name, side, LINK)
