"""The committed reports match the committed runs and the present code."""

import dataclasses
import gzip
import json
from pathlib import Path

import pytest

from fpg_bench.game.scenario import as_scenario
from fpg_bench.paper.claims import CLAIMS, LEVEL, compare, verdict
from fpg_bench.paper.conditions import ALL, FIXED_PATHS, conditions_of
from fpg_bench.paper.experiment import BUDGETS
from fpg_bench.paper.figures import FIGURES
from fpg_bench.paper.report import write_report
from fpg_bench.paper.runs import Results, RunFile, read_results

COMMITTED = Path(__file__).parents[2] / "docs/results/paper"
RUNS = Path(__file__).parents[2] / "results/reproduction"
FULL = BUDGETS["full"]
BOTH = ("paper", "standard")
VARIANTS = "trained-variants"
# Parts of claims that can hold by themselves.
ASPECTS = {
    "D1": CLAIMS["D1"],
    "D2": CLAIMS["D2"],
    "D3 level": "Each jamming type alone leaves the opponent below the ally",
    "D3 order": "Single tone is weakest, broadband strongest",
    "D4 planner": "Without the planner, where it learns to fly, the opponent is worse",
    "D4 knowledge": "Without the knowledge base the ally is worse",
}
SETTINGS = {  # of the trained variants, as changes of the preset paper
    "interference=once": {"snr_model": "sinr"},
    "hops=always": {"hopping": "always"},
    "hop-cost=0": {"hop_cost": 0.0},
    "memory=for-ever": {"rounds_per_match": 40},
}


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
        for heading in results.about[condition.name].values():
            assert heading["scenario"] == f"{preset}, {condition.scenario(preset).hash}", condition.name


def test_committed_report_matches_its_runs(committed, tmp_path):
    preset, results = committed
    command = f"fpg-bench reproduce all --scenario {preset} --budget full --n-seeds {FULL.seeds}"
    made, _ = write_report(results, preset, FULL, FIGURES, tmp_path, command)
    assert made.read_text() == (COMMITTED / made.name).read_text()
    for figure in FIGURES:
        for form in ("png", "svg"):
            assert (COMMITTED / f"figures/{figure}-{preset}.{form}").is_file()


@pytest.mark.parametrize(
    ("preset", "name", "seeds"),
    [
        ("paper", "paper", range(300, 303)),
        ("figures", "tenth", range(200, 210)),
        ("figures", "tenth", range(400, 410)),
    ],
)
def test_page_quotes_runs_with_more_updates(preset, name, seeds, tmp_path):
    budget = BUDGETS[name]
    results = _results(preset, budget, seeds)
    (condition,) = conditions_of("fig4", preset, full=False)
    assert results.seeds(condition.name) == list(seeds)
    known = {each.name: each for each in conditions_of(ALL, preset, full=True)}
    for run, headings in results.about.items():
        game = known[run.split("@")[0]].scenario(preset)
        for heading in headings.values():
            assert heading["scenario"] == f"{preset}, {game.hash}"
            assert heading["budget"].startswith(f"{name}, {budget.steps} steps, ")
    made, _ = write_report(results, preset, budget, ["fig5"], tmp_path, "fpg-bench reproduce fig4")
    lines = [line for line in made.read_text().splitlines() if line.startswith("| planned |")]
    page = (COMMITTED.parent / "paper.md").read_text()
    assert len(fifths := [line for line in lines if "to" in line.split("|")[2]]) == 5
    assert [line for line in fifths if line not in page] == []


