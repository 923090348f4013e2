"""Scores on the way: the same games as an evaluation plays, on tuning seeds."""

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.policy_evaluator import PolicyEvaluator
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.evaluation.suite import Scale, load_suite
from fpg_bench.evaluation.summary import summarise
from fpg_bench.game.scenario import as_scenario
from fpg_bench.players.registry import as_player


class Following:
    """Acts by what it sees and by how long its round has lasted."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        count = len(observation)
        steps = np.zeros(count) if state is None else np.where(episode_start, 0, state)
        actions = np.tile(observation, 2)[:, 3:12] * np.cos(steps / 7)[:, None]
        return actions.astype(np.float32), steps + 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("who", "name"), [("following", "ally-v2"), ("random", "opponent-v2"), ("following", "ally-planner-v1")]
)
def test_scores_are_those_of_an_evaluation_on_the_same_seeds(name, who):
    """To the digit, for players that remember and for such that draw at random."""
    suite = load_suite(name)
    player = Following() if who == "following" else as_player("random", suite.side, suite.scenario)
    evaluator = PolicyEvaluator(suite, rounds=4)
    found = evaluator.score(player)
    assert evaluator.score(player) == found

    records = [play(player_entry(player), evaluator.suite, c, tuning_seeds) for c in suite.rivals]
    (summary,) = summarise(records, evaluator.suite)
    assert found["score"] == pytest.approx(summary.score.value, abs=1e-3)
    assert found["return"] == pytest.approx(summary.reward.value, abs=1e-4)
    each = {name: interval.value for name, interval in summary.by_rival.items()}
    assert found["rivals"] == pytest.approx(each, abs=1e-4)
    for measure, value in summary.measures.items():
        assert found["measures"][measure] == (
            None if value is None else pytest.approx(value, rel=1e-5, abs=1e-5)
        )

    scores = evaluator.scores(player)
    assert scores == pytest.approx(suite.scale.score(summary.rewards[0]), abs=1e-3)


def test_rounds_are_rounded_up_to_whole_matches():
    assert PolicyEvaluator("ally-v2", rounds=4).suite.matches == 4
    assert PolicyEvaluator("ally-planner-v1", rounds=11).suite.matches == 2  # of ten rounds


def test_the_runs_own_scenario_is_played_and_has_no_score_but_the_return():
    short = as_scenario(None, steps_per_round=50)
    ours, theirs = (PolicyEvaluator("ally-v2", 2, scenario) for scenario in (short, None))
    assert ours.suite.scale == Scale() != theirs.suite.scale
    found = ours.score(Following())
    assert found["return"] != theirs.score(Following())["return"]
    assert found["score"] == pytest.approx(found["return"], abs=1e-3)
    paths = [rival.scenario.opponent_path for rival in ours.suite.rivals]
    assert paths == [rival.scenario.opponent_path for rival in theirs.suite.rivals]


def test_the_suites_own_scenario_by_another_road_keeps_its_scale():
    suite = load_suite("ally-v2")
    flown = as_scenario(None, opponent_path=("pursuit", "circle"))
    assert PolicyEvaluator(suite, 1, flown).suite.scale == suite.scale


def test_a_suite_of_another_side_is_refused():
    with pytest.raises(UserError, match="measures the opponent, not the ally"):
        PolicyEvaluator("opponent-v2", side="ally")
    with pytest.raises(UserError, match="measures the planner, not the ally or opponent"):
        PolicyEvaluator("planner-v1")
