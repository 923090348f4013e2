"""Both sides at once: rounds and matches, chance, plans between rounds; all environments show it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fpg_bench import make_duel
from fpg_bench.common.errors import UserError
from fpg_bench.game.batch import check_seeds
from fpg_bench.players.planner import Plan

from .playing import SHORT, STEPS, tape

# Plans between rounds


class Diary:
    """A planner that keeps what it is handed and answers by chance."""

    name, tier = "diary", "history"

    def __init__(self):
        self.histories, self.positions = [], []

    def plan(self, history, current_position, limits, rng):
        self.histories.append(history.copy())
        self.positions.append(current_position.copy())
        return Plan(rng.uniform(0, limits.box_m, (limits.waypoints, 3)), self.name)


def rounds(duel, count, seed=3):
    """Rounds of random actions: the plans, and the opponent's positions ``(rounds, steps, games, 3)``."""
    actions, plans, flown = tape(duel.count, STEPS), [], []
    duel.reset(seeds=seed)
    for _ in range(count):
        plans.append([plan.waypoints for plan in duel.plans])
        track = []
        for action in actions:
            duel.step(action, action)
            track.append(duel.batch.games["opponent_position"].copy())
        flown.append(track)
        duel.reset()
    return np.array(plans), np.array(flown)


def test_a_planner_learns_from_the_rounds_of_its_match_and_forgets_with_the_next():
    diary = Diary()
    _, flown = rounds(make_duel(1, scenario=dataclasses.replace(SHORT, rounds_per_match=3), planner=diary), 4)
    assert [len(history) for history in diary.histories] == [0, 1, 2, 0, 1]
    assert diary.histories[2].shape == (2, 16, 4)
    # With two steps to a part, its middle is the end of its second step
    assert np.allclose(diary.histories[2][1, :, :3], flown[1, 1::2, 0])
    assert np.array_equal(diary.histories[2][0], diary.histories[1][0])


def test_rounds_left_early_are_no_part_of_a_history():
    diary = Diary()
    duel = make_duel(1, scenario=dataclasses.replace(SHORT, rounds_per_match=9), planner=diary)
    rest = np.zeros((1, 9), np.float32)
    duel.reset(seeds=0)
    duel.step(rest, rest)
    duel.reset(horizons=np.array([5]))
    for _ in range(5):
        duel.step(rest, rest)
    duel.reset()
    assert [len(history) for history in diary.histories] == [0, 0, 0]


def test_plans_are_the_games_own_chance_whatever_the_batch():
    together, flown = rounds(make_duel(4, scenario=SHORT, planner="random"), 3)
    again, _ = rounds(make_duel(4, scenario=SHORT, planner="random"), 3)
    assert np.array_equal(together, again)
    alone, _ = rounds(make_duel(1, scenario=SHORT, planner="random"), 3, seed=int(check_seeds(3, 4)[2]))
    assert np.array_equal(together[:, 2:3], alone)
    assert len({plan.tobytes() for plan in together.reshape(-1, 16, 3)}) == 12
    assert flown.min() >= 0


def test_a_bad_plan_says_whose_it_is_and_in_which_game_and_round():
    class Shortening(Diary):
        def plan(self, history, *args):
            plan = super().plan(history, *args)
            return dataclasses.replace(plan, waypoints=plan.waypoints[len(history) :])

    with pytest.raises(
        UserError, match=r"^planner diary: seed 3, match 0, round 1: waypoints: expected .*, got \(15, 3\)$"
    ):
        rounds(make_duel(1, scenario=SHORT, planner=Shortening()), 2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mask": np.array([True])}, r"a mask of shape \(2,\), got \(1,\)"),
        ({"horizons": np.array([5, 301])}, "horizons of 1 to 300 steps"),
        ({"horizons": np.array([0, 300])}, "horizons of 1 to 300 steps"),
        ({"seeds": [1]}, r"a whole number in \[0, 2\^63\) or 2 of them"),
    ],
    ids=str,
)
def test_a_reset_that_cannot_be_is_refused(options, message):
    with pytest.raises(UserError, match=message):
        make_duel(2).reset(**{"seeds": 0, **options})
