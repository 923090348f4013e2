"""Report on the paper's claims and measurements, as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from fpg_bench.common.files import write_whole
from fpg_bench.common.output import csv_text
from fpg_bench.products.papers.page import Lines, render
from fpg_bench.products.papers.reproduction import around
from fpg_bench.products.papers.yang_2026.claims import (
    HOLDS,
    NOT_RUN,
    Comparison,
    PairedTest,
    compare,
    verdict,
)
from fpg_bench.products.papers.yang_2026.conditions import BASE, LLM, LONG, conditions_of, sensitivity
from fpg_bench.products.papers.yang_2026.experiment import Budget
from fpg_bench.products.papers.yang_2026.facts import FACTS
from fpg_bench.products.papers.yang_2026.runs import FIFTH, FINAL, STAGES, WINDOWS, Runs

_TEMPLATE = Path(__file__).with_name("report.md.j2")
_Level = tuple[str, str, int, int]  # heading, column, decimals, factor
_LEVELS: tuple[_Level, ...] = (
    ("ally's reward", "ally_reward", 1, 1),
    ("opponent's reward", "opponent_reward", 1, 1),
    ("overlap ratio %", "overlap_ratio", 1, 100),
    ("jamming success rate %", "jamming_success_rate", 2, 100),
    ("hops %", "hop_rate", 1, 100),
    ("spreading %", "spread_ratio", 1, 100),
    ("within 30 m %", "near_ratio", 1, 100),
)
_SHARES = ("overlap_ratio", "jamming_success_rate", "hop_rate", "spread_ratio")


def write_report(
    results: Runs, preset: str, budget: Budget, drawn: Iterable[str], folder: Path, command: str
) -> list[Path]:
    """Write ``report-<scenario>.md`` and ``levels-<scenario>.csv``, and return their paths.

    Args:
        results: existing runs.
        preset: name of their scenario.
        budget: their budget.
        drawn: names of the figures in ``folder/figures``.
        folder: folder of the files.
        command: command that repeats the runs.
    """
    text = render(_TEMPLATE, **content(results, preset, budget, drawn), command=command)
    paths = [folder / f"report-{preset}.md"]
    write_whole(paths[0], text)
    if results.runs:
        paths.append(folder / f"levels-{preset}.csv")
        write_whole(paths[-1], levels_csv(results, preset))
    return paths


def content(results: Runs, preset: str, budget: Budget, drawn: Iterable[str] = ()) -> dict[str, object]:
    """Return the numbers, tables and texts of a report by their names in its template."""
    comparisons = compare(results)
    verdicts = {name: verdict([each for each in comparisons if each.claim == name]) for name in FACTS.claims}
    conditions = conditions_of("all", preset, full=True)
    names = [LLM, *(condition.name for condition in conditions)]
    trained = [results.runs.get(name, {}) for name in names]  # without evaluations on swapped paths
    headings = [run.about for by_seed in trained for run in by_seed.values()]
    pairs = sorted({each.test.pairs for each in comparisons})
    return {
        "preset": preset,
        "budget": budget,
        "base": BASE,
        "long": LONG if LONG in results.runs else None,
        "llm": LLM in results.runs,
        "claims": [
            ["claim", "the paper", "verdict"],
            *([name, statement, f"**{verdicts[name]}**"] for name, statement in FACTS.claims.items()),
        ],
        "missed": [name for name, result in verdicts.items() if result not in (HOLDS, NOT_RUN)],
        "tests": tests_table(comparisons),
        "pairs": " or ".join(map(str, pairs)),
        "figures": list(drawn),
        "captions": FACTS.figures,
        "overlap": _overlap(results),
        "spread": _spread(results),
        "fifths": fifths_table(results),
        "finals": _levels(
            results, [LLM, *(each.name for each in conditions if each.tested)], (FINAL,), _LEVELS[:4]
        ),
        "differs": any(each.name in results.runs for each in sensitivity(preset)),
        "runs": len(headings),
        "minutes": sum(heading.seconds for heading in headings) / 60,
        "versions": "; ".join(sorted({heading.versions for heading in headings})) or "no runs",
    }


def tests_table(comparisons: Sequence[Comparison]) -> Lines:
    """Return a table of tests, a line each below the headings."""
    lines = [["claim", "claimed to be positive", "measured", "95 % interval", "d_z", "p", "p (Holm)"]]
    lines[0] += ["with noise", "by itself"]
    for each in comparisons:
        test, noisy = each.test, each.with_noise
        effect = "-" if test.effect is None else f"{round(test.effect, 1) + 0.0:.1f}"
        with_noise = "-" if noisy is None else f"{_number(noisy.mean)} {_interval(noisy)}"
        numbers = [_number(test.mean), _interval(test), effect, f"{test.p:.3f}", f"{each.p:.3f}", with_noise]
        lines.append([each.claim, each.statement, *numbers, each.verdict])
    return lines


def _overlap(results: Runs) -> Lines:
    lines = [["stage", "the paper", "spectrum overlap", "overlap ratio"]]
    seeds = results.seeds(BASE)
    for stage, windows in STAGES.items() if seeds else ():
        pooled = results.overlap(BASE, stage, seeds)
        share = results.mean(BASE, "overlap_ratio", windows, seeds)
        lines.append(
            [stage, FACTS.overlap[stage], *(f"{around(each, 1, 100)} %" for each in (pooled, share))]
        )
    return lines


def _spread(results: Runs) -> str:
    seeds = results.seeds(BASE)
    if len(seeds) < 2:
        return "not known from a single run"
    early, late = (results.overlap(BASE, stage, seeds) for stage in ("early", "late"))
    return f"{100 * (late - early).std(ddof=1):.1f} points"


def fifths_table(results: Runs) -> Lines:
    """Tabulate the base condition and the long run by fifths of their training."""
    shown = [each for each in _LEVELS if each[1] in _SHARES]
    lines = [["condition", "of training", *(heading for heading, *_ in shown)]]
    for name in (BASE, LONG):
        seeds = results.seeds(name)
        for start in range(0, WINDOWS, FIFTH) if seeds else ():
            windows = range(start, start + FIFTH)
            cells = [around(results.mean(name, column, windows, seeds), *form) for _, column, *form in shown]
            lines.append([name, f"{100 * start // WINDOWS} to {100 * (start + FIFTH) // WINDOWS} %", *cells])
    return lines


def _levels(
    results: Runs, names: Iterable[str], windows: Iterable[int], columns: Sequence[_Level] = _LEVELS
) -> Lines:
    lines = [["condition", "seeds", *(heading for heading, *_ in columns)]]
    for name in names:
        if seeds := results.seeds(name):
            cells = [
                around(results.mean(name, column, windows, seeds), *form) for _, column, *form in columns
            ]
            lines.append([name, str(len(seeds)), *cells])
    return lines


def _otherwise(results: Runs, preset: str) -> Lines:
    """Tabulate the effect of each open point resolved differently, against the same seeds of the base."""
    lines = []
    for condition in sensitivity(preset):
        if seeds := results.seeds(BASE, condition.name):
            cells = []
            for _, column, *form in _LEVELS:
                here, there = (results.level(name, column, seeds) for name in (condition.name, BASE))
                cells.append(around(here - there, *form))
            lines.append([condition.name, str(len(seeds)), *cells])
    return lines


def levels_csv(results: Runs, preset: str) -> str:
    """Return the levels of all conditions in both stages, and the differences from the base, as CSV."""
    names = [LLM, *(condition.name for condition in conditions_of("all", preset, full=True))]
    late, final = (_levels(results, names, windows) for windows in (STAGES["late"], (FINAL,)))
    stages = {"late in training": late[1:], "after training": final[1:]}
    stages[f"late in training, minus {BASE}"] = _otherwise(results, preset)
    head = ["stage", *late[0]]
    return csv_text([head, *([stage, *line] for stage, lines in stages.items() for line in lines)])


def _interval(test: PairedTest) -> str:
    return f"[{_number(test.low)}, {_number(test.high)}]"


def _number(value: float) -> str:
    """Return a number with two decimals, or with two digits if it is small."""
    return f"{value + 0.0:.2f}" if abs(value) >= 1 else f"{value + 0.0:.2g}"
