"""What the trained cells say: each claim under each of them, as a page and a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fpg_bench.common.files import write_whole
from fpg_bench.game.scenario import as_scenario
from fpg_bench.paper.cells import CELLS, FIGURES, LOW_NOISE, NEEDED, PRESET, Cell
from fpg_bench.paper.claims import ASPECTS, Comparison, aspect_of, compare, verdict
from fpg_bench.paper.curve import HELD, OPEN, OPPOSITE
from fpg_bench.paper.experiment import BUDGETS, Budget, hyperparameters
from fpg_bench.paper.figures import save_figure
from fpg_bench.paper.report import markdown_table
from fpg_bench.paper.runs import Results
from fpg_bench.rendering.canvas import blank_figure

Found = Mapping[str, list[Comparison]]  # of one cell, by aspect
_FROZEN = "D1 frozen"
_COLUMNS = (_FROZEN, *(name for name in ASPECTS if name != "D1"))
_FIRST = Cell(FIGURES, tuple(ASPECTS))  # trained as a scenario of its own
_HEAD = """\
# The paper's claims under the readings that decide: trained players

Both sides learned by MADDPG under each reading: {steps:,} game steps and {updates:,} updates a run, where the
paper makes {paper:,} of both. That is the deviation that is left. Training seeds are {seeds}.{missing}

`figures` is the preset under which most claims come out between scripted players ([the screen](screen.md)).
Each of the other readings but the letter settles one point of it otherwise. They are those under which the
screen finds that a claim turns. Only the runs of that claim were trained. Two readings change the noise of
exploration, which the screen does not have. Under the other neighbours of `figures` no claim turns between
scripts, so nothing was trained there. (With H = 100 the ally no longer stays above the opponent. But an ally
that hops in each step pays H in each step. So that game is the same but for a hundred a step.)

