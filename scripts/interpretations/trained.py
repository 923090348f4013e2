"""Trained variants: MADDPG under the interpretations for which the scripted screen says that a claim changes.

They are compared with the preset ``figures``, under which most claims hold between scripts. A variant is one
of its neighbours, which resolve one point differently, or the paper as printed. Only the conditions of the
affected claims are trained. Exploration noise is varied as well: noise of 5 MHz on the jamming frequency
hides a tone, whose half width is 2.5 MHz."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fpg_bench.common.files import write_whole
from fpg_bench.common.parallel import check_all_done
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import as_scenario
from fpg_bench.paper.claims import ASPECTS, Comparison, aspect_of, compare, verdict
from fpg_bench.paper.conditions import BASE, NO_KNOWLEDGE, NO_PLANNER, Condition, conditions_of
from fpg_bench.paper.experiment import BUDGETS, Budget, hyperparameters
from fpg_bench.paper.figures import save_figure
from fpg_bench.paper.report import markdown_table
from fpg_bench.paper.reproduce import check_same_game, run_conditions
from fpg_bench.paper.runs import Results, RunFile, read_results
from fpg_bench.rendering.canvas import blank_figure
from fpg_bench.training.maddpg.multi_seed import LEARNERS, check_learner
from scripts.interpretations.interpretations import AS_PRINTED, Interpretation, parse_interpretation
from scripts.interpretations.screen import HOLDS, OPEN, REVERSED

NAME = "trained-variants"
PRESET = "paper"  # base of all interpretations
FIGURES = parse_interpretation("interference=once,hops=always,hop-cost=0,memory=for-ever")
LOW_NOISE = 0.04  # on actions in [-1, 1]: 2 MHz of the jammer's frequency
# Conditions to be trained for a claim; D1 is tested on frozen pairs.
NEEDED: Mapping[str, tuple[str, ...]] = {
    "D1": (BASE,),
    "D2": (BASE,),
    "D3 level": JAMMING_TYPES,
    "D3 order": JAMMING_TYPES,
    "D4 knowledge": (BASE, NO_KNOWLEDGE),
    "D4 planner": (BASE, NO_PLANNER),
}


@dataclass(frozen=True)
class Variant:
    """An interpretation, the claims tested under it, and the exploration noise if it is not the default."""

    interpretation: Interpretation
    claims: tuple[str, ...]
    noise_sd: float | None = None

    @property
    def name(self) -> str:
        """Name of the interpretation, with the noise if it differs."""
        noise = "" if self.noise_sd is None else f",noise={self.noise_sd}"
        return f"{self.interpretation.name}{noise}"

    @property
    def title(self) -> str:
        """Difference from the preset ``figures``."""
        differences = ["=".join(item) for item in self.interpretation.differences(FIGURES)]
        differences = [AS_PRINTED] if len(differences) > 1 else differences
        differences += [] if self.noise_sd is None else [f"noise={self.noise_sd}"]
        return ", ".join(differences) or "figures"

    @property
    def conditions(self) -> list[Condition]:
        """Conditions to be trained, prefixed with the name of the variant."""
        known = {condition.name: condition for condition in conditions_of("all", PRESET, full=False)}
        changes = self.interpretation.changes | {"rounds_per_match": self.interpretation.rounds}
        algorithm = {} if self.noise_sd is None else {"noise_sd": self.noise_sd}
        return [
            replace(
                known[name],
                name=f"{self.name}: {name}",
                changes=changes | dict(known[name].changes),
                algorithm=algorithm,
            )
            for name in dict.fromkeys(name for claim in self.claims for name in NEEDED[claim])
        ]

    def results(self, results: Results) -> Results:
        """Return the runs of this variant, by the original names of their conditions."""
        names = {name.removeprefix(f"{self.name}: "): name for name in results.runs}
        names = {short: name for short, name in names.items() if short != name}
        return Results(
            {short: results.runs[name] for short, name in names.items()},
            {short: results.about[name] for short, name in names.items()},
        )


# The claims of a variant change between scripts; a test compares this with the rows of the screen. H = 100
# changes D3's level as well, but if each step is a hop, H only takes 100 from the ally's reward.
VARIANTS = (
    Variant(parse_interpretation(AS_PRINTED), tuple(NEEDED)),
    Variant(FIGURES.replace({"memory": "match"}), ("D1", "D2", "D4 planner")),
    Variant(FIGURES.replace({"hops": "gated"}), ("D2", "D4 knowledge")),
    Variant(FIGURES.replace({"interference": "twice"}), ("D2", "D3 order")),
    Variant(FIGURES, ("D3 order",), LOW_NOISE),
    Variant(parse_interpretation(AS_PRINTED), ("D3 order",), LOW_NOISE),
)


def all_conditions() -> list[Condition]:
    """Return the conditions of all variants, in the order of training."""
    return [condition for variant in VARIANTS for condition in variant.conditions]


_Tests = dict[str, dict[str, list[Comparison]]]  # by title of the variant and claim
_COLUMNS = ("D1 frozen", *(name for name in ASPECTS if name != "D1"))
_FIRST = Variant(FIGURES, tuple(ASPECTS))  # trained as a scenario of its own
_PAGE = """\
# The paper's claims under the interpretations that decide: trained players

