"""Learning allies: the same in any batch, and that they learn."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.checkers import check_player
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.registry import as_player
from fpg_bench.products.theory.learners import (
    EPSILON_GREEDY,
    LEARNERS,
    Q_LEARNING,
    SPREAD,
    STAY,
    THOMPSON,
    UCB,
    Learner,
)

NOTHING_SENSED = [0, 0, 0, 0, -1]


def observation(snr_db, frequency=0.0, sensed=NOTHING_SENSED, spreading_s=0.0):
    """An ally's observation ``(1, 15)``."""
    return np.array([[0] * 6 + [frequency, spreading_s / 60, snr_db / 80, 0, *sensed]], np.float32)


@pytest.mark.parametrize("name", LEARNERS)
def test_it_keeps_the_contract_of_players(name, capsys):
    check_player(name, "ally")  # one game or many, the same bits; draws from the round's own stream
    with pytest.raises(UserError, match="plays the ally"):
        as_player(name, "opponent", STANDARD)


@pytest.mark.parametrize("kind", [EPSILON_GREEDY, UCB, THOMPSON])
def test_a_bandit_stays_while_the_link_holds_and_leaves_what_failed(kind):
    player = Learner(LEARNERS[kind], STANDARD)
    actions, memory = player.predict(observation(80))
    for _ in range(5):
        actions, memory = player.predict(observation(30), memory)
        assert actions[0, 0] == -1
    assert memory[2][0, 7] == 5  # steps on the point in the middle of the band
    assert memory[1][0, 7] == pytest.approx(1)
    hops = 0
    for _ in range(40):
        actions, memory = player.predict(observation(-20), memory)
        hops += actions[0, 0] > 0
    assert hops > 20  # the mean of the point has fallen below what the others promise
    assert memory[1][0, 7] < 0


def test_a_new_round_begins_knowing_nothing():
    player = Learner("ucb", STANDARD)
    memory = player.predict(observation(80))[1]
    memory = player.predict(observation(-20), memory)[1]
    assert memory[2].any()
    memory = player.predict(observation(80), memory, np.array([True]))[1]
    assert not memory[2].any()


def test_q_learning_finds_the_choice_that_pays():
    """Spreading brings a link of 30 dB, everything else an outage: soon it does nothing but spread."""
    player = Learner(LEARNERS[Q_LEARNING], STANDARD)
    seen, memory, spreads = observation(0), None, []
    for _ in range(400):
        actions, memory = player.predict(seen, memory)
        spreads.append(actions[0, 1] > 0)
        seen = observation(30 if spreads[-1] else -20)
    assert np.mean(spreads[200:]) > 0.85  # it explores in a tenth of the steps
    values = memory[1][0, 0]
    assert values.argmax() == SPREAD != STAY
