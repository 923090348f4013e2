"""Report on the paper's claims, measurements and tables, as Markdown and HTML."""

from __future__ import annotations

import html
import inspect
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from jinja2 import Environment, StrictUndefined
from markdown_it import MarkdownIt

from fpg_bench.common.files import write_whole
from fpg_bench.common.output import csv_text
from fpg_bench.evaluation.statistics import student_half
from fpg_bench.evaluation.table import markdown_table
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import PAPER, STANDARD, Scenario
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE
from fpg_bench.products.papers.yang_2026.claims import (
    CLAIMS,
    HOLDS,
    NOT_RUN,
    Comparison,
    PairedTest,
    compare,
    verdict,
)
from fpg_bench.products.papers.yang_2026.conditions import BASE, LLM, LONG, conditions_of, sensitivity
from fpg_bench.products.papers.yang_2026.experiment import ALGORITHM, BUDGETS, Budget, hyperparameters
from fpg_bench.products.papers.yang_2026.runs import FIFTH, FINAL, STAGES, WINDOWS, Runs
from fpg_bench.training.algorithms import find_algorithm

Lines = list[list[str]]  # of a table; the first holds the headings
Table = tuple[str, Lines]  # with its title
_RULES = "docs/reference/rules.md"


def tables(budget: Budget = BUDGETS["full"]) -> list[Table]:
    """Return the paper's three tables, beside the scenarios and hyper-parameters in use."""
    return [_jamming(), _environment(), _algorithm(budget)]


def _jamming() -> Table:
    lines = [["jamming type", "k in the paper", "k in use (both)", "half width (MHz), ours", "why"]]
    given = ("1.5", "1.2", "0.4", "0.8")
    reasons = (
        "Eq. 7 is a line; half an ally's bandwidth makes it hit one frequency point",
        "Eq. 8 leaves B open; three points",
        "Eq. 9 leaves the band open; half of it",
        "Eq. 10 leaves the spacing open; every fourth point, each tooth as wide as a tone",
    )
    for index, kind in enumerate(JAMMING_TYPES):
        width = PAPER.footprint_half_widths_mhz[index]
        lines.append(
            [kind, given[index], f"{PAPER.jamming_coefficients[index]:g}", f"{width:g}", reasons[index]]
        )
    return "Table 1: jamming types", lines


def _environment() -> Table:
    lines = [
        ["parameter", "the paper", "paper scenario", "standard scenario", "what was open, and our choice"]
    ]

    def line(name: str, given: str, field: str, why: str = "") -> None:
        lines.append([name, given, *(_shown(scenario, field) for scenario in (PAPER, STANDARD)), why])

    line("bandwidth (MHz)", "5", "bandwidth_mhz")
    line(
        "bandwidth while spreading (MHz)",
        "2400",
        "spread_bandwidth_mhz",
        "far wider than the band of 100; enters the noise alone",
    )
    line(
        "noise density (dBm/Hz)",
        "-170 dBm",
        "noise_density_dbm_hz",
        "read as a density: times the bandwidth in use",
    )
    line("checks every (s)", "5", "check_interval_s", "standard hides when the next one comes")
    line("opponent's speed (m/s)", "10", "opponent_speed_m_s")
    line("ally's speed (m/s)", "10", "ally_speed_m_s", "the ally controls its velocity, so a range")
    line("P_base (dBm)", "45", "base_power_dbm")
    line("P_opponent (dBm)", "20", "opponent_power_dbm", "k multiplies the dBm value, as printed")
    line("M (dB)", "8", "snr_threshold_db")
    line("SNR", "Eq. 2 and 3", "snr_model", "the paper counts interference twice; standard once")
    line("detection", "SNR of the ally at least M", "detection", "standard: by the opponent's own receiver")
    line("H", "not given", "hop_cost", "hopping pays against a jammer in reach, not always")
    line("E", "not given", "distance_reward")
    line("alpha", "not given", "snr_drop_weight")
    line("fading (dB)", "Gaussian noise", "fading_sd_db", "how much is not given")
    line("SNR that rewards count (dB)", "all", "snr_cap_db", "standard: a link gains nothing above it")
    line("steps of a round", "not given", "steps_per_round", "10^7 steps over the 10^5 of the figures")
    line(
        "ally's path",
        "a Bezier curve",
        "ally_path_m",
        "the paper's control points are not given; standard draws them",
    )
    return "Table 2: the environment", lines