`noise={noise}`: exploration with a standard deviation of {noise} on all actions of both sides, in place of
{usual}. On the jammer's frequency that is {noise_mhz:g} MHz instead of {usual_mhz:g}, less than a tone's half
width. How claims are tested stands in [the paper, reproduced](../reproduction.md#how-claims-are-tested).
Readings are not corrected for how many there are.

"""


def write_cells(
    first: Results, results: Results, seeds: range, budget: Budget, out: Path, commands: Sequence[str]
) -> list[Path]:
    """Write ``cells.md`` and ``figures/cells``, of the cells whose runs are there.

    Args:
        first: the runs of the scenario ``figures``.
        results: those of the cells, by the names of :func:`fpg_bench.paper.cells.every_condition`.
        seeds: of training; a condition counts where all of them are there.
        budget: that of the runs.
        out: the folder.
        commands: what makes all of it again.

    Returns:
        The files; none where no run is there.
    """
    found = {_FIRST: judged(first, seeds), **{cell: judged(cell.results(results), seeds) for cell in CELLS}}
    found = {cell: each for cell, each in found.items() if each}
    if not found:
        return []
    written = save_figure(_drawn(found), out / "figures" / "cells")
    parts = {
        "What comes out": _verdicts(found) + "\n\n![Each claim's weakest part](figures/cells.png)",
        "Part by part": _parts(found),
        "How it was made": "```bash\n" + "\n".join(commands) + "\n```",
    }
    text = "\n\n".join(f"## {title}\n\n{body}" for title, body in parts.items())
    write_whole(out / "cells.md", _head(results, seeds, budget) + text + "\n")
    return [*written, out / "cells.md"]


def _head(results: Results, seeds: range, budget: Budget) -> str:
    missing = _missing(results, seeds)
    usual, span_mhz = hyperparameters(budget).algorithm["noise_sd"], as_scenario(PRESET).tuning_span_mhz
    return _HEAD.format(
        steps=budget.steps,
        updates=budget.updates(),
        paper=BUDGETS["paper"].steps,
        seeds=f"{seeds[0]} to {seeds[-1]}",
        missing=f"\nPlanned and not trained yet: {', '.join(missing)}." if missing else "",
        noise=LOW_NOISE,
        noise_mhz=LOW_NOISE * span_mhz,
        usual=usual,
        usual_mhz=usual * span_mhz,
    )


def _missing(results: Results, seeds: range) -> list[str]:
    """The conditions of cells that lack a run."""
    return [
        f"`{_difference(cell)}: {condition.name.rpartition(': ')[2]}`"
        for cell in CELLS
        for condition in cell.conditions
        if results.seeds(condition.name) != list(seeds)
    ]


def judged(results: Results, seeds: range) -> dict[str, list[Comparison]]:
    """The tests of each claim whose runs are all there, with all of these seeds."""
    there = {name for name in results.runs if results.seeds(name) == list(seeds)}
    found: dict[str, list[Comparison]] = {}
    for comparison in compare(results):
        name = aspect_of(comparison)
        if set(NEEDED[name.removesuffix(" frozen")]) <= there:
            found.setdefault(name, []).append(comparison)
    return found


def _verdicts(found: Mapping[Cell, Found]) -> str:
    lines = [["reading", *_COLUMNS]]
    for cell, by_aspect in found.items():
        told = (verdict(by_aspect[name]) if name in by_aspect else "-" for name in _COLUMNS)
        lines.append([_title(cell), *told])
    return markdown_table(lines)


def _parts(found: Mapping[Cell, Found]) -> str:
    lines = [["reading", "claim", "claimed to be positive", "measured", "95 % interval", "p", "by itself"]]
    for cell, by_aspect in found.items():
        for name in _COLUMNS:
            for each in by_aspect.get(name, ()):
                low, high = (f"{value:.3g}" for value in (each.found.low, each.found.high))
                numbers = [f"{each.found.mean:.3g}", f"[{low}, {high}]", f"{each.found.p:.3f}"]
                lines.append([_title(cell), name, each.statement, *numbers, each.verdict])
    return markdown_table(lines)


def _drawn(found: Mapping[Cell, Found]) -> Any:
    """A panel a claim, a line a cell: the part that is furthest from holding, with its 95 % interval."""
    figure = blank_figure(2.4 * len(_COLUMNS) + 4, 1.4 + 0.36 * len(found))
    panels = figure.subplots(1, len(_COLUMNS), sharey=True)
    for axes, name in zip(panels, _COLUMNS, strict=True):
        for line, by_aspect in enumerate(found.values()):
            if parts := by_aspect.get(name):
                weakest = min(parts, key=_size).found
                colour = HELD if weakest.low > 0 else OPPOSITE if weakest.high < 0 else OPEN
                half = weakest.mean - weakest.low
                axes.errorbar(weakest.mean, line, xerr=half, fmt="o", ms=4, color=colour, capsize=2)
        axes.axvline(0, color="black", lw=0.8)
        axes.set_title(name, fontsize=10)
        axes.tick_params(labelsize=8)
        axes.locator_params(axis="x", nbins=5)
        axes.margins(y=0.15)
        axes.spines["right"].set_visible(False)
    figure.supxlabel(
        "the part that is furthest from holding: reward a step (D2: a share), 95 % interval", size=9
    )
    panels[0].set_yticks(range(len(found)), map(_difference, found), fontsize=8)
    panels[0].invert_yaxis()
    return figure


def _size(comparison: Comparison) -> float:
    found = comparison.found
    return found.mean / max(found.high - found.mean, 1e-12)


def _title(cell: Cell) -> str:
    return f"`{_difference(cell)}`"


def _difference(cell: Cell) -> str:
    """Where a cell departs from the first one."""
    settled = cell.reading.items
    other = [f"{point}={setting}" for point, setting in settled if FIGURES.of(point) != setting]
    told = ["letter"] if len(other) > 1 else other
    told += [] if cell.noise_sd is None else [f"noise={cell.noise_sd}"]
    return ", ".join(told) or "figures"
