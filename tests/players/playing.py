"""Helpers of the players' tests: observations by name, and tallies of two scripts."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.game.scenario import STANDARD, Scenario
from fpg_bench.players.player import SIDES
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player


def ally_sees(snr_db: float = 60.0, covered: bool = False, spreading_s: float = 0.0) -> np.ndarray:
    """An ally's observation ``(1, 15)``; what is not named is zero."""
    seen = np.zeros((1, 15), np.float32)
    seen[0, 7], seen[0, 8], seen[0, 14] = spreading_s / 60, snr_db / 80, 1 if covered else -1
    return seen


def opponent_sees(away_m: Any = (300.0, 0.0, 0.0), age_s: float = 10.0) -> np.ndarray:
    """An opponent's observation ``(1, 15)`` with the ally that far away."""
    seen, away = np.zeros((1, 15), np.float32), np.asarray(away_m)
    seen[0, 3:6] = np.sign(away) * np.sqrt(np.abs(away) / np.array(STANDARD.box_m))
    seen[0, 7] = age_s / 60
    return seen


@functools.cache
def tallies(ally: str, opponent: str, scenario: Scenario = STANDARD, games: int = 512) -> np.ndarray:
    """The tallies of one round of each of ``games`` games."""
    duel = TwoPlayerBatch(scenario, games)
    names = {"ally": ally, "opponent": opponent}
    runners = [PolicyRunner(side, [as_player(names[side], side, scenario)], duel.batch) for side in SIDES]
    mask = duel.reset(seeds=range(games))
    for runner in runners:
        runner.begin(mask)
    for _ in range(scenario.steps_per_round):
        duel.batch.step(runners[0].act(), runners[1].act())
    return duel.batch.tallies.copy()


def mean(name: str, ally: str, opponent: str, scenario: Scenario = STANDARD) -> float:
    """A tally's mean per step of a pairing."""
    found = tallies(ally, opponent, scenario)
    return float(found[name].sum() / found["steps"].sum())
