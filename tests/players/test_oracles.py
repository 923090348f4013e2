"""The oracles' actions, given the full state."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.game.full_state import ALLY, FULL_STATE_SIZE, OPPONENT
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.scripted import OracleAlly, OracleOpponent

from .playing import opponent_sees

HOP, SPREAD, SPEED, PREFERENCE, KNOWLEDGE = range(5)


def state(frequency=0.0, known=0.5, check_in_s=4, away_m=(0.0, 0.0, 0.0)):
    seen = np.zeros((1, FULL_STATE_SIZE), np.float32)
    seen[0, OPPONENT : OPPONENT + 15] = opponent_sees(away_m)
    seen[0, ALLY + 6], seen[0, OPPONENT + 6], seen[0, OPPONENT + 8] = frequency, known, check_in_s / 6
    return seen


@pytest.mark.parametrize(("check_in_s", "spreads"), [(1, True), (2, False), (6, False)])
def test_the_ally_spreads_in_just_the_second_of_a_check(check_in_s, spreads):
    action = OracleAlly(STANDARD).predict(state(check_in_s=check_in_s))[0][0]
    assert bool(action[SPREAD] > 0) == spreads
    assert action[SPEED] == 1


@pytest.mark.parametrize(("known", "hops", "to"), [(0.5, True, -1), (-0.5, True, 1), (0.4, False, -1)])
def test_the_ally_leaves_a_known_frequency_for_the_far_end_of_the_band(known, hops, to):
    action = OracleAlly(STANDARD).predict(state(frequency=0.5 if known > 0 else -0.5, known=known))[0][0]
    assert bool(action[HOP] > 0) == hops
    assert action[PREFERENCE] == to
    assert action[KNOWLEDGE] < 0


def test_the_opponent_puts_a_tone_on_the_true_frequency_and_flies_at_the_ally():
    action = OracleOpponent(STANDARD).predict(state(frequency=0.3, known=-0.7, away_m=(-300, 0, 400)))[0][0]
    assert action[:4].argmax() == 0
    assert action[4] == pytest.approx(0.3)
    assert action[5] > 0
    assert action[6:] == pytest.approx([-0.6, 0, 0.8], abs=1e-5)