def _algorithm(budget: Budget) -> Table:
    defaults = inspect.signature(find_algorithm(ALGORITHM).kind).parameters
    used = {name: spec.default for name, spec in defaults.items()} | hyperparameters(budget).algorithm
    network = " x ".join(map(str, used["policy_kwargs"]["net_arch"]))
    penalty = f"{used['logit_penalty']} beyond {used['logit_limit']}"
    every = f"{budget.train_freq * budget.games} steps"
    lines = [
        ["parameter", "the paper", "in use", "what was open, and our choice"],
        ["discount factor", "0.99", str(used["gamma"]), ""],
        ["steps", "10^7", f"{budget.steps:,}", f"a tenth at most; {budget.updates():,} updates"],
        ["batch size", "32", str(used["batch_size"]), ""],
        ["learning rate", "0.001", str(used["learning_rate"]), ""],
        ["buffer capacity", "10^6", f"{used['buffer_size']:,}", ""],
        ["state dimension", "15", str(OBSERVATION_SIZE), f"which numbers is not given; {_RULES}, section 8"],
        ["action dimension", "9", str(ACTION_SIZE), f"which numbers is not given; {_RULES}, section 7"],
        ["max action value", "5", "1", "actions are in [-1, 1]; a scale of 5 has no meaning in the rules"],
        ["loss function", "MSE", "MSE", ""],
        ["networks", "not given", network, "both sides', actors and critics"],
        ["tau", "not given", str(used["tau"]), ""],
        ["exploration noise", "normal, sigma not given", str(used["noise_sd"]), "on actions in [-1, 1]"],
        ["reward scale", "not given", str(used["reward_scale"]), "rewards reach 70 per step"],
        ["logit penalty", "not given", penalty, "against actions stuck at their bounds"],
        ["random steps first", "not given", f"{used['learning_starts']:,}", ""],
        ["games at once", "1", str(budget.games), f"{budget.gradient_steps} updates every {every}"],
    ]
    return "Table 3: MADDPG", lines


def _shown(scenario: Scenario, field: str) -> str:
    value: object = getattr(scenario, field)
    if field == "ally_path_m":
        return "drawn per match" if value is None else "one, fixed"
    if isinstance(value, tuple):
        return " to ".join(f"{each:g}" for each in dict.fromkeys(value))
    return "all" if value is None else f"{value:g}" if isinstance(value, int | float) else str(value)


