import dataclasses

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import match_of, play, rounds
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.evaluation.suite import Scale, load_suite
from fpg_bench.players.scripted import Scripted


@pytest.fixture(scope="module")
def suite():
    whole = load_suite("ally-v2")
    return dataclasses.replace(whole, matches=6, rivals=whole.rivals[5:8])


# A side against players


def test_a_line_says_who_met_whom_and_what_came_of_it(suite):
    record = play(player_entry("expert"), suite, suite.rivals[0])
    told = (record.suite, record.suite_hash, record.entry, record.fingerprint, record.rival)
    assert told == ("ally-v2", suite.hash[:16], "expert", "expert", suite.rivals[0].name)
    assert len(record.returns) == suite.rounds == 6
    assert record.tally["steps"] == 6 * 300 == sum(record.ally_points) == sum(record.jam_points)
    assert sum(record.returns) == pytest.approx(record.tally["ally_return"], abs=0.01)
    assert (record.training_seed, record.lost, record.plans) == (None, 0, None)


def test_everybody_meets_the_same_chance(suite):
    seen = []
    for rival in suite.rivals:
        (duel,) = rounds(match_of("expert", suite, rival), suite)
        seen.append(duel.batch.games["seed"].tolist())
    assert seen == [evaluation_seeds(6)] * 3


def test_the_number_of_matches_does_not_matter(suite):
    rival, entry = suite.rivals[0], player_entry("random")
    few = play(entry, dataclasses.replace(suite, matches=3), rival)
    assert few.returns == play(entry, suite, rival).returns[:3]


def test_the_hash_is_of_the_rounds_and_not_of_the_name(suite):
    rival = suite.rivals[0]
    one, other = (play(player_entry("idle", name=name), suite, rival) for name in ("a", "b"))
    assert one.rounds_sha256 == other.rounds_sha256
    assert play(player_entry("reactive"), suite, rival).rounds_sha256 != one.rounds_sha256


def test_an_opponents_suite_counts_the_opponents_returns():
    suite = dataclasses.replace(load_suite("opponent-learned-v2"), matches=2)
    best, last = (play(player_entry(name), suite, suite.rivals[1]) for name in ("adaptive", "random"))
    assert sum(best.returns) == pytest.approx(best.tally["opponent_return"], abs=0.01)
    assert best.tally["near"] > last.tally["near"]


class Losing(Scripted):
    """Gives no action in every second game's rounds, as far as the one who watches it says."""

    invalid = np.array([False, True] * 3)


def test_a_lost_round_scores_minus_100_and_no_more_than_the_worst_that_was_played(suite):
    scenario, rival = suite.rivals[0].scenario, suite.rivals[0]
    strict = dataclasses.replace(suite, scale=Scale(20.0, 22.0))  # on which hopping scores below -100
    for each, name in ((suite, "expert"), (strict, "always-hop")):
        record = play(player_entry(Losing("ally", name, scenario), name="losing"), each, rival)
        sound = play(player_entry(name), each, rival)
        scores = each.scale.score(each.rewards(record.returns))
        assert record.lost == 3
        assert record.returns[::2] == sound.returns[::2]
        assert scores[1::2] == pytest.approx([min(-100, scores[::2].min())] * 3)
        assert record.tally == sound.tally  # what was played is told as it was
    assert scores[::2].min() < -100


class Faulty:
    """Stands still, but its twentieth action of a round is not finite in some games."""

    def __init__(self, *games):
        self.games, self.calls = games, 0

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        actions = np.zeros((len(observation), 9), np.float32)
        self.calls += 1
        if self.calls == 20:
            for game, value in zip(self.games, (np.nan, np.inf, -np.inf) * 2, strict=False):
                actions[game, 3] = value
        return actions, None


def test_an_action_that_is_not_finite_loses_the_round_of_its_game_alone(suite, caplog):
    sound = play(player_entry(Faulty(), name="sound"), suite, suite.rivals[0])
    record = play(player_entry(Faulty(1, 4), name="faulty"), suite, suite.rivals[0])
    scores = suite.scale.score(suite.rewards(record.returns))
    assert (sound.lost, record.lost) == (0, 2)
    assert scores[[1, 4]] == pytest.approx([min(-100, np.delete(scores, [1, 4]).min())] * 2)
    assert np.delete(record.returns, [1, 4]).tolist() == np.delete(sound.returns, [1, 4]).tolist()
    assert f"faulty against {suite.rivals[0].name}: 2 of 6 rounds are lost" in caplog.text
    with pytest.raises(UserError, match="all 6 rounds are lost: its actions are not finite"):
        play(player_entry(Faulty(*range(6)), name="broken"), suite, suite.rivals[0])


def test_a_round_of_a_team_is_lost_by_an_action_of_any_seat_that_is_not_finite():
    whole = load_suite("team-ally-link-v1")
    suite = dataclasses.replace(whole, matches=3, rivals=whole.rivals[:1])
    assert play(player_entry(Faulty(0, 1), name="faulty"), suite, suite.rivals[0]).lost == 1
