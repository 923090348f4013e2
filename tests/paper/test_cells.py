"""The readings that decide: which they are, what is trained under them, and what their page says."""

import dataclasses

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import PAPER, preset
from fpg_bench.paper import cells as choosing
from fpg_bench.paper import cells_report
from fpg_bench.paper.cells import CELLS, FIGURES, LOW_NOISE, NEEDED, Cell, every_condition, neighbours
from fpg_bench.paper.claims import ASPECTS
from fpg_bench.paper.conditions import BASE, Condition, conditions_of
from fpg_bench.paper.curve import spots
from fpg_bench.paper.experiment import Budget, hyperparameters
from fpg_bench.paper.readings import POINTS, Reading, as_reading
from fpg_bench.paper.reproduce import reproduce
from fpg_bench.paper.runs import Results, RunFile
from fpg_bench.paper.screen_report import read_screen
from tests.paper.made_up import SEEDS, results
from tests.programs import ROOT

TINY = Budget("tiny", 2_000, 8, 25, 2, 1)


def verdicts(rows, reading):
    """What the screen says of each claim: whether it holds, and whether a part is the opposite."""
    row = [row for row in rows if row["reading"] == reading.name]
    found = {name: spots(row, name) for name in ASPECTS}
    return {name: (spot.holds, spot.against > 0) for name, (spot,) in found.items()}


def test_the_preset_is_the_reading_that_the_others_are_compared_with():
    assert FIGURES.scenario() == preset("figures")
    assert preset("figures") != PAPER


def test_a_neighbour_settles_one_point_otherwise():
    found = list(neighbours(FIGURES))
    assert len(found) == sum(len(known) - 1 for known in POINTS.values())
    for reading in found:
        assert sum(one != other for one, other in zip(reading.settings, FIGURES.settings, strict=True)) == 1


def test_trained_are_the_letter_and_the_neighbours_under_which_a_claim_turns_between_scripts():
    rows = read_screen(ROOT / "results/reproduction")
    asked = {cell.reading: set(cell.claims) for cell in CELLS if cell.noise_sd is None}
    assert asked.pop(as_reading("letter")) == set(NEEDED) == set(ASPECTS)
    here = verdicts(rows, FIGURES)
    for reading in neighbours(FIGURES):
        there = verdicts(rows, reading)
        turned = {name for name in ASPECTS if here[name] != there[name]}
        if reading.of("hop-cost") == "100":  # paid in each step, whoever plays
            assert turned == {"D3 level"}
        else:
            assert turned == asked.pop(reading, set())
    assert not asked


def test_what_is_trained_plays_the_reading_under_names_of_its_own():
    every = every_condition()
    assert len({condition.name for condition in every}) == len(every)
    for cell in CELLS:
        for condition in cell.conditions:
            name = condition.name.removeprefix(f"{cell.name}: ")
            (known,) = [each for each in conditions_of("all", "paper", full=False) if each.name == name]
            expected = dataclasses.replace(cell.reading.scenario(), **known.changes)
            assert condition.scenario("paper") == expected
            assert (condition.options, condition.tested) == (known.options, True)


def test_a_cell_of_low_noise_trains_with_it_and_nothing_else_that_is_new():
    usual = hyperparameters(TINY)
    for cell in CELLS:
        for condition in cell.conditions:
            words = hyperparameters(TINY, **condition.algorithm)
            noise = {} if cell.noise_sd is None else {"noise_sd": LOW_NOISE}
            assert words == dataclasses.replace(usual, algorithm=usual.algorithm | noise)


def test_a_claim_is_judged_where_all_its_runs_are_there():
    runs = results()
    every = {"D1 frozen", *ASPECTS}
    assert set(cells_report.judged(runs, SEEDS)) == every
    few = {name: seeds if name != "comb" else {0: seeds[0]} for name, seeds in runs.runs.items()}
    assert set(cells_report.judged(Results(few, {}), SEEDS)) == every - {"D3 level", "D3 order"}


@pytest.mark.slow
def test_trained_readings_come_to_a_page_and_are_not_trained_again(monkeypatch, tmp_path):
    two = (Cell(as_reading("letter"), ("D2",)), Cell(FIGURES, ("D2",), LOW_NOISE))
    for module in (choosing, cells_report):
        monkeypatch.setattr(module, "CELLS", two)
    monkeypatch.setattr(Reading, "rounds", 4)  # in place of up to forty
    base = Condition(BASE, "planned", tested=True, changes={"rounds_per_match": 4})
    monkeypatch.setattr("fpg_bench.paper.reproduce.conditions_of", lambda *_, **__: [base])
    monkeypatch.setattr("fpg_bench.paper.reproduce.draw", lambda *_: {})  # of Fig. 4
    words = {"budget": TINY, "seeds": 2, "first_seed": 5, "workers": 1}
    reproduce("fig4", tmp_path, scenario="figures", **words, say=lambda line: None)
    written = reproduce("cells", tmp_path, **words, say=lambda line: None)
    assert [path.name for path in written] == ["cells.png", "cells.svg", "cells.md"]
    page = (tmp_path / "cells.md").read_text()
    assert "Training seeds are 5 to 6" in page
    assert "fpg-bench reproduce cells --budget tiny --seeds 2 --first-seed 5" in page
    lines = [line.split(" | ")[0] for line in page.splitlines() if " | D2 | overlap ratio" in line]
    assert lines == ["| `figures`", "| `letter`", "| `noise=0.04`"]
    assert {seed for _, seed in RunFile(tmp_path, "cells", "tiny").read()} == {5, 6}
    said: list[str] = []
    reproduce("cells", tmp_path, **words, say=said.append)
    assert said == []
    file = RunFile(tmp_path, "figures", "tiny")
    heading = {"scenario": "figures, of another day"}
    file.add(dataclasses.replace(run, about=heading) for run in file.read().values())
    monkeypatch.setattr("fpg_bench.paper.reproduce.run_jobs", None)  # nothing is trained before
    with pytest.raises(UserError, match="played another game than figures is now"):
        reproduce("cells", tmp_path, **words)
