"""Rewrite the committed reports and tests of the paper's claims from the committed runs, without training.

``python scripts/paper_pages.py`` writes ``report-*.md`` and ``levels-*.csv`` of the three presets, and
``tests.csv`` with the tests of all committed runs, into ``docs/results/paper``. ``fpg-bench reproduce`` makes
the runs and the figures.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path

from fpg_bench.common.files import write_whole
from fpg_bench.paper.claims import compare
from fpg_bench.paper.experiment import BUDGETS
from fpg_bench.paper.figures import FIGURES
from fpg_bench.paper.report import tests_table, write_report
from fpg_bench.paper.runs import Results, RunFile, read_results

ROOT = Path(__file__).parents[1]
RUNS = ROOT / "results/reproduction"
PAGES = ROOT / "docs/results/paper"
TESTS = "tests.csv"
VARIANTS = "trained-variants"
VARIANTS_OF = {  # stored names of the trained variants, by what differs from figures
    "as-printed": "as-printed",
    "memory=match": "interference=once,hops=always,hop-cost=0",
    "hops=gated": "interference=once,hop-cost=0,memory=for-ever",
    "interference=twice": "hops=always,hop-cost=0,memory=for-ever",
    "noise=0.04": "interference=once,hops=always,hop-cost=0,memory=for-ever,noise=0.04",
    "as-printed, noise=0.04": "as-printed,noise=0.04",
}
# Of each report: preset, budget, seeds, and the command after its name.
REPORTS = (
    ("paper", "full", range(10), "all --scenario paper --budget full --n-seeds 10"),
    ("standard", "full", range(10), "all --scenario standard --budget full --n-seeds 10"),
    (
        "figures",
        "hundredth",
        range(100, 110),
        "fig3 --scenario figures --budget hundredth --n-seeds 10 --first-seed 100 --learner jax"
        "  # and fig6, fig7",
    ),
)
# Of the other runs: preset, budget, seeds, folder.
OTHERS = (
    ("paper", "full", range(10), "frozen"),
    ("standard", "full", range(10), "frozen"),
    ("standard", "hundredth", range(100, 110), "."),
    ("figures", "tenth", range(200, 210), "."),
    ("figures", "tenth", range(400, 410), "."),
    ("paper", "paper", range(300, 303), "."),
)


def results_of(preset: str, budget: str, seeds: range, folder: str = ".") -> Results:
    """Return the committed runs of a preset, with all their conditions."""
    file = RunFile(RUNS / folder, preset, budget)
    return read_results(file, {name: seeds for name, _ in file.read()})


def variants() -> dict[str, Results]:
    """Return the runs of each trained variant by its name."""
    results = results_of(VARIANTS, "hundredth", range(100, 110))
    by_variant = {}
    for shown, stored in VARIANTS_OF.items():
        names = {name.partition(": ")[2]: name for name in results.runs if name.startswith(f"{stored}: ")}
        runs, about = (
            {condition: kept[name] for condition, name in names.items()}
            for kept in (results.runs, results.about)
        )
        by_variant[shown] = Results(runs, about)
    return by_variant


def all_runs() -> Iterator[tuple[str, str, range, Results]]:
    """Yield game, budget, seeds and runs of everything that is committed."""
    for preset, budget, seeds, _ in REPORTS:
        yield preset, budget, seeds, results_of(preset, budget, seeds)
    for preset, budget, seeds, folder in OTHERS:
        yield preset, budget, seeds, results_of(preset, budget, seeds, folder)
    for name, results in variants().items():
        yield name, "hundredth", range(100, 110), results


def write_pages(folder: Path = PAGES) -> list[Path]:
    """Write all reports, levels and tests into a folder, and return their paths."""
    paths = []
    for preset, budget, seeds, words in REPORTS:
        results, command = results_of(preset, budget, seeds), f"fpg-bench reproduce {words}"
        report, page, levels = write_report(results, preset, BUDGETS[budget], FIGURES, folder, command)
        page.unlink()
        paths += [report, levels]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for game, budget, seeds, results in all_runs():
        heading, *lines = tests_table(compare(results))
        if not text.tell():
            writer.writerow(["game", "budget", "seeds", *heading])
        writer.writerows([game, budget, f"{seeds[0]} to {seeds[-1]}", *line] for line in lines)
    paths.append(folder / TESTS)
    write_whole(paths[-1], text.getvalue())
    return paths


if __name__ == "__main__":
    for path in write_pages():
        print(path)
