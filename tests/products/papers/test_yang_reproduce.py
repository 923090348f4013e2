"""The paper's experiments with a tiny budget: runs, figures, reports and resuming."""

import gzip
from dataclasses import replace

import numpy as np
import pytest

import fpg_bench.products.papers.yang_2026.study as studying
from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import PAPER
from fpg_bench.products.papers.reproduce import reproduce
from fpg_bench.products.papers.yang_2026.claims import compare
from fpg_bench.products.papers.yang_2026.conditions import (
    ALL,
    BASE,
    FIXED_PATHS,
    TARGETS,
    conditions_of,
    sensitivity,
)
from fpg_bench.products.papers.yang_2026.experiment import BUDGETS, Budget, Recorded
from fpg_bench.products.papers.yang_2026.report import write_report
from fpg_bench.products.papers.yang_2026.runs import FINAL, STAGES, WINDOWS, RunFile, windows_of
from fpg_bench.products.papers.yang_2026.study import DuelStudy
from tests.logged import logged

# Enough for a round in each of the forty windows, and for some updates.
TINY = Budget("tiny", 8_000, 8, 25, 2, 1)


@pytest.fixture(scope="module", autouse=True)
def tiny():
    """Adds the budget for this module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(studying, "BUDGETS", {**BUDGETS, "tiny": TINY})
        yield


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Reproduce Fig. 7; yields the folder, the written files and the messages."""
    out = tmp_path_factory.mktemp("reproduced")
    with logged() as messages:
        written = reproduce(DuelStudy("fig7"), out, budget="tiny")
    return out, written, messages


@pytest.mark.slow
def test_runs_become_rows_figures_and_a_report(made):
    out, written, _ = made
    drawn = ("fig4", "fig5", "fig7", "paths")
    figures = [f"{name}-paper.{form}" for name in drawn for form in ("svg", "pdf")]
    assert [path.name for path in written] == [*figures, "report-paper.md", "levels-paper.csv"]
    assert all(path.stat().st_size > 300 for path in written)
    text = (out / "report-paper.md").read_text()
    for link in (line.split("](")[1].rstrip(")") for line in text.splitlines() if line.startswith("![")):
        assert (out / link).is_file(), link
    assert "was **not run**" in text  # the language model
    assert text.index("could not be reproduced") < text.index("What holds")


@pytest.mark.slow
def test_swapped_paths_are_reported_but_not_counted_as_runs(monkeypatch, tmp_path):
    seen = []
    monkeypatch.setattr(studying, "write_report", lambda results, *_: seen.append(results) or [])
    monkeypatch.setattr(studying, "draw", lambda *_: {})
    budget = replace(TINY, steps=2_000)
    (short,) = [
        replace(each, changes={"rounds_per_match": 4}) for each in conditions_of("fig4", "paper", False)
    ]
    monkeypatch.setattr(DuelStudy, "conditions", lambda *_: [short])
    monkeypatch.setitem(studying.BUDGETS, "tiny", budget)
    reproduce(DuelStudy("fig4"), tmp_path, budget="tiny", n_seeds=2)
    frozen = [each for each in compare(seen[0]) if each.claim == "D1 frozen"]
    assert [each.statement.split()[4] for each in frozen] == [f"{path}," for path in FIXED_PATHS]
    report, *_ = write_report(seen[0], "paper", budget, [], tmp_path, "made so")
    assert "2 runs of the budget `tiny`" in report.read_text()


@pytest.mark.slow
def test_a_stored_run_has_a_description_and_rows(made):
    out, *_ = made
    run = RunFile(out, "paper", "tiny").read()[BASE, 0]
    assert run.about.scenario.startswith("paper, ")
    assert run.about.budget.startswith("tiny, 8000 steps, ")
    rows = run.rows
    assert [row["window"] for row in rows] == [*range(WINDOWS), FINAL]
    assert rows[-1]["rounds"] == 8 * 10
    for row in rows:
        shares = [row[f"share_{kind}"] for kind in ("tone", "narrowband", "broadband", "comb")]
        assert sum(shares) == pytest.approx(1, abs=1e-3)
        shown = row["window"] == FINAL or any(row["window"] in stage for stage in STAGES.values())
        assert len(row["ally_points"]) == (15 if shown else 0)
    for side in ("ally", "opponent"):
        assert not any(row[f"{side}_path"] for row in rows[:-1])
        positions = np.reshape(rows[-1][f"{side}_path"], (-1, 3))
        distances = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        assert len(positions) == 50  # of the round's hundred steps of a second, every other one
        assert 0 < distances.max() <= 2 * PAPER.opponent_speed_m_s + 2  # whole metres


