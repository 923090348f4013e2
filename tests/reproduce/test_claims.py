"""Verdicts on runs whose outcome is known, because they are made up."""

from dataclasses import replace

import numpy as np
import pytest

from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.reproduce.claims import CLAIMS, Comparison, compare, verdict
from fpg_bench.reproduce.conditions import BASE, FIXED_PATHS, NO_KNOWLEDGE, NO_PLANNER, swapped
from fpg_bench.reproduce.experiment import BUDGETS
from fpg_bench.reproduce.paired import Paired, holm
from fpg_bench.reproduce.report import write_report
from fpg_bench.reproduce.results import Results
from fpg_bench.reproduce.windows import COLUMNS, FINAL, WINDOWS

SEEDS = range(10)
LEVELS = dict.fromkeys(FIXED_PATHS, 5.0) | {"tone": 3.0, "narrowband": 6.0, "comb": 5.0, "broadband": 9.0}
LEVELS |= {BASE: 10.0, NO_PLANNER: 4.0, NO_KNOWLEDGE: 10.0}
LEVELS |= {swapped(BASE, path): 7.0 for path in FIXED_PATHS}


def run(condition: str, seed: int, levels: dict[str, float], rising: float) -> list[dict]:
    """A run whose opponent's reward is its condition's level, with overlap falling as success rises."""
    rng = np.random.default_rng([seed, len(condition)])
    rows = []
    for window in range(WINDOWS + 1):
        row = dict.fromkeys(COLUMNS, 0.0) | {"window": window, "rounds": 10}
        row["opponent_reward"] = levels[condition] + rng.normal(0, 0.1)
        row["ally_reward"] = (15.0 if condition == NO_KNOWLEDGE else 20.0) + rng.normal(0, 0.1)
        part = min(window, FINAL - 1) / WINDOWS
        row["overlap_ratio"] = 0.5 - rising * 0.2 * part + rng.normal(0, 0.01)
        row["jamming_success_rate"] = 0.1 + rising * 0.2 * part + rng.normal(0, 0.01)
        own = np.full(15, 100)
        own[window % 15] += 100
        own[0] += int(rising * 300 * part)
        row |= {"ally_points": own.tolist(), "jam_points": [100] * 15}
        rows.append(row)
    return rows


def results(levels=LEVELS, rising=1.0, seeds=SEEDS) -> Results:
    runs = {name: {seed: run(name, seed, levels, rising) for seed in seeds} for name in levels}
    about = {name: {seed: {"seconds": "1", "versions": "made up"} for seed in seeds} for name in levels}
    return Results(runs, about)


def by_claim(found):
    comparisons = compare(found)
    return {claim: verdict([c for c in comparisons if c.claim == claim]) for claim in CLAIMS}


def test_claims_that_are_true_hold_with_ten_seeds():
    assert by_claim(results()) == dict.fromkeys(CLAIMS, "holds")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("levels", "first"),
    [(LEVELS, "- The paper trains"), (LEVELS | {"tone": 9.0}, "- D3 of the paper's claims did not")],
)
def test_what_did_not_come_out_is_said_first(tmp_path, levels, first):
    path, _ = write_report(results(levels), "paper", BUDGETS["full"], [], tmp_path, "fpg-bench reproduce all")
    text = path.read_text()
    assert text.split("## What could not be reproduced\n\n")[1].startswith(first)


def test_the_opposite_is_told_as_such():
    found = by_claim(results(LEVELS | {"tone": 9.0, "broadband": 3.0, BASE: 1.0}, rising=-1.0))
    assert "the opposite" in found["D1"]
    assert "the opposite" in found["D2"]
    assert "the opposite" in found["D3"]
    assert "1 of 2 parts hold" in found["D4"]


def test_five_seeds_can_show_nothing():
    assert by_claim(results(seeds=range(5))) == {
        claim: f"not shown (0 of {parts} parts hold)"
        for claim, parts in zip(CLAIMS, (3, 3, 3, 9, 2), strict=True)
    }


def test_only_what_was_run_is_tested():
    found = compare(results({BASE: 10.0, "circle": 5.0}))
    assert {each.claim for each in found} == {"D1", "D2"}
    assert verdict([]) == "not run"


def test_single_types_are_each_compared_with_the_ally():
    found = compare(results(LEVELS | {"tone": 25.0}))
    alone = {c.statement.split()[0]: c.verdict for c in found if "alone" in c.statement}
    assert alone == dict.fromkeys(JAMMING_TYPES, "holds") | {"tone": "the opposite"}


def test_a_difference_with_noise_stands_beside():
    (first, *_) = compare(results())
    assert first.check is not None
    assert first.check.mean == pytest.approx(5, abs=0.2)


def test_a_claim_whose_parts_all_hold_uncorrected_holds():
    """Nine parts of p = 0.01 each: none of them stands alone, and the claim does."""
    one = Paired(1.0, 0.5, 1.5, 1.0, 0.01, 10)
    parts = [Comparison("D3", "a part", one, None, p) for p in holm([one.p] * 9)]
    assert [part.verdict for part in parts] == ["not shown"] * 9
    assert verdict(parts) == "holds"
    assert "not shown" in verdict([*parts, Comparison("D3", "another", replace(one, p=0.06), None, 0.5)])


def test_a_part_is_corrected_for_the_parts_of_its_own_claim_alone():
    found = compare(results())
    for claim in CLAIMS:
        family = [each for each in found if each.claim == claim]
        assert [each.p for each in family] == pytest.approx(holm([each.found.p for each in family]))
