"""Verdicts on runs with a known outcome."""

from dataclasses import replace

import pytest

from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.products.papers.yang_2026.claims import CLAIMS, Comparison, PairedTest, compare, holm, verdict
from fpg_bench.products.papers.yang_2026.conditions import BASE
from fpg_bench.products.papers.yang_2026.experiment import BUDGETS
from fpg_bench.products.papers.yang_2026.report import write_report
from tests.products.papers.made_up import LEVELS, results


def by_claim(runs):
    comparisons = compare(runs)
    return {claim: verdict([c for c in comparisons if c.claim == claim]) for claim in CLAIMS}


def test_claims_that_are_true_hold_with_ten_seeds():
    assert by_claim(results()) == dict.fromkeys(CLAIMS, "holds")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("levels", "first"),
    [(LEVELS, "- The paper trains"), (LEVELS | {"tone": 9.0}, "- D3 of the paper's claims do not")],
)
def test_the_report_begins_with_claims_that_do_not_hold(tmp_path, levels, first):
    path, *_ = write_report(
        results(levels), "paper", BUDGETS["full"], [], tmp_path, "fpg-bench reproduce yang-2026 all"
    )
    text = path.read_text()
    assert text.split("## What could not be reproduced\n\n")[1].startswith(first)


def test_opposite_results_are_reported():
    verdicts = by_claim(results(LEVELS | {"tone": 9.0, "broadband": 3.0, BASE: 1.0}, rising=-1.0))
    assert "the opposite" in verdicts["D1"]
    assert "the opposite" in verdicts["D2"]
    assert "the opposite" in verdicts["D3"]
    assert "1 of 2 parts hold" in verdicts["D4"]


def test_five_seeds_are_too_few_for_a_verdict():
    assert by_claim(results(seeds=range(5))) == {
        claim: f"not shown (0 of {parts} parts hold)"
        for claim, parts in zip(CLAIMS, (3, 3, 3, 9, 2), strict=True)
    }


def test_only_existing_runs_are_tested():
    comparisons = compare(results({BASE: 10.0, "circle": 5.0}))
    assert {each.claim for each in comparisons} == {"D1", "D2"}
    assert verdict([]) == "not run"


def test_each_jamming_type_is_compared_with_the_ally():
    comparisons = compare(results(LEVELS | {"tone": 25.0}))
    alone = {c.statement.split()[0]: c.verdict for c in comparisons if "alone" in c.statement}
    assert alone == dict.fromkeys(JAMMING_TYPES, "holds") | {"tone": "the opposite"}


def test_comparisons_include_the_difference_with_noise():
    (first, *_) = compare(results())
    assert first.with_noise is not None
    assert first.with_noise.mean == pytest.approx(5, abs=0.2)


def test_a_claim_whose_parts_all_hold_uncorrected_holds():
    """Nine parts have p = 0.01: none of them holds by itself, but the claim does."""
    one = PairedTest(1.0, 0.5, 1.5, 1.0, 0.01, 10)
    parts = [Comparison("D3", "a part", one, None, p) for p in holm([one.p] * 9)]
    assert [part.verdict for part in parts] == ["not shown"] * 9
    assert verdict(parts) == "holds"
    assert "not shown" in verdict([*parts, Comparison("D3", "another", replace(one, p=0.06), None, 0.5)])


def test_p_values_are_corrected_within_a_claim():
    comparisons = compare(results())
    for claim in CLAIMS:
        family = [each for each in comparisons if each.claim == claim]
        assert [each.p for each in family] == pytest.approx(holm([each.test.p for each in family]))
