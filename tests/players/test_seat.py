"""A seat hears the player whose round it is, and starts its memory with the round."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.envs.duel import Duel
from fpg_bench.errors import UserError
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.seat import Seat

GAMES = 4


class Listener:
    """Keeps what it is told and answers with its own number."""

    def __init__(self, number=0.0, size=9):
        self.number, self.size = number, size
        self.starts, self.resets, self.states, self.seen = [], [], [], []

    def reset(self, mask, seeds):
        self.resets.append((mask.copy(), seeds.copy()))

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        self.starts.append(episode_start.copy())
        self.states.append(state)
        self.seen.append(observation.copy())
        return np.full((len(observation), self.size), self.number, np.float32), len(self.starts)


def seated(*players, side="ally"):
    duel = Duel(STANDARD, GAMES)
    seat = Seat(side, players, duel.arena)
    seat.begin(duel.reset(seeds=0))
    return duel, seat


def test_a_rounds_start_is_told_once_and_memory_is_handed_back():
    player = Listener()
    duel, seat = seated(player)
    seat.act()
    seat.act()
    some = np.array([True, False, False, True])
    seat.begin(duel.reset(some))
    seat.act()
    seat.act()
    assert np.array_equal(player.starts, [[True] * GAMES, [False] * GAMES, some, [False] * GAMES])
    assert player.states == [None, 1, 2, 3]


def test_seeds_are_new_for_every_round_and_each_sides_own():
    player, other = Listener(), Listener()
    duel, seat = seated(player)
    seat.begin(duel.reset(np.array([True, False, False, False])))
    (_, first), (mask, second) = player.resets
    assert mask.tolist() == [True, False, False, False]
    assert (first != second).tolist() == mask.tolist()
    seated(other, side="opponent")
    assert not set(other.resets[0][1]) & set(first)


def test_each_game_hears_the_player_drawn_for_its_round():
    _, seat = seated(Listener(0.25), Listener(0.5), Listener(0.75))
    actions = seat.act()
    assert np.array_equal(actions[:, 0], np.array([0.25, 0.5, 0.75], np.float32)[seat.choice])


def test_an_oracle_is_handed_the_full_state_and_others_their_observation():
    player, oracle = Listener(), Listener()
    oracle.sees = "state"
    duel, seat = seated(player, oracle, side="opponent")
    seat.act()
    assert np.array_equal(player.seen[0], duel.arena.opponent_observations)
    assert np.array_equal(oracle.seen[0], duel.state())


def test_an_answer_of_another_shape_is_refused():
    _, seat = seated(Listener(size=3))
    with pytest.raises(UserError, match=r"answered with actions of shape \(4, 3\), expected \(4, 9\)"):
        seat.act()
