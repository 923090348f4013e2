"""Rewrite the committed numbers and figures on the paper's claims from the committed runs, without training.

``python scripts/paper_pages.py`` writes ``figures.md``, ``fifths.csv`` and ``levels-*.csv`` of the three
presets, ``tests.csv`` with the tests of all committed runs, and all figures into ``docs/results/paper``.
``fpg-bench reproduce`` makes the runs, with a full report on each preset.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from fpg_bench.common.canvas import write_figure
from fpg_bench.common.files import write_whole
from fpg_bench.common.output import csv_text
from fpg_bench.products.papers.page import render
from fpg_bench.products.papers.yang_2026.claims import compare
from fpg_bench.products.papers.yang_2026.experiment import BUDGETS
from fpg_bench.products.papers.yang_2026.facts import FACTS
from fpg_bench.products.papers.yang_2026.figures import FIGURES
from fpg_bench.products.papers.yang_2026.report import content as report_content
from fpg_bench.products.papers.yang_2026.report import fifths_table, levels_csv, tests_table
from fpg_bench.products.papers.yang_2026.runs import RunFile, Runs, read_results

ROOT = Path(__file__).parents[1]
RUNS = ROOT / "results/reproduction"
PAGES = ROOT / "docs/results/paper"
TEMPLATE = Path(__file__).with_name("paper_figures.md.j2")
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


def results_of(preset: str, budget: str, seeds: range, folder: str = ".") -> Runs:
    """Return the committed runs of a preset, with all their conditions."""
    file = RunFile(RUNS / folder, preset, budget)
    return read_results(file, {name: seeds for name, _ in file.read()})


def variants() -> dict[str, Runs]:
    """Return the runs of each trained variant by its name."""
    results = results_of(VARIANTS, "hundredth", range(100, 110))
    by_variant = {}
    for shown, stored in VARIANTS_OF.items():
        names = {name.partition(": ")[2]: name for name in results.runs if name.startswith(f"{stored}: ")}
        by_variant[shown] = Runs({condition: results.runs[name] for condition, name in names.items()})
    return by_variant


def all_runs() -> Iterator[tuple[str, str, range, Runs]]:
    """Yield game, budget, seeds and runs of everything that is committed."""
    for preset, budget, seeds, folder in (*((*report[:3], ".") for report in REPORTS), *OTHERS):
        yield preset, budget, seeds, results_of(preset, budget, seeds, folder)
    for name, results in variants().items():
        yield name, "hundredth", range(100, 110), results


def write_pages(folder: Path = PAGES) -> list[Path]:
    """Write the page of figures, the levels, fifths and tests into a folder, and return their paths."""
    parts, texts, tests = {}, {}, []
    fifths: dict[tuple[str, str, str], list[list[str]]] = {}
    for preset, budget, seeds, _ in REPORTS:
        results = results_of(preset, budget, seeds)
        parts[preset] = report_content(results, preset, BUDGETS[budget])
        texts[f"levels-{preset}.csv"] = levels_csv(results, preset)
    texts["figures.md"] = figures_page(parts)
    for game, budget, seeds, results in all_runs():
        about = game, budget, f"{seeds[0]} to {seeds[-1]}"
        tests.append((about, tests_table(compare(results))))
        fifths.setdefault(about, fifths_table(results))
    texts["tests.csv"] = as_csv(["game", "budget", "seeds"], tests)
    texts["fifths.csv"] = as_csv(["game", "budget", "seeds"], fifths.items())
    for name, text in texts.items():
        write_whole(folder / name, text)
    return [folder / name for name in texts]


def figures_page(parts: dict[str, dict[str, Any]]) -> str:
    """Return the page with each figure of all presets, from the contents of their reports."""
    stages = list(zip(*(next(iter(parts.values()))["overlap"]), strict=True))
    overlap = [["", *stages[0][1:]], ["published", *stages[1][1:]]]
    overlap += [[preset, *(line[2] for line in part["overlap"][1:])] for preset, part in parts.items()]
    made = [["game", "seeds", "budget", "updates of both sides", "runs", "minutes of one core"]]
    for preset, budget, seeds, _ in REPORTS:
        part, updates = parts[preset], f"{BUDGETS[budget].updates():,}"
        spent = [updates, str(part["runs"]), f"{part['minutes']:.0f}"]
        made.append([preset, f"{seeds[0]} to {seeds[-1]}", budget, *spent])
    return render(
        TEMPLATE,
        presets=list(parts),
        captions=FACTS.figures,
        overlap=overlap,
        spreads=", ".join(f"{part['spread']} ({preset})" for preset, part in parts.items()),
        made=made,
        commands=[command for *_, command in REPORTS],
    )


def write_figures(folder: Path = PAGES) -> list[Path]:
    """Write all figures into folders of the pages, and return their paths."""
    figures = {
        f"figures/{name}-{preset}": draw(results_of(preset, budget, seeds), preset)
        for preset, budget, seeds, _ in REPORTS
        for name, draw in FIGURES.items()
    }
    tenth = results_of("figures", "tenth", range(200, 210))
    figures["figures/fig5-figures-tenth"] = FIGURES["fig5"](tenth, "figures")
    alone = RunFile(RUNS, "paper", "full")
    alone.path = ROOT / "results/language-model/fig3/rows.jsonl.gz"
    runs = results_of("paper", "full", range(10)).runs | read_results(alone, {"llm": range(1)}).runs
    figures["../fig7-language-model"] = FIGURES["fig7"](Runs(runs), "paper")
    paths = [folder / f"{name}.svg" for name in figures]
    for path, figure in zip(paths, figures.values(), strict=True):
        write_figure(figure, path)
    return paths


def as_csv(headings: list[str], tables: Iterable[tuple[tuple[str, ...], list[list[str]]]]) -> str:
    """Return tables below each other as CSV, each line behind the cells that come with its table."""
    every: list[list[str]] = []
    for cells, (heading, *lines) in tables:
        every = every or [[*headings, *heading]]
        every += [[*cells, *line] for line in lines]
    return csv_text(every)


if __name__ == "__main__":
    for path in [*write_pages(), *write_figures()]:
        print(path)