def test_committed_report_of_figures_matches_its_runs_on_fresh_seeds(tmp_path):
    budget = BUDGETS["hundredth"]
    file = RunFile(RUNS, "figures", budget.name)
    stored = file.read()
    seeds = sorted({seed for _, seed in stored})
    assert min(seeds) >= 100  # those below were looked at before this interpretation was chosen
    results = read_results(file, {name: seeds for name, _ in stored})
    report = (COMMITTED / "report-figures.md").read_text()
    (command,) = [line for line in report.splitlines() if line.startswith("fpg-bench reproduce")]
    assert f"--n-seeds {len(seeds)} --first-seed {min(seeds)}" in command
    drawn = [name for name in FIGURES if f"figures/{name}-figures.png" in report]
    made, _ = write_report(results, "figures", budget, drawn, tmp_path, command)
    assert made.read_text() == report
    for name in drawn:
        assert (COMMITTED / f"figures/{name}-figures.png").is_file()
    for (name, _), run in stored.items():
        known = {c.name: c for c in conditions_of(ALL, "figures", full=True)}[name.split("@")[0]]
        assert run.about["scenario"] == f"figures, {known.scenario('figures').hash}"


def aspect_of(comparison):
    """Return the key of ASPECTS to which a test belongs, or D1 frozen."""
    if comparison.claim == "D3":
        return "D3 level" if "alone" in comparison.statement else "D3 order"
    if comparison.claim == "D4":
        return "D4 planner" if "learned path" in comparison.statement else "D4 knowledge"
    return comparison.claim


@pytest.fixture(scope="module")
def variants():
    """Runs of each trained variant by its name."""
    results = _results(VARIANTS, BUDGETS["hundredth"], range(100, 110))
    by_variant = {name.partition(": ")[0]: Results({}, {}) for name in results.runs}
    for name, runs in results.runs.items():
        variant, _, condition = name.partition(": ")
        by_variant[variant].runs[condition] = runs
        by_variant[variant].about[condition] = results.about[name]
    return by_variant


@pytest.fixture(scope="module")
def again(variants):
    """Runs that have no report: pairs on all paths, and variants."""
    return {
        **{f"{preset}, first look": _results(preset, FULL, range(10), RUNS / "frozen") for preset in BOTH},
        "standard": _results("standard", BUDGETS["hundredth"], range(100, 110)),
        **{
            f"figures, more updates, from {first}": _results(
                "figures", BUDGETS["tenth"], range(first, first + 10)
            )
            for first in (200, 400)
        },
        **variants,
    }


def test_committed_page_of_trained_variants_matches_their_runs_on_fresh_seeds(variants):
    stored = RunFile(RUNS, VARIANTS, "hundredth").read()
    known = {condition.name: condition for condition in conditions_of(ALL, "paper", full=False)}
    assert set(stored) == {(name, seed) for name, _ in stored for seed in range(100, 110)}
    for (name, _), run in stored.items():
        variant, _, condition = name.partition(": ")
        settings = [SETTINGS.get(setting, {}) for setting in variant.split(",")]
        changes = {key: value for each in settings for key, value in each.items()}
        game = as_scenario("paper", **{"rounds_per_match": 10} | changes)
        game = dataclasses.replace(game, **known[condition.split("@")[0]].changes)
        assert run.about["scenario"] == f"paper, {game.hash}"
    lines = set()
    figures = _results("figures", BUDGETS["hundredth"], range(100, 110))
    for runs in (figures, *variants.values()):
        for each in compare(runs):
            mean, low, high = (f"{value:.3g}" for value in (each.test.mean, each.test.low, each.test.high))
            measured = f"{each.statement} | {mean} | [{low}, {high}] | {each.test.p:.3f}"
            lines.add(f"{aspect_of(each)} | {measured} | {each.verdict} |")
    page = (COMMITTED / f"{VARIANTS}.md").read_text().split("## Part by part")[1]
    printed = [line.partition("` | ")[2] for line in page.splitlines() if line.startswith("| `")]
    assert len(printed) == 81
    assert [line for line in printed if line not in lines] == []


def lines_with_tests(results, tmp_path):
    """Return the lines with tests in the report of some runs."""
    report, _ = write_report(results, "paper", BUDGETS["hundredth"], [], tmp_path, "fpg-bench reproduce")
    return [line for line in report.read_text().splitlines() if line.startswith("| D")]


