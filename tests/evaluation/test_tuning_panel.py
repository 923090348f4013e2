import numpy as np
import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import load_panel
from fpg_bench.evaluation.runner import play_entry
from fpg_bench.evaluation.seeds import TUNING_START
from fpg_bench.evaluation.tuning_panel import TuningPanel, panel_of


@pytest.mark.parametrize(
    ("view_id", "options", "panel"),
    [
        ("FPG/AllyVsScripted-v0", {}, "ally-v1"),
        ("FPG/AllyVsPlanner-v0", {}, "ally-planner-v1"),
        ("FPG/OpponentVsScripted-v0", {}, "opponent-v1"),
        ("FPG/OpponentVsScripted-v0", {"path": "learned"}, "opponent-learned-v1"),
        ("FPG/OpponentVsPolicy-v0", {"path": None}, "opponent-v1"),
    ],
)
def test_every_view_has_its_panel(view_id, options, panel):
    assert panel_of(view_id, options) == panel
    assert load_panel(panel).side in view_id.lower()


@pytest.mark.parametrize("name", ["opponent-v1", "ally-planner-v1"])
def test_random_scores_0_and_the_reference_100(name):
    panel = TuningPanel(name, 10)
    assert panel.score("random") == pytest.approx(0, abs=1e-9)
    assert panel.score(panel.panel.reference) == pytest.approx(100)
    matches = 10 // panel.panel.scenario.rounds_per_match
    assert panel.scores("random").shape == (len(panel.panel.entries), matches)


def test_scores_are_of_tuning_seeds_and_repeat():
    panel = TuningPanel("opponent-v1", 4)
    asked = []

    def seeds(count):
        asked.append(count)
        return [TUNING_START + i for i in range(count)]

    entry = panel.panel.entries[0]
    (rows,) = play_entry("sweep", panel.panel, entry, 4, seeds)
    assert asked == [4]
    assert [row["seed"] for row in rows] == [TUNING_START + i for i in range(4)]
    assert np.array_equal(panel.scores("sweep"), TuningPanel("opponent-v1", 4).scores("sweep"))
    assert panel.score("sweep") == pytest.approx(np.sort(panel.scores("sweep").mean(axis=1))[1:-1].mean())


def test_unknown_panel():
    with pytest.raises(UserError, match="did you mean 'ally-v1'"):
        TuningPanel("aly-v1", 4)