_TEMPLATE = Path(__file__).with_name("report.md.j2")
_CURVES = (
    "Both sides' rewards: mean over seeds (thin), moving average (thick), 2 sigma over rounds and seeds "
    "(shaded)."
)
CAPTIONS = {  # title of each figure, and what it shows
    "fig3": (
        "Fig. 3: fixed and planned paths",
        f"{_CURVES} `hill-climb` and `cma-es` have the history of `planned`; `optimised` sees the ally's "
        "path.",
    ),
    "fig4": (
        "Fig. 4: centre frequencies",
        "First, middle and last fifth of training, all runs (the paper: 0 to 50K, 47.5K to 52.5K, 95K to "
        "100K). Peaks at the band's ends are clipped frequencies. Dotted: quartiles; dot and bar: mean and "
        "standard deviation.",
    ),
    "fig5": (
        "Fig. 5: overlap ratio and jamming success rate",
        "Dots: means over a fifth of training, with the standard deviation over seeds, each measure with its "
        "own axis. Thin: means over a fortieth, which is shorter than a match.",
    ),
    "fig6": ("Fig. 6: one jamming type at a time, and all four", _CURVES),
    "fig7": (
        "Fig. 7: without the planner, without the knowledge base",
        f"{_CURVES} Without the planner the opponent learns its velocity as well.",
    ),
    "paths": (
        "Trajectories",
        "The last round after training, without noise, from above (first seed); dots: where a side starts.",
    ),
}
_PAPERS_OVERLAP = {"early": "54.46 %", "middle": "54.39 %", "late": "53.69 %"}
_Level = tuple[str, str, int, int]  # heading, column, factor, decimals
_LEVELS: tuple[_Level, ...] = (
    ("ally's reward", "ally_reward", 1, 1),
    ("opponent's reward", "opponent_reward", 1, 1),
    ("overlap ratio %", "overlap_ratio", 100, 1),
    ("jamming success rate %", "jamming_success_rate", 100, 2),
    ("hops %", "hop_rate", 100, 1),
    ("spreading %", "spread_ratio", 100, 1),
    ("within 30 m %", "near_ratio", 100, 1),
)
_SHARES = ("overlap_ratio", "jamming_success_rate", "hop_rate", "spread_ratio")
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; display: block; overflow-x: auto; margin: 1rem 0; font-size: 0.9rem; }
th, td { border-bottom: 1px solid #d0d0d0; padding: 0.3rem 0.6rem; text-align: left; vertical-align: top; }
img { max-width: 100%; }
"""


def write_report(
    results: Runs,
    preset: str,
    budget: Budget,
    drawn: Iterable[str],
    folder: Path,
    command: str,
    with_tables: bool = False,
) -> list[Path]:
    """Write ``report-<scenario>.md``, ``.html`` and ``levels-<scenario>.csv``, and return their paths.

    Args:
        results: existing runs.
        preset: name of their scenario.
        budget: their budget.
        drawn: names of the figures in ``folder/figures``.
        folder: folder of the files.
        command: command that repeats the runs.
        with_tables: true to add the paper's Tables 1 to 3, which do not depend on runs. Without runs they
            are always part of the report.
    """
    environment = Environment(undefined=StrictUndefined, keep_trailing_newline=True, autoescape=False)
    environment.filters["table"] = markdown_table
    template = environment.from_string(_TEMPLATE.read_text(encoding="utf-8"))
    text = template.render(content(results, preset, budget, drawn, with_tables), command=command)
    paths = [folder / f"report-{preset}{suffix}" for suffix in (".md", ".html")]
    write_whole(paths[0], text)
    write_whole(paths[1], _html(text, f"The paper, reproduced: {preset}"))
    if results.runs:
        paths.append(folder / f"levels-{preset}.csv")
        write_whole(paths[-1], levels_csv(results, preset))
    return paths


def content(
    results: Runs, preset: str, budget: Budget, drawn: Iterable[str] = (), with_tables: bool = False
) -> dict[str, object]:
    """Return the numbers, tables and texts of a report by their names in its template."""
    comparisons = compare(results)
    verdicts = {name: verdict([each for each in comparisons if each.claim == name]) for name in CLAIMS}
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
            *([name, statement, f"**{verdicts[name]}**"] for name, statement in CLAIMS.items()),
        ],
        "missed": [name for name, result in verdicts.items() if result not in (HOLDS, NOT_RUN)],
        "tests": tests_table(comparisons),
        "pairs": " or ".join(map(str, pairs)),
        "figures": list(drawn),
        "captions": CAPTIONS,
        "overlap": _overlap(results),
        "spread": _spread(results),
        "fifths": fifths_table(results),
        "finals": _levels(
            results, [LLM, *(each.name for each in conditions if each.tested)], (FINAL,), _LEVELS[:4]
        ),
        "differs": any(each.name in results.runs for each in sensitivity(preset)),
        "tables": tables(budget) if with_tables or not headings else [],
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
            [stage, _PAPERS_OVERLAP[stage], *(f"{_around(each, 100, 1)} %" for each in (pooled, share))]
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
            cells = [_around(results.mean(name, column, windows, seeds), *form) for _, column, *form in shown]
            lines.append([name, f"{100 * start // WINDOWS} to {100 * (start + FIFTH) // WINDOWS} %", *cells])
    return lines


def _levels(
    results: Runs, names: Iterable[str], windows: Iterable[int], columns: Sequence[_Level] = _LEVELS
) -> Lines:
    lines = [["condition", "seeds", *(heading for heading, *_ in columns)]]
    for name in names:
        if seeds := results.seeds(name):
            cells = [
                _around(results.mean(name, column, windows, seeds), *form) for _, column, *form in columns
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
                cells.append(_around(here - there, *form))
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


def _around(values: np.ndarray, factor: float, digits: int) -> str:
    """Return the mean over seeds and the half width of its 95 % interval (Student's t), as text."""
    mean = f"{factor * values.mean() + 0.0:.{digits}f}"
    return mean if len(values) < 2 else f"{mean} ± {factor * student_half(values):.{digits}f}"


def _interval(test: PairedTest) -> str:
    return f"[{_number(test.low)}, {_number(test.high)}]"


def _number(value: float) -> str:
    """Return a number with two decimals, or with two digits if it is small."""
    return f"{value + 0.0:.2f}" if abs(value) >= 1 else f"{value + 0.0:.2g}"


def _html(text: str, title: str) -> str:
    body = MarkdownIt("commonmark").enable("table").render(text)
    return (
        f'<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n<title>{html.escape(title)}</title>\n'
        f'<meta name="viewport" content="width=device-width">\n<style>{_STYLE}</style>\n{body}</html>\n'
    )
