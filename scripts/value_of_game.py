"""Bracket what the game is worth to the ally: ``python scripts/value_of_game.py docs/results/value.md``.

Reads the double oracles and self-plays beside shipped agents, ``baselines/agents/*/*/search.jsonl``, further
ones in ``searches.jsonl`` beside the page, and what entries of the board keep against responses. Puts the
bracket into the page between its marks, and draws the iterations as ``value.svg`` beside it.

python scripts/value_of_game.py docs/results/value.md --search nash=runs/nash    keeps a finished search there
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from lineage import fill
from make_diagrams import write
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fpg_bench.common.canvas import ALLY, OPPONENT, Style, blank_figure
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_yaml
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.evaluation.table import markdown_table
from fpg_bench.players.agent import baselines_folder
from fpg_bench.products.leaderboard.folders import submission_folders
from fpg_bench.products.leaderboard.response_recipe import OWN, RECIPE
from fpg_bench.products.leaderboard.response_results import ResponseResult, result_store
from fpg_bench.products.leaderboard.tracks import SCENARIOS
from fpg_bench.products.league.search import ROWS, keep_search

OTHERS = "searches.jsonl"
DASHES = {"weights": "-", "nash": "--", "self-play": ":"}  # by the meta-solver, or by the verb without one
EVEN = "uniform-hop"  # the action mode without the points by name, which are the best answer to some mixtures


@dataclass(frozen=True)
class Kept:
    """Bound of what a policy of the ally keeps per step: its lowest return against responses to it."""

    scenario: str
    name: str
    part: str
    value: float
    responses: int
    steps: int

    def __str__(self) -> str:
        policy = ", ".join(filter(None, (f"`{self.name}`", self.part)))
        count = f"{self.responses} response{'s' if self.responses > 1 else ''}"
        return f"{self.value:.2f} ({policy}, {count} of {self.steps:,} steps)"


def read_searches(agents: Path, page: Path) -> list[Row]:
    """Return the rows of allies' searches, with the name of each search; shipped ones first."""
    rows = []
    for file in sorted(agents.glob(f"*/*/{ROWS}")):
        rows += [{"search": file.parts[-3], **row} for row in RowFile(file).read()]
    rows += RowFile(page.with_name(OTHERS)).read()
    return [row for row in rows if row["side"] == "ally"]


def kept_by_policies(rows: Sequence[Row], board: Path) -> Iterator[Kept]:
    """Yield what is kept by each policy that a response was trained for once it was chosen.

    These are iterations with a second response, since ``low`` chose them and is too high by its noise, and
    the training seeds of entries that the board's recipe answers. The exported iteration of a search is a
    training seed of the entry of its name, where there is one.
    """
    entered = dict(entered_policies(board))
    finalists = [row for row in rows if row["confirmed"] is not None]
    exported = {
        (row["search"], row["seed"]): row for row in sorted(finalists, key=lambda row: row["confirmed"])
    }
    for row in finalists:
        values, name = [row["confirmed"], *([row["low"]] if _solver(row) != "nash" else [])], row["search"]
        if exported[name, row["seed"]] is row:
            values += entered.pop((name, row["seed"]), ("", [], True))[1]
        part = f"seed {row['seed']}, iteration {row['iteration']}"
        yield Kept(row["scenario"], name, part, min(values), len(values), row["response_steps"])
    for (name, seed), (scenario, values, is_answered) in entered.items():
        if is_answered:
            part = "" if seed is None else f"seed {seed}"
            yield Kept(scenario, name, part, min(values), len(values), RECIPE.steps)


def entered_policies(board: Path) -> Iterator[tuple[tuple[str, int | None], tuple[str, list[float], bool]]]:
    """Yield each policy of an ally with responses on the board, as its entry's name and its training seed.

    With it come its scenario, its returns per step, and whether the recipe has a response to it.

    Raises:
        UserError: an entry's responses have not played all its training seeds.
    """
    found: dict[str, list[ResponseResult]] = {}
    for result in result_store(board).records():
        found.setdefault(f"{result.track}/{result.slug}", []).append(result)
    for folder in submission_folders(board):
        results = found.get(f"{folder.parent.name}/{folder.name}", [])
        if results and folder.parent.name == "ally":
            about = read_yaml(folder / "submission.yaml", "submission")
            seeds = (about.get("training") or {}).get("seeds", [None])
            if any(len(result.rewards) != len(seeds) for result in results):
                name = f"ally/{folder.name}"
                raise UserError(f"{name}: it has changed; fpg-bench leaderboard verify --update {name}")
            answered = {
                number % len(seeds)
                for number in range(RECIPE.n_responses)
                if any(result.response == f"{OWN}{number}" for result in results)
            }
            for index, seed in enumerate(seeds):
                values = [result.rewards[index] for result in results]
                scenario = about.get("scenario", "standard")
                yield (folder.name, seed), (scenario, values, index in answered)


