"""Scores on the way: the same games as the match runner plays, on tuning seeds."""

import dataclasses

import numpy as np
import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import load_panel
from fpg_bench.evaluation.runner import play_entry
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.evaluation.statistics import iqm
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


@pytest.mark.parametrize("name", ["ally-v1", "opponent-v1", "ally-planner-v1"])
def test_scores_are_those_of_the_match_runner_on_tuning_seeds(name):
    panel = load_panel(name, references=False)
    yardstick = Yardstick(panel, rounds=4)
    found = yardstick.score(Following())
    assert yardstick.score(Following()) == found

    entry, key = panel.entries[1], f"{panel.side}_return"
    means = [
        np.mean([row[key] for rows in play_entry(spec, panel, entry, 4, tuning_seeds) for row in rows])
        for spec in ("random", panel.reference, Following())
    ]
    score = 100 * (means[2] - means[0]) / (means[1] - means[0])
    assert found["entries"][entry.name] == pytest.approx(score, abs=2e-3)

    scores = yardstick.scores(Following())
    assert scores.shape == (len(panel.entries), -(-4 // panel.scenario.rounds_per_match))
    assert scores.mean(axis=1) == pytest.approx(list(found["entries"].values()), abs=1e-3)
    assert iqm(scores.mean(axis=1)) == pytest.approx(found["score"], abs=1e-3)


def test_the_reference_is_worth_100_and_its_measures_are_pooled():
    panel = load_panel("ally-v1", references=False)
    yardstick = Yardstick(panel, rounds=3)
    found = yardstick.score(as_player("expert", "ally", panel.scenario))
    assert set(found) == {"score", "return", "entries", "measures"}
    assert found["entries"].keys() == {entry.name for entry in panel.entries}
    assert found["measures"]["jamming_success_rate"] <= 1
    assert 90 < found["score"] < 110  # it draws other numbers than in its seat


def test_the_runs_own_scenario_is_played():
    short = as_scenario(None, steps_per_round=50)
    ours, theirs = (Yardstick("ally-v1", 2, scenario).score(Following()) for scenario in (short, None))
    assert ours["return"] != theirs["return"]


def test_a_game_that_tells_nobody_apart_has_no_score():
    panel = dataclasses.replace(load_panel("ally-v1", references=False), reference="random")
    found = Yardstick(panel, 1).score(Following())
    assert found["score"] is None
    assert set(found["entries"].values()) == {None}


def test_a_panel_of_the_other_side_is_refused():
    with pytest.raises(UserError, match="measures the opponent, not the ally"):
        Yardstick("opponent-v1", side="ally")
