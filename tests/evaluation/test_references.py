import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.evaluation.panel import load_panel
from fpg_bench.evaluation.references import measure_panel

MINE = """\
side: ally
scenario: standard
rounds: 4
reference: expert
entries:
  - {opponent: adaptive, path: pursuit}
  - {opponent: sweep, path: circle}
"""


@pytest.fixture
def mine(tmp_path):
    path = tmp_path / "mine.yml"
    path.write_text(MINE)
    return path


def test_a_panel_of_ones_own_is_measured_and_played(mine, tmp_path):
    with pytest.raises(UserError, match=r"no reference scores; run fpg-bench measure-panel"):
        evaluate(["expert"], str(mine), tmp_path / "results")
    assert not (tmp_path / "results").exists()
    seen = []
    measure_panel(str(mine), 40, lambda entry, found: seen.append(entry.name))
    assert seen == ["adaptive/pursuit", "sweep/circle"]
    assert len(load_panel(str(mine)).references["sweep/circle"].random) == 40
    (expert,) = evaluate(["expert"], str(mine), tmp_path / "results")
    assert expert.score.value == pytest.approx(100, abs=0.01)


def test_more_rounds_than_measured_are_refused_before_playing(mine, tmp_path):
    measure_panel(str(mine), 30)
    with pytest.raises(UserError, match="at most 30"):
        evaluate(["expert"], str(mine), tmp_path / "results", rounds=31)
    assert not (tmp_path / "results").exists()
    with pytest.raises(UserError, match="at least the panel's own 4"):
        measure_panel(str(mine), 3)


def test_an_entry_that_tells_nobody_apart_is_refused(mine):
    mine.write_text(MINE.replace("reference: expert", "reference: random"))
    with pytest.raises(UserError, match="does not belong in a panel"):
        measure_panel(str(mine), 30)
    assert load_panel(str(mine)).references is None


def test_a_changed_panel_asks_to_be_measured_again(mine):
    measure_panel(str(mine), 30)
    mine.write_text(MINE.replace("circle", "triangle"))
    with pytest.raises(UserError, match="run fpg-bench measure-panel"):
        load_panel(str(mine))
    measure_panel(str(mine), 30)
    assert load_panel(str(mine)).references
