import copy

import numpy as np
import pytest
from fpg_bench.evaluation.panel import load_panel

from fpg_bench.leaderboard.agreement import disagreements, same_to_the_bit
from fpg_bench.leaderboard.playing import Part, part_lines


@pytest.fixture(scope="module")
def panel():
    return load_panel("ally-v1")


@pytest.fixture(scope="module")
def lines(panel):
    return list(part_lines(Part(None, "expert-spread"), panel, panel.entries[:2]))


def span(panel, line):
    reference = panel.references[line["entry"]]
    return np.mean(reference.reference) - np.mean(reference.random)


def changed(lines, **values):
    found = copy.deepcopy(lines)
    found[0] |= values
    return found


def test_the_same_lines_agree(lines, panel):
    assert disagreements(lines, lines, panel) == []
    assert same_to_the_bit(lines, lines) == 2


def test_what_another_machine_rounds_otherwise_agrees(lines, panel):
    kept = changed(lines, rows_sha256="other", returns=[x + 0.01 for x in lines[0]["returns"]])
    assert disagreements(lines, kept, panel) == []
    assert same_to_the_bit(lines, kept) == 1


@pytest.mark.parametrize(("count", "agrees"), [(2, True), (3, False)])
def test_one_round_of_a_hundred_may_be_another(lines, panel, count, agrees):
    """Over all lines that are compared, and as long as the mean of the entry holds."""
    returns = list(lines[0]["returns"])
    for k in range(count):
        returns[k] += 0.01 * span(panel, lines[0]) * (-1) ** k
    found = disagreements(lines, changed(lines, returns=returns), panel)
    assert (found == []) is agrees
    if not agrees:
        assert found == ["1.5 % of 200 rounds return something else"]


def test_one_round_that_moves_the_mean_is_told(lines, panel):
    returns = [lines[0]["returns"][0] + 2 * span(panel, lines[0]), *lines[0]["returns"][1:]]
    (found,) = disagreements(lines, changed(lines, returns=returns), panel)
    assert found.startswith(f"{lines[0]['entry']}: mean return ")


def test_other_measures_points_and_lost_rounds_are_told(lines, panel):
    mean = lines[0]["mean"] | {"jamming_success_rate": 0.5}
    points = [0] * len(lines[0]["ally_points"])
    found = disagreements(lines, changed(lines, mean=mean, ally_points=[1, *points[1:]], lost=9), panel)
    entry, rate = lines[0]["entry"], lines[0]["mean"]["jamming_success_rate"]
    assert found == [
        f"{entry}: 0 rounds lost, the result says 9",
        f"{entry}: jamming_success_rate {rate}, the result says 0.5",
        f"{entry}: other ally_points",
    ]


def test_some_of_the_lines_are_compared_with_those_that_they_are(lines, panel):
    assert disagreements(lines[1:], lines, panel) == []
    assert disagreements(lines[1:], changed(lines, lost=50), panel) == []
