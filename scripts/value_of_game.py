"""Bracket what the game is worth to the ally: ``python scripts/value_of_game.py docs/results/value.md``.

Reads the double oracles and self-plays beside shipped agents, ``baselines/agents/*/*/search.jsonl``, further
ones in ``searches.jsonl`` beside the page, and the lowest known returns of the board's allies. Puts the
bracket and the curve over iterations into the page between its marks, and draws ``value.svg`` beside it.

python scripts/value_of_game.py docs/results/value.md --search nash=runs/nash    keeps a finished search there
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from command import run
from lineage import ROOT, fill
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fpg_bench.common.canvas import COLOURS, GREY, MARKERS, PAGE, blank_figure, styled, write_figure
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.evaluation.table import markdown_table
from fpg_bench.players.agent import baselines_folder
from fpg_bench.products.leaderboard.board import Board, make_board
from fpg_bench.products.leaderboard.entries import load_entries
from fpg_bench.products.leaderboard.exploited import Attack
from fpg_bench.products.leaderboard.tracks import SCENARIOS, TRACKS
from fpg_bench.products.league.double_oracle import ROWS, keep_search

AGENTS = baselines_folder() / "agents"
OTHERS = "searches.jsonl"
DASHES = {"weights": "-", "nash": "--", "self-play": ":"}  # by the meta-solver; self-play had none
ENDS = {"high": COLOURS[2], "low": COLOURS[4]}  # apart in grey, too
EVEN = "uniform-hop"  # the action mode without the points by name, which are the best answer to some mixtures


def read_searches(agents: Path, page: Path) -> list[Row]:
    """Return the rows of allies' searches, with the name of each search; shipped ones first."""
    rows = []
    for file in sorted(agents.glob(f"*/*/{ROWS}")):
        rows += [{"search": file.parts[-3], **row} for row in RowFile(file).read()]
    rows += RowFile(page.with_name(OTHERS)).read()
    return [row for row in rows if row["side"] == "ally"]


def kept_by_entries(board: Board) -> dict[str, tuple[str, Attack]]:
    """Return by scenario the ally with responses that keeps most: its name, and its lowest known return."""
    kept: dict[str, tuple[str, Attack]] = {}
    for track in board.tracks:
        known = [
            (entry.plays or entry.slug, figures.exploited.lowest)
            for entry, figures in track.verified()
            if figures.exploited and figures.exploited.attacks
        ]
        if known:
            kept[TRACKS[track.key].scenario] = max(known, key=lambda each: each[1].return_per_step.value)
    return kept


def bracket(rows: Sequence[Row], kept: Mapping[str, tuple[str, Attack]]) -> list[list[str]]:
    """Return the highest known returns from below and the lowest from above, as lines of cells."""
    lines = [["scenario", "kept by an ally, at most", "left to allies that hop evenly", "left to any ally"]]
    for scenario in SCENARIOS:
        above = [row for row in rows if row["scenario"] == scenario]
        free = [row for row in above if row["actions"] != EVEN]
        best = "-"
        if scenario in kept:
            name, attack = kept[scenario]
            found_by = attack.name or attack.rival
            cost = "" if attack.seconds is None else f", {attack.seconds:,.0f} CPU s"
            best = f"{attack.return_per_step.value:.2f} (`{name}`, found by: {found_by}{cost})"
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


@styled
def draw(rows: Sequence[Row], kept: Mapping[str, tuple[str, Attack]]) -> Figure:
    """Draw low and high of each seed over the iterations and the bracket, a panel for each scenario."""
    scenarios = [scenario for scenario in SCENARIOS if any(row["scenario"] == scenario for row in rows)]
    figure = blank_figure(PAGE, 3)
    panels = figure.subplots(1, len(scenarios), squeeze=False)[0]
    for axes, scenario in zip(panels, scenarios, strict=True):
        own = [row for row in rows if row["scenario"] == scenario]
        for search, seed in dict.fromkeys((row["search"], row["seed"]) for row in own):
            _lines(axes, [row for row in own if (row["search"], row["seed"]) == (search, seed)])
        if scenario in kept:
            ends = kept[scenario][1].return_per_step.value, min(row["high"] for row in own)
            label = "from kept to left, as in the table"
            axes.axhspan(*ends, color=GREY, alpha=0.4, lw=0, zorder=0, label=label)
        axes.set_title(scenario)
        axes.set_xlabel("iteration")
        axes.xaxis.get_major_locator().set_params(integer=True)
    panels[0].set_ylabel("ally's return per step")
    for name, colour in ENDS.items():
        panels[0].plot([], [], color=colour, marker="", lw=3, label=name)
    for solver in dict.fromkeys(map(_solver, rows)):
        name = "double oracle" if solver == "weights" else solver
        panels[0].plot([], [], color=GREY, marker="", ls=DASHES[solver], lw=1, label=name)
    for seed in sorted({row["seed"] for row in rows}):
        panels[0].plot([], [], color=GREY, marker=MARKERS[seed], ls="", label=f"seed {seed}")
    known = dict(zip(*reversed(panels[0].get_legend_handles_labels()), strict=True))
    figure.legend(known.values(), known, loc="outside lower center", ncols=4)
    return figure


def _solver(row: Row) -> str:
    """Return the meta-solver of a row's search; of one without, its verb."""
    return str(row.get("meta_solver", row["verb"]))


def _lines(axes: Axes, rows: Sequence[Row]) -> None:
    iterations = [row["iteration"] for row in rows]
    marker, dashes = MARKERS[rows[0]["seed"]], DASHES[_solver(rows[0])]
    for name, colour in ENDS.items():
        axes.plot(iterations, [row[name] for row in rows], color=colour, marker=marker, ls=dashes, lw=1)
    later = [row for row in rows if row["confirmed"] is not None]
    second = [row["confirmed"] for row in later]
    axes.plot([row["iteration"] for row in later], second, "kx", ms=5, label="low by a second response")


def main(page: Path, search: list[str] = [], agents: Path = AGENTS) -> None:  # noqa: B006
    """Keep searches, put the tables into the page, and draw the figure."""
    for word in search:
        name, _, folder = word.partition("=")
        keep_search(Path(folder), page.with_name(OTHERS), name)
    rows = read_searches(agents, page)
    picture = page.with_suffix(".svg")
    kept = kept_by_entries(make_board(load_entries(ROOT / "leaderboard")))
    write_figure(draw(rows, kept), picture)
    table = markdown_table(bracket(rows, kept))
    shown = f"![Low and high over the iterations of each search]({picture.name})"
    fill(page, {"value": f"{table}\n\n{shown}"})


if __name__ == "__main__":
    run(main)
