"""Scores on the way: the same games as an evaluation plays, on tuning seeds."""

import dataclasses

import numpy as np
import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.field import Scale, load_field
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.evaluation.summary import summarise
from fpg_bench.evaluation.yardstick import Yardstick
from fpg_bench.game.scenario import as_scenario
from fpg_bench.players.naming import as_player


class Following:
    """Acts by what it sees and by how long its round has lasted."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        count = len(observation)
        steps = np.zeros(count) if state is None else np.where(episode_start, 0, state)
        actions = np.tile(observation, 2)[:, 3:12] * np.cos(steps / 7)[:, None]
        return actions.astype(np.float32), steps + 1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ally-v1", "opponent-v1", "ally-planner-v1"])
@pytest.mark.parametrize("who", ["following", "random"])
def test_scores_are_those_of_an_evaluation_on_the_same_seeds(name, who):
    """To the digit, for players that remember and for such that draw at random."""
    field = load_field(name)
    player = Following() if who == "following" else as_player("random", field.side, field.scenario)
    yardstick = Yardstick(field, rounds=4)
    found = yardstick.score(player)
    assert yardstick.score(player) == found

    lines = [play(player_entry(player), yardstick.field, c, tuning_seeds) for c in field.counterparts]
    (summary,) = summarise(lines, yardstick.field)
    assert found["score"] == pytest.approx(summary.score.value, abs=1e-3)
    assert found["return"] == pytest.approx(summary.reward.value, abs=1e-4)
    each = {name: interval.value for name, interval in summary.by_counterpart.items()}
    assert found["counterparts"] == pytest.approx(each, abs=1e-4)
    for measure, value in summary.measures.items():
        assert found["measures"][measure] == (
            None if value is None else pytest.approx(value, rel=1e-5, abs=1e-5)
        )

    scores = yardstick.scores(player)
    assert scores == pytest.approx(field.scale.score(summary.rewards[0]), abs=1e-3)


def test_rounds_are_rounded_up_to_whole_matches():
    assert Yardstick("ally-v1", rounds=4).field.matches == 4
    assert Yardstick("ally-planner-v1", rounds=11).field.matches == 2  # of ten rounds


def test_the_runs_own_scenario_is_played_and_has_no_score_but_the_return():
    short = as_scenario(None, steps_per_round=50)
    ours, theirs = (Yardstick("ally-v1", 2, scenario) for scenario in (short, None))
    assert ours.field.scale == Scale() != theirs.field.scale
    found = ours.score(Following())
    assert found["return"] != theirs.score(Following())["return"]
    assert found["score"] == pytest.approx(found["return"], abs=1e-3)
    paths = [counterpart.scenario.opponent_path for counterpart in ours.field.counterparts]
    assert paths == [counterpart.scenario.opponent_path for counterpart in theirs.field.counterparts]


def test_the_fields_own_scenario_by_another_road_keeps_its_scale():
    field = load_field("ally-v1")
    flown = as_scenario(None, opponent_path=("pursuit", "circle"))
    assert Yardstick(field, 1, flown).field.scale == field.scale


@pytest.mark.parametrize(
    ("name", "side", "message"),
    [
        ("opponent-v1", "ally", "measures the opponent, not the ally"),
        ("planner-v1", None, "measures the planner, not the ally or opponent"),
    ],
)
def test_a_field_of_another_side_is_refused(name, side, message):
    with pytest.raises(UserError, match=message):
        Yardstick(name, side=side)


def test_only_the_rounds_that_count_make_the_score():
    field = dataclasses.replace(load_field("ally-planner-v1"), last_rounds=3)
    found = Yardstick(field, rounds=10).scores(Following())
    line = play(
        player_entry(Following()), dataclasses.replace(field, matches=1), field.counterparts[0], tuning_seeds
    )
    last = np.mean(line.returns[-3:]) / 300
    assert found[0, 0] == pytest.approx(field.scale.score(last), abs=1e-3)