def bracket(rows: Sequence[Row], kept: Sequence[Kept]) -> list[list[str]]:
    """Return the highest known returns from below and the lowest from above, as lines of cells."""
    lines = [["scenario", "kept by an ally", "left to allies that hop evenly", "left to any ally"]]
    for scenario in SCENARIOS:
        below = [one for one in kept if one.scenario == scenario]
        above = [row for row in rows if row["scenario"] == scenario]
        free = [row for row in above if row["actions"] != EVEN]
        best = str(max(below, key=lambda one: one.value)) if below else "-"
        lines.append([f"`{scenario}`", best, _lowest(above), _lowest(free)])
    return lines


def _lowest(rows: Sequence[Row]) -> str:
    """Return the lowest ``high``, with the iteration that earned it and its steps so far."""
    if not rows:
        return "-"
    row = min(rows, key=lambda row: row["high"])
    steps = row["steps"] * (row["iteration"] + 1)
    at = f"seed {row['seed']}, iteration {row['iteration']}"
    return f"{row['high']:.2f} (`{row['search']}`, {at}, {steps:,} steps)"


def draw(rows: Sequence[Row]) -> Figure:
    """Draw low and high of each seed over the iterations, a panel for each scenario."""
    scenarios = [scenario for scenario in SCENARIOS if any(row["scenario"] == scenario for row in rows)]
    figure = blank_figure(8.6, 3.2)
    panels = figure.subplots(1, len(scenarios), squeeze=False)[0]
    for axes, scenario in zip(panels, scenarios, strict=True):
        own = [row for row in rows if row["scenario"] == scenario]
        for search, seed in dict.fromkeys((row["search"], row["seed"]) for row in own):
            _lines(axes, [row for row in own if (row["search"], row["seed"]) == (search, seed)])
        axes.set_title(scenario)
        axes.set_xlabel("iteration")
        axes.xaxis.get_major_locator().set_params(integer=True)
    panels[0].set_ylabel("ally's return per step")
    known = {
        label: handle
        for axes in panels
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(known.values(), known, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _solver(row: Row) -> str:
    """Return the meta-solver of a row's search; of one without, its verb."""
    solver: str = row.get("meta_solver", row["verb"])
    return solver


def _lines(axes: Axes, rows: Sequence[Row]) -> None:
    iterations, solver = [row["iteration"] for row in rows], _solver(rows[0])
    style: Style = {"lw": 1.4, "alpha": 0.8, "ls": DASHES[solver]}
    for name, color in (("high", OPPONENT), ("low", ALLY)):
        label = name if solver == "weights" else f"{name}, {solver}"
        axes.plot(iterations, [row[name] for row in rows], color=color, label=label, **style)
    later = [row for row in rows if row["confirmed"] is not None]
    axes.plot(
        [row["iteration"] for row in later],
        [row["confirmed"] for row in later],
        "o",
        color=ALLY,
        ms=4,
        label="a second response",
    )


def main() -> None:
    """Keep searches, put the tables into the page, and draw the figure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("page", type=Path, help="the page that the tables are put into")
    text = "NAME=FOLDER of a finished search whose rows are kept beside the page"
    parser.add_argument("--search", action="append", default=[], metavar="NAME=FOLDER", help=text)
    parser.add_argument("--board", type=Path, default=Path("leaderboard"), help="the leaderboard's folder")
    parser.add_argument("--agents", type=Path, help="folder of the shipped agents; default: baselines/agents")
    options = parser.parse_args()
    for word in options.search:
        name, _, folder = word.partition("=")
        keep_search(Path(folder), options.page.with_name(OTHERS), name)
    rows = read_searches(options.agents or baselines_folder() / "agents", options.page)
    kept = list(kept_by_policies(rows, options.board))
    parts = [markdown_table(bracket(rows, kept))]
    if rows:
        picture = options.page.with_suffix(".svg")
        write(draw(rows), picture)
        parts.append(f"![Low and high over the iterations of each search]({picture.name})")
    fill(options.page, {"value": "\n\n".join(parts)})


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"value_of_game: {error}")