Both sides learned by MADDPG under each interpretation, with {steps:,} game steps and {updates:,} updates per
run; the paper uses {paper:,} of both. This is the remaining deviation. Training seeds are {seeds}.{missing}

`figures` is the preset under which most claims hold between scripted players ([the screen](screen.md)). Each
of the other interpretations, except the paper as printed, resolves one of its points differently. These are
the ones under which the screen finds that a claim changes, and only the runs of that claim were trained. Two
of them change the exploration noise, which the screen does not have. Under the other neighbours of `figures`
no claim changes between scripts, so nothing was trained there. (With H = 100 the ally no longer stays above
the opponent. But an ally that hops in each step pays H in each step, so that game differs by a constant of a
hundred per step.)

`noise={noise}`: exploration with a standard deviation of {noise} on all actions of both sides, instead of
{usual}. On the jamming frequency this is {noise_mhz:g} MHz instead of {usual_mhz:g} MHz, less than the half
width of a tone. [The paper, reproduced](../reproduction.md#how-claims-are-tested) explains how claims are
tested. There is no correction for the number of interpretations.

## Which claims hold

{verdicts}

![Each claim's weakest part](figures/trained-variants.png)

## Part by part

{parts}

## How it was made

```bash
fpg-bench reproduce all --scenario figures {options}
python -m scripts.interpretations trained {options}
```
"""


def train_variants(
    out: Path, budget: str, n_seeds: int | None, first_seed: int, learner: str = LEARNERS[0], n_jobs: int = 2
) -> list[Path]:
    """Train all variants, and write ``trained-variants.md`` with its figure.

    The runs of the scenario ``figures`` with the same budget are read from the same folder; they are made by
    ``fpg-bench reproduce all --scenario figures``.

    Args:
        out: folder of runs, page and figure; finished runs are kept.
        budget: name of a budget.
        n_seeds: number of training seeds; None: the default of the budget.
        first_seed: first training seed.
        learner: ``torch`` or ``jax``.
        n_jobs: number of processes.

    Returns:
        The files written.

    Raises:
        UserError: runs of another game, or failed runs (the others are kept).
    """
    check_learner(learner)
    length, file, figures = BUDGETS[budget], RunFile(out, NAME, budget), RunFile(out, "figures", budget)
    seeds = range(first_seed, first_seed + (n_seeds or length.seeds))
    standard = conditions_of("all", "figures", full=False)
    for condition in standard:
        check_same_game(figures, condition, "figures")
    failed = run_conditions(file, all_conditions(), PRESET, length, seeds, learner=learner, n_jobs=n_jobs)
    first, results = (
        read_results(runs, {name: seeds for condition in conditions for name in condition.runs})
        for runs, conditions in ((figures, standard), (file, all_conditions()))
    )
    options = f"--budget {budget} --n-seeds {len(seeds)}"
    options += f" --first-seed {first_seed}" if first_seed else ""
    options += f" --learner {learner}" if learner != LEARNERS[0] else ""
    written = write_variants(first, results, seeds, length, out, options)
    check_all_done(failed)
    return written


def write_variants(
    first: Results, results: Results, seeds: range, budget: Budget, out: Path, options: str
) -> list[Path]:
    """Write ``trained-variants.md`` and its figure, and return the files; none without runs.

    Args:
        first: runs of the scenario ``figures``.
        results: runs of the variants, by the names of :func:`all_conditions`.
        seeds: training seeds; conditions that lack one of them are left out.
        budget: budget of the runs.
        out: folder of page and figure.
        options: of the commands that repeat the runs.
    """
    runs = {_FIRST: first, **{variant: variant.results(results) for variant in VARIANTS}}
    tests = {
        variant.title: by_claim for variant, each in runs.items() if (by_claim := claim_tests(each, seeds))
    }
    if not tests:
        return []
    missing = [
        f"`{variant.title}: {condition.name.rpartition(': ')[2]}`"
        for variant in VARIANTS
        for condition in variant.conditions
        if results.seeds(condition.name) != list(seeds)
    ]
    usual, span_mhz = hyperparameters(budget).algorithm["noise_sd"], as_scenario(PRESET).tuning_span_mhz
    text = _PAGE.format(
        steps=budget.steps,
        updates=budget.updates(),
        paper=BUDGETS["paper"].steps,
        seeds=f"{seeds[0]} to {seeds[-1]}",
        missing=f"\nPlanned and not trained yet: {', '.join(missing)}." if missing else "",
        noise=LOW_NOISE,
        noise_mhz=LOW_NOISE * span_mhz,
        usual=usual,
        usual_mhz=usual * span_mhz,
        verdicts=_verdicts(tests),
        parts=_parts(tests),
        options=options,
    )
    write_whole(out / f"{NAME}.md", text)
    return [*save_figure(_draw(tests), out / "figures" / NAME), out / f"{NAME}.md"]


def claim_tests(results: Results, seeds: range) -> dict[str, list[Comparison]]:
    """Return the tests of each claim whose runs exist for all seeds."""
    complete = {name for name in results.runs if results.seeds(name) == list(seeds)}
    tests: dict[str, list[Comparison]] = {}
    for comparison in compare(results):
        name = aspect_of(comparison)
        if set(NEEDED[name.removesuffix(" frozen")]) <= complete:
            tests.setdefault(name, []).append(comparison)
    return tests


def _verdicts(tests: _Tests) -> str:
    lines = [["interpretation", *_COLUMNS]]
    for title, by_claim in tests.items():
        verdicts = (verdict(by_claim[name]) if name in by_claim else "-" for name in _COLUMNS)
        lines.append([f"`{title}`", *verdicts])
    return markdown_table(lines)


def _parts(tests: _Tests) -> str:
    lines = [
        ["interpretation", "claim", "claimed to be positive", "measured", "95 % interval", "p", "by itself"]
    ]
    for title, by_claim in tests.items():
        for name in _COLUMNS:
            for each in by_claim.get(name, ()):
                test = each.test
                mean, low, high = (f"{value:.3g}" for value in (test.mean, test.low, test.high))
                numbers = [mean, f"[{low}, {high}]", f"{test.p:.3f}"]
                lines.append([f"`{title}`", name, each.statement, *numbers, each.verdict])
    return markdown_table(lines)


def _draw(tests: _Tests) -> Any:
    """Draw a panel per claim: each variant's part with the lowest mean in half widths of its interval."""
    figure = blank_figure(2.4 * len(_COLUMNS) + 4, 1.4 + 0.36 * len(tests))
    panels = figure.subplots(1, len(_COLUMNS), sharey=True)
    for axes, name in zip(panels, _COLUMNS, strict=True):
        for line, by_claim in enumerate(tests.values()):
            if parts := [each.test for each in by_claim.get(name, ())]:
                weakest = min(parts, key=lambda test: test.mean / max(test.high - test.mean, 1e-12))
                colour = HOLDS if weakest.low > 0 else REVERSED if weakest.high < 0 else OPEN
                half = weakest.mean - weakest.low
                axes.errorbar(weakest.mean, line, xerr=half, fmt="o", ms=4, color=colour, capsize=2)
        axes.axvline(0, color="black", lw=0.8)
        axes.set_title(name, fontsize=10)
        axes.tick_params(labelsize=8)
        axes.locator_params(axis="x", nbins=5)
        axes.margins(y=0.15)
        axes.spines["right"].set_visible(False)
    label = "the part that is furthest from holding: reward per step (D2: a share), 95 % interval"
    figure.supxlabel(label, size=9)
    panels[0].set_yticks(range(len(tests)), tests, fontsize=8)
    panels[0].invert_yaxis()
    return figure
