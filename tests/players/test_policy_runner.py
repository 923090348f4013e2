"""The runner asks the player whose round it is, and starts its memory with the round."""

from __future__ import annotations

import copy
import pickle

import gymnasium
import numpy as np
import pytest

from fpg_bench import make_sb3
from fpg_bench.common.products import offered
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.game.choices import Choices
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player
from tests.envs.playing import tape

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


def write(*pairs):
    for array, value in pairs:
        if array.flags.writeable:
            array[...] = value


class Spoiling:
    """A player that answers by copies, and then writes into all that it was handed and can be written."""

    def __init__(self, player):
        self.player = player

    def reset(self, mask, seeds):
        if hasattr(self.player, "reset"):
            self.player.reset(mask.copy(), seeds.copy())
        write((mask, False), (seeds, 1))

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        answer = self.player.predict(observation.copy(), state, episode_start.copy(), deterministic)
        write((observation, 0.9), (episode_start, True))
        return answer


class SpoilingRows(Spoiling):
    """The same of one that is called for the games that it plays alone."""

    def predict_rows(self, rows, observation, state=None, episode_start=None, deterministic=True):
        own = rows.copy(), observation.copy(), state, episode_start.copy(), deterministic
        answer = self.player.predict_rows(*own)
        write((rows, 0), (observation, 0.9), (episode_start, True))
        return answer


class Shared(Listener):
    """A player without ``predict_rows``, so it is called for all games of a population."""

    def __init__(self, name, side="ally"):
        self.inner = as_player(name, side, STANDARD)
        self.reset = self.inner.reset

    def predict(self, *arguments):
        return self.inner.predict(*arguments)


def as_it_is(player):
    return player


def in_matches(spoil, spoil_rows):
    """Rounds as evaluations play them: with one ally, and with several, the writing ones first."""
    made = []
    several = [spoil(Shared("expert")), spoil_rows(expert()), Shared("random")]
    for allies in (several[:1], several):
        duel = TwoPlayerBatch(STANDARD, 8)
        match = make_match(duel, allies, [spoil(Shared("watchful", "opponent")), "adaptive", "oracle"])
        for number in range(2):
            play_round(match, seeds=None if number else range(8))
            made.append(duel.batch.tallies.tobytes())
    return made


def in_environments(spoil, spoil_rows):
    """Rivals of SB3's environment, of Gymnasium's and of teams."""
    rivals = [spoil(Shared("expert")), spoil_rows(expert()), "random"]
    made = []
    games = make_sb3("FPG/OpponentVsPolicy-v0", 8, seed=3, ally=rivals)
    made.append([games.reset(), *(games.step(action)[0] for action in tape(8, 40))])
    batch = gymnasium.make_vec("FPG/OpponentVsPolicy-v0", num_envs=8, ally=rivals, actions="discrete")
    made.append([batch.reset(seed=3)[0], *(batch.step(np.full(8, k % 5))[0] for k in range(40))])
    jammers = [spoil(Shared("watchful", "opponent")), "tone"]
    if "FPG/team_v0" in offered("game"):
        team = make_sb3("FPG/team_v0", 4, seed=3, side="ally", against=jammers)
        made.append([team.reset(), *(team.step(action)[0] for action in tape(12, 40))])
    return [np.array(each).tobytes() for each in made]


def in_data_sets(spoil, spoil_rows):
    """Rounds of a data set, whose discrete actions are encoded after the player has answered."""
    rounds = pytest.importorskip("fpg_bench.products.offline.rounds")
    specs = pytest.importorskip("fpg_bench.products.offline.spec")
    spec = specs.load_spec("ally-discrete-mixed-v0")
    players = {name: spoil(Shared(name)) for name in ("expert", "random")}
    with pytest.MonkeyPatch.context() as patched:
        known = rounds.as_player
        patched.setattr(rounds, "as_player", lambda name, *of: players.get(name) or known(name, *of))
        played = rounds.play_rounds(spec.model_copy(update={"players": tuple(players)}), range(6))
    return list(played.digests())


def expert():
    return as_player("expert", "ally", STANDARD)


@pytest.mark.parametrize("play", [in_matches, in_environments, in_data_sets])
def test_what_players_write_into_what_they_are_handed_changes_no_game(play):
    assert play(Spoiling, SpoilingRows) == play(as_it_is, as_it_is)


def test_what_a_batch_shows_cannot_be_written():
    duel, games = TwoPlayerBatch(STANDARD, 2), make_sb3("FPG/AllyVsScripted-v0", 2)
    wide = make_sb3("FPG/AllyVsScripted-v0", 2, observation="waterfall")
    buffers = [games.core.observations, games.core.truncated, wide.core.observations, wide.core.truncated]
    buffers += [make_sb3("FPG/duel_v0", 2).core.truncated]
    batches = [duel.batch, pickle.loads(pickle.dumps(duel)).batch, copy.deepcopy(duel).batch]
    if "FPG/team_v0" in offered("game"):
        batches.append(make_sb3("FPG/team_v0", 2, side="ally").core.teams.batch)
    for batch in batches:
        buffers += [batch.ally_observations, batch.opponent_observations, batch.received("ally")]
    for buffer in buffers:
        with pytest.raises(ValueError, match="read-only"):
            buffer[...] = 1


def test_choices_are_played_as_they_were_made():
    choices = Choices("ally", "discrete", STANDARD)
    seen, chosen = np.zeros((3, 15), np.float32), np.array([0, 5, 9])
    before = choices.decode(chosen, seen)
    for array in (choices.lists[0].rows, choices.lists[0].allowed, choices.preferences, choices.box_m):
        array[...] = 0
    assert np.array_equal(choices.decode(chosen, seen), before)


def test_a_model_that_writes_keeps_its_frames():
    """The frames that a model was shown are its player's memory."""

    class Model:
        observation_space = gymnasium.spaces.Box(-9, 9, (45,), np.float32)

        def __init__(self, writes):
            self.writes, self.seen = writes, []

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            self.seen.append(observation.copy())
            observation[...] = 0 if self.writes else observation
            return np.zeros((len(observation), 9), np.float32), state

    models = [Model(writes) for writes in (True, False)]
    for model in models:
        _, runner = begun(as_player(model, "ally", STANDARD))
        for _ in range(4):
            runner.act()
    assert np.array_equal(*(model.seen for model in models))