def test_pairs_on_all_paths_have_the_present_scenario():
    for preset, budget, first, place in (
        *((preset, FULL, 0, "frozen") for preset in BOTH),
        ("standard", BUDGETS["hundredth"], 100, "."),
    ):
        seeds = range(first, first + 10)
        results = _results(preset, budget, seeds, RUNS / place)
        (base,) = conditions_of("fig4", preset, full=False)
        for name in base.runs:
            assert results.seeds(name) == list(seeds)
            for heading in results.about[name].values():
                assert heading["scenario"] == f"{preset}, {base.scenario(preset).hash}"


@pytest.mark.parametrize("name", ["paper, first look", "standard, first look", "as-printed", "standard"])
def test_page_on_paths_quotes_the_tests_of_frozen_pairs(name, again, tmp_path):
    lines = [
        line for line in lines_with_tests(again[name], tmp_path) if line.startswith("| D1 frozen | opponent")
    ]
    page = (COMMITTED / "question-paths.md").read_text().splitlines()
    assert len(lines) == len(FIXED_PATHS)
    assert [line for line in lines if line not in page] == []


def test_docs_quote_the_verdicts(again):
    page = (COMMITTED.parent / "paper.md").read_text()
    for place, preset, name in ((-2, "paper", "as-printed"), (-1, "standard", "standard")):
        report = (COMMITTED / f"report-{preset}.md").read_text()
        verdicts, stated = _verdicts(report, -1), _verdicts(page, place)
        frozen = [each for each in compare(again[name]) if each.claim == "D1 frozen"]
        verdicts["D1 frozen"] = f"{verdict(frozen)}, fresh seeds"
        assert set(verdicts) == set(CLAIMS)
        assert stated == verdicts


def test_committed_page_of_the_screen_matches_its_rows():
    lines = gzip.decompress((RUNS / "screen.jsonl.gz").read_bytes()).splitlines()
    rows = [json.loads(line) for line in lines]
    assert len({row["interpretation"] for row in rows}) == len(rows) == 768
    page = (COMMITTED / "screen.md").read_text()
    for claim, statement in ASPECTS.items():
        held, reverse = 0, 0
        for row in rows:
            parts = [part for part in row["parts"] if part["claim"] == claim]
            held += all(part["mean"] > 0 and part["p"] < LEVEL for part in parts)
            reverse += any(part["high"] < 0 for part in parts)
        assert f"| {claim} | {statement} | {held} of 768 | {reverse} |" in page
    table = page.partition("## Effect of each point\n\n")[2].partition("\n\n")[0]
    assert table.startswith("| point")
    assert table in (COMMITTED.parents[1] / "reference/open-points.md").read_text()
    for form in ("png", "svg"):
        assert (COMMITTED / f"figures/screen.{form}").is_file()


@pytest.mark.parametrize("name", ["paths", "overlap", "types", "knowledge"])
def test_pages_of_questions_quote_existing_tests(name, again, tmp_path):
    reports = [(COMMITTED / f"report-{preset}.md").read_text().splitlines() for preset in (*BOTH, "figures")]
    lines = {
        line
        for each in (*reports, *(lines_with_tests(runs, tmp_path) for runs in again.values()))
        for line in each
    }
    page = (COMMITTED / f"question-{name}.md").read_text()
    quoted = [line for line in page.splitlines() if line.startswith("| D")]
    assert len(quoted) >= 4
    assert [line for line in quoted if line not in lines] == []


def _results(preset, budget, seeds, folder=RUNS):
    file = RunFile(folder, preset, budget.name)
    return read_results(file, {name: seeds for name, _ in file.read()})


def _verdicts(text: str, place: int) -> dict[str, str]:
    """Return a cell of each claim's line in the first table with claims."""
    lines = [line.strip("| ").split(" | ") for line in reversed(text.splitlines()) if line.startswith("| D")]
    return {line[0]: line[place].strip("*") for line in lines}
