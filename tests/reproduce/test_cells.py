"""The readings that decide: which they are, what is trained under them, and what their page says."""

import dataclasses

import pytest

from fpg_bench.game.scenario import PAPER, preset
from fpg_bench.reproduce import cells as choosing
from fpg_bench.reproduce import cells_report
from fpg_bench.reproduce.cells import FIGURES, cell_conditions, cells, every_condition, neighbours
from fpg_bench.reproduce.experiment import Budget
from fpg_bench.reproduce.readings import POINTS, Reading, as_reading
from fpg_bench.reproduce.reproduce import reproduce
from fpg_bench.reproduce.runs import RunFile

TINY = Budget("tiny", 2_000, 8, 25, 2, 1)


def test_the_preset_is_the_reading_that_is_trained_first():
    assert cells()[0].scenario() == preset("figures")
    assert preset("figures") != PAPER


def test_a_neighbour_settles_one_point_otherwise():
    found = list(neighbours(FIGURES))
    assert len(found) == sum(len(known) - 1 for known in POINTS.values())
    for reading in found:
        assert sum(one != other for one, other in zip(reading.settings, FIGURES.settings, strict=True)) == 1
    assert set(found) | {FIGURES, as_reading("letter")} == set(cells())


def test_what_is_trained_plays_the_reading_under_names_of_its_own():
    every = every_condition()
    assert len({condition.name for condition in every}) == len(every) == 7 * len(cells())
    for reading in cells():
        base, tone, *_ = cell_conditions(reading)
        assert base.scenario("paper") == reading.scenario()
        assert tone.scenario("paper") == dataclasses.replace(reading.scenario(), jamming_types=("tone",))


@pytest.mark.slow
def test_trained_readings_come_to_a_page_and_are_not_trained_again(monkeypatch, tmp_path):
    two = [FIGURES, as_reading("letter")]
    for module in (choosing, cells_report):
        monkeypatch.setattr(module, "cells", lambda: two)
    monkeypatch.setattr(choosing, "_ASKED", ("planned",))
    monkeypatch.setattr(Reading, "rounds", 4)  # in place of up to forty
    words = {"budget": TINY, "seeds": 2, "first_seed": 5, "workers": 1}
    written = reproduce("cells", tmp_path, **words, say=lambda line: None)
    assert [path.name for path in written] == ["cells.png", "cells.svg", "cells.md"]
    page = (tmp_path / "cells.md").read_text()
    assert "Training seeds are 5 to 6" in page
    assert "fpg-bench reproduce cells --budget tiny --seeds 2 --first-seed 5" in page
    lines = [line.split(" | ")[0] for line in page.splitlines() if " | D2 | overlap ratio" in line]
    assert lines == [f"| `{reading.name}`" for reading in two]
    assert {seed for _, seed in RunFile(tmp_path, "cells", "tiny").read()} == {5, 6}
    said: list[str] = []
    reproduce("cells", tmp_path, **words, say=said.append)
    assert said == []
