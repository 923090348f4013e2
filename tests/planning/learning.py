"""What both planners that learn from rounds must do; their tests ask for it by these functions."""

import dataclasses

import numpy as np

from fpg_bench.envs.duel import make_duel
from fpg_bench.game.scenario import STANDARD
from fpg_bench.planning import Limits
from fpg_bench.players.scripted import Scripted
from fpg_bench.players.seat import Seat

LIMITS = Limits.of(STANDARD)
BOX = np.array(LIMITS.box_m)
START = np.array([300.0, 900.0, 200.0])


def flown_in_theory(planner, ally, rounds, limits=LIMITS, seed=0):
    """Play rounds where only distance counts: the history ``(rounds, n, 4)`` that comes of it."""
    history = np.zeros((0, limits.waypoints, 4))
    for _ in range(rounds):
        waypoints = planner.plan(
            history, START, limits, np.random.default_rng((seed, len(history)))
        ).waypoints
        middles = (np.vstack([START, waypoints[:-1]]) + waypoints) / 2
        rewards = 100 / np.sqrt(50 + np.linalg.norm(middles - ally, axis=1))
        history = np.concatenate([history, np.column_stack([middles, rewards])[None]])
    return history


def ally_path(seed):
    """Where an ally on a straight line is in the middle of each part, half as fast as the opponent."""
    a, b = np.random.default_rng(seed).uniform(0.2 * BOX, 0.8 * BOX, (2, 3))
    direction = (b - a) / np.linalg.norm(b - a)
    return np.clip(a + direction * 90 * np.arange(16)[:, None], 0, BOX)


def rewards_by_round(planner, ally, matches=16, seed=2**40 + 40_000):
    """The opponent's mean reward per step in the real game, ``(matches, 10)``."""
    scenario = dataclasses.replace(STANDARD, rounds_per_match=10)
    duel = make_duel(matches, scenario=scenario, planner=planner)
    seats = [
        Seat(side, [Scripted(side, name, duel.scenario)], duel.arena)
        for side, name in (("ally", ally), ("opponent", "adaptive"))
    ]
    rewards = []
    for number in range(10):
        mask = duel.reset(seeds=seed if number == 0 else None)
        for seat in seats:
            seat.begin(mask)
        while not duel.arena.games["truncated"].all():
            duel.arena.step(*(seat.act() for seat in seats))
        rewards.append(duel.arena.segments[..., 3].mean(axis=1))
    return np.array(rewards).T