@pytest.mark.slow
def test_finished_runs_are_not_repeated_and_those_of_another_scenario_not_continued(
    made, tmp_path, monkeypatch
):
    monkeypatch.setattr(studying, "draw", lambda *_: {})
    out, _, first = made
    assert sum(": done" in line for line in first) == 3
    with logged() as messages:
        reproduce(DuelStudy("fig5"), out, budget="tiny")
    assert messages == []
    other = RunFile(tmp_path, "standard", "tiny")
    other.add(RunFile(out, "paper", "tiny").read().values())
    with pytest.raises(UserError, match="planned, seed 0, played another game than standard is now"):
        reproduce(DuelStudy("fig4", "standard"), tmp_path, budget="tiny")


@pytest.mark.slow
def test_damaged_files_are_refused(made, tmp_path):
    out, *_ = made
    whole = RunFile(out, "paper", "tiny").path.read_bytes()
    lines = gzip.decompress(whole).splitlines()
    other = lines[0].replace(b'"rounds":[', b'"rounds":["many",', 1)
    short = lines[0].replace(b'"window":[0,', b'"window":[', 1)
    broken = RunFile(tmp_path, "paper", "tiny")
    for data in (
        whole[: len(whole) // 2],
        b"no gzip",
        *map(gzip.compress, (b"{}", b"no JSON", other, short)),
    ):
        broken.path.write_bytes(data)
        with pytest.raises(UserError, match=r"paper-tiny\.jsonl\.gz"):
            broken.read()


def test_the_ally_uses_the_knowledge_base():
    hops = np.zeros((4, 18), np.float32)
    hops[:, 0] = 1  # hop gate on; preference 0 means the middle point
    hops[:, 4] = -1  # knowledge gate off, as a policy might say
    points = {}
    for knowledge in ("expert", "none"):
        games = Recorded(4, scenario="paper", path="circle", knowledge=knowledge)
        games.reset(seeds=0)
        games.step(hops)
        points[knowledge] = set(games.duel.batch.games["point"].tolist())
    assert points["none"] == {7}
    assert points["expert"] != {7}
    assert hops[0, 4] == -1  # what the learner keeps is its own


def test_rounds_belong_to_the_window_in_which_they_end():
    games = Recorded(2, scenario="paper", path="circle")
    games.reset(seeds=0)
    still = np.zeros((2, 18), np.float32)
    for _ in range(300):
        games.step(still)
        if games.truncated.any():
            games.reset(games.truncated.copy())
    assert [played for played, *_ in games.rounds] == [200, 200, 400, 400, 600, 600]
    rows = windows_of(games.rounds, 8_000)
    assert [(row["window"], row["rounds"]) for row in rows] == [(0, 2), (1, 2), (2, 2)]


def test_all_targets_have_playable_conditions():
    for preset in ("paper", "standard"):
        every = {c.name for c in conditions_of(ALL, preset, full=True)}
        assert len(every) == len(conditions_of(ALL, preset, full=True))
        assert set().union(*TARGETS.values()) <= every
        for condition in conditions_of(ALL, preset, full=True):
            condition.scenario(preset)  # can be played
    hashes = [c.scenario("paper").hash for c in sensitivity("paper")]
    assert len(set(hashes)) == len(hashes)
    assert PAPER.hash not in hashes


@pytest.mark.parametrize("preset", ["paper", "standard"])
def test_stages_consist_of_whole_matches(preset):
    full = BUDGETS["full"]
    scenario = conditions_of("fig4", preset, full=True)[0].scenario(preset)
    match = full.games * scenario.steps_per_round * scenario.rounds_per_match
    for windows in STAGES.values():
        matches = len(windows) * full.steps / WINDOWS / match
        assert round(matches) >= 1
        assert matches == pytest.approx(round(matches), rel=0.05)
