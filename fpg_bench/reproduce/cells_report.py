"""What the trained readings say: each claim under each of them, as a page and a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fpg_bench.files import write_whole
from fpg_bench.pictures.canvas import blank_figure
from fpg_bench.reproduce.cells import FIGURES, cells, results_of
from fpg_bench.reproduce.claims import ASPECTS, Comparison, aspect_of, compare, verdict
from fpg_bench.reproduce.curve import HELD, OPEN, OPPOSITE
from fpg_bench.reproduce.experiment import BUDGETS, Budget
from fpg_bench.reproduce.figures import save_figure
from fpg_bench.reproduce.readings import Reading
from fpg_bench.reproduce.report import markdown_table
from fpg_bench.reproduce.results import Results

Found = Mapping[str, Sequence[Comparison]]  # of one reading, by aspect
_FROZEN = "D1 frozen"
_COLUMNS = (_FROZEN, *(name for name in ASPECTS if name != "D1"))
_HEAD = """\
# The paper's claims under the readings that decide: trained players

Both sides learned by MADDPG under each reading: {steps:,} game steps and {updates:,} updates a run, where the
paper makes {paper:,} of both. That is the deviation that is left. Training seeds are {seeds}, which no
earlier look has used. The first reading is the one under which most patterns appear between scripted players
([the screen](screen.md)); each of the others but the letter settles one point of it otherwise. How claims are
tested stands in [the paper, reproduced](../reproduction.md#how-claims-are-tested).

"""


def write_cells(results: Results, budget: Budget, out: Path, command: str) -> list[Path]:
    """Write ``cells.md`` and ``figures/cells``, of the readings whose runs are there.

    Args:
        results: the runs, by the names of :func:`fpg_bench.reproduce.cells.every_condition`.
        budget: theirs.
        out: the folder.
        command: what makes all of it again.

    Returns:
        The files; none where no run is there.
    """
    found = {reading: _by_aspect(results_of(reading, results)) for reading in cells()}
    found = {reading: each for reading, each in found.items() if each}
    if not found:
        return []
    written = save_figure(_drawn(found), out / "figures" / "cells")
    seeds = sorted({seed for each in results.runs.values() for seed in each})
    told = {"steps": budget.steps, "updates": budget.updates(), "paper": BUDGETS["paper"].steps}
    head = _HEAD.format(**told, seeds=f"{seeds[0]} to {seeds[-1]}")
    parts = {
        "What comes out": _verdicts(found) + "\n\n![Each claim's weakest part](figures/cells.png)",
        "Part by part": _parts(found),
        "How it was made": f"```bash\n{command}\n```",
    }
    text = head + "\n\n".join(f"## {title}\n\n{body}" for title, body in parts.items()) + "\n"
    write_whole(out / "cells.md", text)
    return [*written, out / "cells.md"]


def _by_aspect(results: Results) -> dict[str, list[Comparison]]:
    found: dict[str, list[Comparison]] = {}
    for comparison in compare(results):
        found.setdefault(aspect_of(comparison), []).append(comparison)
    return found


def _verdicts(found: Mapping[Reading, Found]) -> str:
    lines = [["reading", *_COLUMNS]]
    for reading, by_aspect in found.items():
        verdicts = [verdict(list(by_aspect.get(name, ()))) for name in _COLUMNS]
        lines.append([f"`{reading.name}`", *verdicts])
    return markdown_table(lines)


def _parts(found: Mapping[Reading, Found]) -> str:
    lines = [["reading", "claim", "claimed to be positive", "measured", "95 % interval", "p", "by itself"]]
    for reading, by_aspect in found.items():
        for name in _COLUMNS:
            for each in by_aspect.get(name, ()):
                low, high = (f"{value:.3g}" for value in (each.found.low, each.found.high))
                numbers = [f"{each.found.mean:.3g}", f"[{low}, {high}]", f"{each.found.p:.3f}"]
                lines.append([f"`{reading.name}`", name, each.statement, *numbers, each.verdict])
    return markdown_table(lines)


def _drawn(found: Mapping[Reading, Found]) -> Any:
    """A panel a claim, a line a reading: the part that is furthest from holding, with its 95 % interval."""
    figure = blank_figure(2.4 * len(_COLUMNS) + 4, 1.2 + 0.36 * len(found))
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
    shown = [_difference(reading) for reading in found]
    panels[0].set_yticks(range(len(found)), shown, fontsize=8)
    panels[0].invert_yaxis()
    return figure


def _size(comparison: Comparison) -> float:
    found = comparison.found
    return found.mean / max(found.high - found.mean, 1e-12)


def _difference(reading: Reading) -> str:
    """Where a reading departs from the first one."""
    if reading == FIGURES:
        return "figures: " + reading.name.replace(",", "\n")
    other = [f"{point}={setting}" for point, setting in reading.items if FIGURES.of(point) != setting]
    return "letter" if len(other) > 1 else other[0]
