"""Planners that see the ally's path: chases, and a path improved step by step."""

from __future__ import annotations

import dataclasses

import numpy as np

from fpg_bench.envs.two_player import make_duel
from fpg_bench.game.batch import GameBatch
from fpg_bench.players.planner import plan_all
from fpg_bench.products.planning.pursuit import (
    LeadPursuit,
    Optimised,
    OptimisedFlown,
    Pursuit,
    chase,
    expected_return,
)
from tests.products.planning.playing import LIMITS, PLANNED, play, request

NO_HISTORY = np.zeros((0, 16, 4))
START = np.array([100.0, 200.0, 300.0])


def straight(speed=6.0):
    """An ally that flies along y at x = 700, 200 m above the ground."""
    seconds = np.arange(301.0)
    return np.column_stack([np.full(301, 700.0), 100 + speed * seconds, np.full(301, 200.0)])


def tracked(path, lead, start=START, speed=10.0):
    track = np.zeros_like(path)
    chase(path, start, speed, lead, track)
    return track


def test_with_a_lead_it_meets_the_ally_at_the_first_moment_at_which_it_can():
    path = straight()
    away = np.linalg.norm(path - START, axis=1)
    first = int(np.argmax(away <= 10.0 * np.arange(301)))
    distance = np.linalg.norm(tracked(path, True) - path, axis=1)
    assert 0 < first < 150
    assert distance[:first].min() > 1e-6
    assert distance[first:].max() < 1e-6


def test_planners_of_the_tier_ally_are_shown_what_an_ally_at_full_speed_flies():
    batch = GameBatch(dataclasses.replace(PLANNED, opponent_path="pursuit"), games=3)
    batch.reset(seeds=5)
    shown = batch.ally_path(2)
    before = batch.games.copy()
    full_speed = np.zeros((3, 9), np.float32)
    full_speed[:, 2] = 1.0
    flown = [batch.games["ally_position"][2].copy()]
    assert np.array_equal(before, batch.games)  # looking changes nothing
    for _ in range(300):
        batch.step(full_speed, full_speed)
        flown.append(batch.games["ally_position"][2].copy())
    assert np.array_equal(shown, np.array(flown))


def test_other_tiers_are_not_shown_it():
    class Curious:
        name, tier, seen = "curious", "history", []

        def plan_batch(self, requests):
            self.seen += [r.ally_path for r in requests]
            return Pursuit().plan_batch([request(NO_HISTORY, START, ally_path=straight())])

    play(planner := Curious(), games=1, rounds=2)
    assert planner.seen == [None, None]


class Slow:
    """An ally at half speed, seen by a planner that keeps what it is shown."""

    def __init__(self):
        self.planner, self.seen = OptimisedFlown(PLANNED), []
        self.name, self.tier = self.planner.name, "ally"

    def plan_batch(self, requests):
        self.seen += [r.ally_flown for r in requests]
        return self.planner.plan_batch(requests)


def test_what_the_ally_flew_is_shown_from_the_second_round_of_a_match_on():
    duel = make_duel(2, scenario=PLANNED, planner=(slow := Slow()))
    half_speed = np.zeros((2, 9), np.float32)
    half_speed[:, 2] = -1.0
    flown = {}
    for number in range(4):
        duel.reset(seeds=5 if number == 0 else None, new_match=number == 3)
        places = [duel.batch.games["ally_position"].copy()]
        for _ in range(300):
            duel.step(half_speed, half_speed)
            places.append(duel.batch.games["ally_position"].copy())
        flown[number] = np.array(places)
    for number, (first, second) in enumerate(zip(slow.seen[::2], slow.seen[1::2], strict=True)):
        if number in (0, 3):
            assert first is None
            assert second is None
        else:
            assert np.array_equal(first, flown[number - 1][:, 0])
            assert np.array_equal(second, flown[number - 1][:, 1])


def test_a_slow_ally_is_met_by_whoever_knows_what_it_flew():
    earned = {}
    for planner in (Optimised(PLANNED), OptimisedFlown(PLANNED)):
        duel = make_duel(4, scenario=PLANNED, planner=planner)
        actions = np.zeros((4, 9), np.float32)
        actions[:, 2] = -1.0
        for number in range(2):
            duel.reset(seeds=5 if number == 0 else None)
            near = np.zeros(4)
            for _ in range(300):
                duel.step(actions, np.zeros((4, 9), np.float32))
                near += duel.batch.games["distance_m"] < 30
        earned[planner.name] = near.mean() / 300
    assert earned["optimised-flown"] > 0.5
    assert earned["optimised"] < 0.2


def test_an_improved_path_is_worth_more_and_stays_in_the_box():
    rng = np.random.default_rng(1)
    planner, gains = Optimised(PLANNED), []
    for _ in range(4):
        corners = rng.uniform(0, LIMITS.box_m, (4, 3))
        path = np.column_stack([np.interp(np.arange(301), [0, 100, 200, 300], x) for x in corners.T])
        asked = [request(NO_HISTORY, rng.uniform(0, LIMITS.box_m), ally_path=path)]
        worth = [
            expected_return(
                plan_all(p, asked)[0].waypoints,
                path,
                asked[0].current_position,
                10.0,
                planner._rules,
                np.empty(3),
            )
            for p in (LeadPursuit(), planner)
        ]
        waypoints = planner.plan_batch(asked)[0].waypoints
        assert ((waypoints >= 0) & (waypoints <= LIMITS.box_m)).all()
        gains.append(worth[1] - worth[0])
    assert min(gains) > 0
