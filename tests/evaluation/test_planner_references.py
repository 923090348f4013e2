"""A panel of planners in the form of any panel, with the returns that normalise it."""

import json
import subprocess
import sys

import numpy as np
import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation.compare import compare
from fpg_bench.evaluation.planner_references import load_planner_table, measure_planner_panel

PANEL = """
side: planner
scenario: standard
rounds_per_match: 2
matches: 3
opponent: adaptive
allies: [idle, expert]
last_rounds: 1
zero: random
bound: pursuit
"""


@pytest.fixture(scope="module")
def panel(tmp_path_factory):
    file = tmp_path_factory.mktemp("panel") / "mine.yml"
    file.write_text(PANEL)
    measure_planner_panel(str(file))
    return file


def test_kept_returns_make_the_scores_of_a_comparison(panel):
    bound = compare(["hold"], str(panel), panel.parent / "out")[0]
    table = load_planner_table(str(panel))
    returns = table.by_match([table.references[name] for name in ("idle", "expert")], "reference")
    found = table.scale().score(returns, slice(1, None))
    assert bound.planner == "pursuit"
    assert [found.value, found.low, found.high] == pytest.approx(
        [bound.last.value, bound.last.low, bound.last.high], abs=0.01
    )


def test_of_fewer_matches_the_first_count(panel):
    whole, fewer = load_planner_table(str(panel)), load_planner_table(str(panel), 2)
    assert (fewer.rounds, len(fewer.references["idle"].random)) == (4, 4)
    assert fewer.references["idle"].random == whole.references["idle"].random[:4]
    assert fewer.hash != whole.hash == whole.planners.hash


def test_scores_by_match_and_by_ally_agree(panel):
    table = load_planner_table(str(panel))
    returns = np.random.default_rng(0).normal(100, 10, (2, 3, 2))
    scale, rounds = table.scale(), slice(0, 2)
    by_ally = scale.by_ally(returns, rounds)
    assert scale.by_match(returns, rounds).mean(axis=1) == pytest.approx(by_ally)
    assert [score.value for score in scale.ally_scores(returns, rounds)] == pytest.approx(by_ally)
    assert scale.score(returns, rounds).value == pytest.approx(by_ally.mean())


def test_returns_of_another_panel_are_refused(panel, tmp_path):
    (tmp_path / "mine.yml").write_text(PANEL.replace("matches: 3", "matches: 2"))
    kept = json.loads(panel.with_suffix(".scores.json").read_text())
    (tmp_path / "mine.scores.json").write_text(json.dumps(kept))
    with pytest.raises(UserError, match="measured for another panel"):
        load_planner_table(str(tmp_path / "mine.yml"))
    with pytest.raises(UserError, match="from 1 to 3"):
        load_planner_table(str(panel), 4)


def test_the_package_s_own_panel_is_measured():
    table = load_planner_table()
    assert (table.rounds, len(table.entries)) == (1000, 5)
    assert table.scale()


def test_the_command_measures_such_a_panel_and_takes_no_rounds(panel, tmp_path):
    (tmp_path / "mine.yml").write_text(PANEL.replace("matches: 3", "matches: 1"))
    command = [sys.executable, "-m", "fpg_bench.cli", "measure-panel", "mine.yml"]
    found = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert found.returncode == 0, found.stderr
    assert (tmp_path / "mine.scores.json").is_file()
    found = subprocess.run([*command, "--rounds", "3"], cwd=tmp_path, capture_output=True, text=True)
    assert found.returncode == 2
    assert "says itself how many matches" in found.stderr
