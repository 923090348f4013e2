"""The runner asks the player whose round it is, and starts its memory with the round."""

from __future__ import annotations

import numpy as np

from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.policy_runner import PolicyRunner

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


def begun(*players, side="ally"):
    duel = TwoPlayerBatch(STANDARD, GAMES)
    runner = PolicyRunner(side, players, duel.batch)
    runner.begin(duel.reset(seeds=0))
    return duel, runner


def test_a_rounds_start_is_told_once_and_memory_is_handed_back():
    player = Listener()
    duel, runner = begun(player)
    runner.act()
    runner.act()
    some = np.array([True, False, False, True])
    runner.begin(duel.reset(some))
    runner.act()
    runner.act()
    assert np.array_equal(player.starts, [[True] * GAMES, [False] * GAMES, some, [False] * GAMES])
    assert player.states == [None, 1, 2, 3]


def test_seeds_are_new_for_every_round_and_each_sides_own():
    player, other = Listener(), Listener()
    duel, runner = begun(player)
    runner.begin(duel.reset(np.array([True, False, False, False])))
    (_, first), (mask, second) = player.resets
    assert mask.tolist() == [True, False, False, False]
    assert (first != second).tolist() == mask.tolist()
    begun(other, side="opponent")
    assert not set(other.resets[0][1]) & set(first)


def test_each_game_hears_the_player_drawn_for_its_round():
    _, runner = begun(Listener(0.25), Listener(0.5), Listener(0.75))
    actions = runner.act()
    assert np.array_equal(actions[:, 0], np.array([0.25, 0.5, 0.75], np.float32)[runner.choice])


def test_an_oracle_is_handed_the_full_state_and_others_their_observation():
    player, oracle = Listener(), Listener()
    oracle.sees = "state"
    duel, runner = begun(player, oracle, side="opponent")
    runner.act()
    assert np.array_equal(player.seen[0], duel.batch.opponent_observations)
    assert np.array_equal(oracle.seen[0], duel.state())
