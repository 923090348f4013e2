"""Matches between planners and scripted allies, for tests."""

import dataclasses

import numpy as np

from fpg_bench.envs.two_player import make_duel
from fpg_bench.game.scenario import STANDARD
from fpg_bench.planning import Limits, Request
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player

PLANNED = dataclasses.replace(STANDARD, rounds_per_match=10, opponent_path="waypoints")
LIMITS = Limits.of(PLANNED)


def play(planner, ally="expert", games=20, rounds=10, seed=2**40, scenario=PLANNED):
    """Play matches against `adaptive`; gives (rounds, games) mean rewards per step and the duel."""
    duel = make_duel(games, scenario=scenario, planner=planner)
    runners = [
        PolicyRunner(side, [as_player(name, side, scenario)], duel.batch)
        for side, name in (("ally", ally), ("opponent", "adaptive"))
    ]
    rewards = []
    for number in range(rounds):
        mask = duel.reset(seeds=None if number else seed)
        for runner in runners:
            runner.begin(mask)
        while not duel.batch.games["truncated"].all():
            duel.batch.step(runners[0].act(), runners[1].act())
        rewards.append(duel.batch.tallies["opponent_return"] / scenario.steps_per_round)
    return np.array(rewards), duel


def request(history, position=(100.0, 200.0, 300.0), **fields):
    """A request with some history."""
    return Request(np.asarray(history, float), np.array(position), LIMITS, np.random.default_rng(0), **fields)
