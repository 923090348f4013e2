"""Matches between planners and scripted allies, for tests."""

import dataclasses

import numpy as np

from fpg_bench.envs.two_player import make_duel
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.planner import Limits, Request

PLANNED = dataclasses.replace(STANDARD, rounds_per_match=10, opponent_path="waypoints")
LIMITS = Limits.of(PLANNED)
SMALL = dataclasses.replace(STANDARD, waypoints=4, steps_per_round=40, box_m=(1200, 1200, 600))


def play(planner, ally="expert", games=20, rounds=10, seed=2**40, scenario=PLANNED):
    """Play matches against `adaptive`; gives (rounds, games) mean rewards per step and the duel."""
    duel = make_duel(games, scenario=scenario, planner=planner)
    match = make_match(duel, ally, "adaptive")
    rewards = []
    for number in range(rounds):
        play_round(match, seeds=None if number else seed)
        rewards.append(duel.batch.tallies["opponent_return"] / scenario.steps_per_round)
    return np.array(rewards), duel


def request(history, position=(100.0, 200.0, 300.0), **fields):
    """A request with some history."""
    return Request(np.asarray(history, float), np.array(position), LIMITS, np.random.default_rng(0), **fields)
