"""The committed reports match the committed runs and the present code."""

import re
from pathlib import Path

import pytest
from paper_pages import REPORTS, VARIANTS, all_runs, results_of, variants, write_pages

from fpg_bench.products.papers.yang_2026.claims import CLAIMS, compare, verdict
from fpg_bench.products.papers.yang_2026.conditions import ALL, conditions_of
from fpg_bench.products.papers.yang_2026.experiment import BUDGETS
from fpg_bench.products.papers.yang_2026.figures import FIGURES
from fpg_bench.products.papers.yang_2026.runs import RunFile, read_results

COMMITTED = Path(__file__).parents[3] / "docs/results/paper"
RUNS = Path(__file__).parents[3] / "results/reproduction"
FULL = BUDGETS["full"]
BOTH = ("paper", "standard")


@pytest.fixture(scope="module", params=BOTH)
def committed(request):
    """A scenario and its committed runs."""
    preset = request.param
    wanted = {condition.name: range(FULL.seeds) for condition in conditions_of(ALL, preset, full=True)}
    return preset, read_results(RunFile(RUNS, preset, FULL.name), wanted)


def test_committed_runs_have_all_seeds_and_the_present_scenario(committed):
    preset, results = committed
    for condition in conditions_of(ALL, preset, full=True):
        wanted = 1 if condition.budgets > 1 else FULL.seeds if condition.tested else 5
        assert results.seeds(condition.name) == list(range(wanted)), condition.name
        for run in results.runs[condition.name].values():
            assert run.about.scenario == f"{preset}, {condition.scenario(preset).hash}", condition.name


@pytest.mark.full
def test_committed_figures_levels_and_tests_match_the_committed_runs(tmp_path):
    for made in write_pages(tmp_path):
        assert made.read_text() == (COMMITTED / made.name).read_text(), made.name
    for preset, *_ in REPORTS:
        for figure in FIGURES:
            assert (COMMITTED / f"figures/{figure}-{preset}.svg").is_file()


@pytest.mark.parametrize(
    ("preset", "name", "seeds"),
    [
        ("paper", "paper", range(300, 303)),
        ("figures", "tenth", range(200, 210)),
        ("figures", "tenth", range(400, 410)),
    ],
)
def test_runs_with_more_updates_have_the_present_scenario_and_are_quoted(preset, name, seeds):
    budget = BUDGETS[name]
    results = results_of(preset, name, seeds)
    (condition,) = conditions_of("fig4", preset, full=False)
    assert results.seeds(condition.name) == list(seeds)
    known = {each.name: each for each in conditions_of(ALL, preset, full=True)}
    for run_name, runs in results.runs.items():
        game = known[run_name.split("@")[0]].scenario(preset)
        for run in runs.values():
            assert run.about.scenario == f"{preset}, {game.hash}"
            assert run.about.budget.startswith(f"{name}, {budget.steps} steps, ")
    page = (COMMITTED.parent / "paper.md").read_text()
    (test,) = (each.test for each in compare(results) if each.statement == "overlap ratio: early - late")
    digits = 0 if name == "paper" else 1
    interval = f"[{100 * test.low:.{digits}f}, {100 * test.high:.{digits}f}]"
    assert re.search(rf"{100 * test.mean:.1f} (points )?{re.escape(interval)}", page)


def aspect_of(comparison):
    """Return the key of ASPECTS to which a test belongs, or D1 frozen."""
    if comparison.claim == "D3":
        return "D3 level" if "alone" in comparison.statement else "D3 order"
    if comparison.claim == "D4":
        return "D4 planner" if "learned path" in comparison.statement else "D4 knowledge"
    return comparison.claim


def test_page_of_trained_variants_has_their_verdicts():
    lines = (COMMITTED / f"{VARIANTS}.md").read_text().splitlines()
    table = [[cell.strip("` ") for cell in line.split("|")[1:-1]] for line in lines if line.startswith("| ")]
    heading, _, *rows = table
    runs = {"figures": results_of("figures", "hundredth", range(100, 110)), **variants()}
    assert [name for name, *_ in rows] == list(runs)
    for name, *cells in rows:
        results = runs[name]
        for aspect, cell in zip(heading[1:], cells, strict=True):
            if cell != "-":
                assert cell == verdict([each for each in compare(results) if aspect_of(each) == aspect])


@pytest.mark.full
def test_page_on_paths_quotes_the_gains_of_frozen_pairs():
    page = (COMMITTED / "claims.md").read_text()
    quoted = [
        line.split(" | ", 1)[1] for line in page.splitlines() if line.startswith("| ") and " to " in line
    ]
    measured = set()
    for _, _, seeds, results in all_runs():
        tests = [each.test for each in compare(results) if each.claim == "D1 frozen"]
        cells = (f"{test.mean:z.1f} [{test.low:z.1f}, {test.high:z.1f}]" for test in tests)
        measured.add(f"{seeds[0]} to {seeds[-1]} | {' | '.join(cells)} |")
    assert len(quoted) == 8
    assert [line for line in quoted if line not in measured] == []


def test_docs_quote_the_verdicts():
    page = (COMMITTED.parent / "paper.md").read_text()
    again = {
        "paper": variants()["as-printed"],
        "standard": results_of("standard", "hundredth", range(100, 110)),
    }
    for place, preset in ((-2, "paper"), (-1, "standard")):
        first, fresh = compare(results_of(preset, "full", range(10))), compare(again[preset])
        verdicts = {claim: verdict([each for each in first if each.claim == claim]) for claim in CLAIMS}
        frozen = [each for each in fresh if each.claim == "D1 frozen"]
        verdicts["D1 frozen"] = f"{verdict(frozen)}, fresh seeds"
        assert _verdicts(page, place) == verdicts


def _verdicts(text: str, place: int) -> dict[str, str]:
    """Return a cell of each claim's line in the first table with claims."""
    lines = [line.strip("| ").split(" | ") for line in reversed(text.splitlines()) if line.startswith("| D")]
    return {line[0]: line[place].strip("*") for line in lines}
