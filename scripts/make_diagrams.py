"""Draw the diagrams of the documentation: ``python scripts/make_diagrams.py docs/pictures``.

``system.svg``, ``detection.svg`` and ``seasons.svg`` show the rules and the protocol; ``waterfall.svg`` a
round and what the ally's waterfall shows of it; ``crossplay.svg`` the board's cross-play in ``standard``;
``clones.svg`` a round of a team whose allies choose alike.
"""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import cast

import gymnasium
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

import fpg_bench  # noqa: F401  registers the ids
from fpg_bench.common.canvas import ALLY, OPPONENT, PAGE, blank_figure, styled, write_figure
from fpg_bench.envs.gymnasium_env import FPGEnv
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.recording import Recording
from fpg_bench.game.scenario import STANDARD
from fpg_bench.products.leaderboard.board import make_board
from fpg_bench.products.leaderboard.entries import load_entries
from fpg_bench.products.teams.picture import TeamPicture
from fpg_bench.products.teams.watching import record_team

ROOT = Path(__file__).parents[1]
INK, GREY = "#1d2733", "#5b6673"
BAND_MHZ = STANDARD.band_low_mhz, STANDARD.band_high_mhz
STEPS = 60  # of the round in waterfall.svg
FIRST = 8  # entries of each side in crossplay.svg: the highest means
CLONE = "ally-link/ppo-stack8/seed_0"
Place = tuple[float, float]


def system() -> Figure:
    """Draw who sends, hears and jams what in a step."""
    figure, axes = canvas(2.75)
    boxes = {
        "base": ((1.15, 1.5), "base station", INK),
        "ally": ((4.2, 2.6), "ally UAV\nhop, spread, speed", ALLY),
        "knowledge": ((7.6, 2.6), "expert knowledge base\nwhich points are free", ALLY),
        "opponent": ((4.2, 0.5), "opponent UAV\ntype, centre, flight", OPPONENT),
        "planner": ((7.6, 0.5), "planner of the path\nscript, search or LLM", OPPONENT),
    }
    for (x, y), text, colour in boxes.values():
        box(axes, (x, y), text, colour)
    arrow(axes, (1.7, 1.92), (3.05, 2.5), "link: the SNR decides", (1.75, 2.45))
    arrow(axes, (6.5, 2.6), (5.25, 2.6), "advice", (5.9, 2.75))
    arrow(axes, (3.8, 0.92), (3.8, 2.18), "jamming", (3.3, 1.5), OPPONENT)
    arrow(axes, (4.6, 2.18), (4.6, 0.92), "emission: heard by a check", (5.75, 1.5), ALLY)
    arrow(axes, (6.35, 0.5), (5.3, 0.5), "waypoints", (5.85, 0.65), OPPONENT)
    return figure


def detection() -> Figure:
    """Draw what the opponent knows of the ally's frequency, and what changes it."""
    figure, axes = canvas(2.25)
    box(axes, (1.5, 1.3), "known\njamming may cover", OPPONENT)
    box(axes, (7.1, 1.3), "out of date\nthe age grows", GREY)
    arrow(axes, (2.7, 1.5), (5.9, 1.5), "the ally hops", (4.3, 1.62), ALLY)
    arrow(axes, (5.9, 1.1), (2.7, 1.1), "a check hears", (4.3, 0.78), OPPONENT)
    loop(axes, (1.5, 1.72), "a check hears the same frequency")
    loop(axes, (7.1, 1.72), "a check does not hear:\nthe ally spreads, or is far away")
    low, high = STANDARD.check_interval_s
    first = "The start of a round is known. "
    axes.text(4.3, 0.12, f"{first}A check comes every {low:g} to {high:g} s.", ha="center", color=GREY)
    return figure


def seasons() -> Figure:
    """Draw which seeds and rivals are known when."""
    figure, axes = canvas(2.1)
    axes.annotate("", (8.9, 1.2), (0.1, 1.2), arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.6})
    marks = (
        (1.1, "train and tune", "public rivals,\ntraining and tuning seeds"),
        (3.1, "enter", "policies are fixed\nby their hashes"),
        (5.3, "the season closes", "rivals are trained against\nthe entries of that day"),
        (7.6, "play", "evaluation seeds follow\nfrom the season's seed"),
    )
    for x, what, about in marks:
        axes.plot([x], [1.2], "o", color=INK, ms=8)
        axes.text(x, 1.42, what, ha="center", va="bottom", weight="bold", color=INK)
        axes.text(x, 0.98, about, ha="center", va="top", color=GREY)
    span(axes, (0.3, 5.1), "a public score may be learned by heart", 2.15)
    span(axes, (5.5, 8.7), "a held-out score cannot", 2.15)
    return figure


def waterfall() -> Figure:
    """Draw a minute of a round, and the ally's waterfall of it."""
    env = gymnasium.make(
        "FPG/AllyVsScriptedDiscrete-v0",
        observation="waterfall",
        history=STEPS,
        opponent="sweep",
        path="pursuit",
    )
    shown, _ = env.reset(seed=0)
    recording = Recording(cast(FPGEnv, env.unwrapped).core.duel.batch)
    for step in range(STEPS):
        shown, *_ = env.step(np.int64(16 if step % 10 == 9 else 0))  # by the knowledge base every ten seconds
        recording.add()
    frames = recording.frames[1:]
    figure = blank_figure(PAGE, 2.8)
    left, right = figure.subplots(1, 2, sharey=True)
    seconds = np.arange(STEPS)
    half = STANDARD.footprint_half_widths_mhz[JAMMING_TYPES.index("narrowband")]
    left.barh(
        seconds, 2 * half, left=frames["jamming_mhz"] - half, color=OPPONENT, alpha=0.6, label="jamming"
    )
    left.plot(frames["frequency_mhz"], seconds, "|", color=ALLY, ms=4, mew=2, label="ally")
    left.set(
        xlim=BAND_MHZ,
        ylim=(STEPS, -1),
        xlabel="frequency, MHz",
        ylabel="second",
        title="what happens",
    )
    image = right.imshow(
        shown, cmap="RdBu_r", vmin=-1, vmax=1, aspect="auto", extent=(*BAND_MHZ, STEPS - 0.5, -0.5)
    )
    right.set(xlabel="frequency, MHz", title="the ally's waterfall")
    figure.colorbar(image, label="level", ticks=(-1, 0, 1))
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def crossplay() -> Figure:
    """Draw the ally's return per step of the best allies against the best opponents in ``standard``."""
    board = make_board(load_entries(ROOT / "leaderboard"))
    played = board.crossplay["standard"]
    table = np.array(played.returns["ally"])
    best = np.argsort(-table.mean(1))[:FIRST], np.argsort(table.mean(0))[:FIRST]
    table = table[np.ix_(*best)]
    rows, columns = (
        [textwrap.fill(board.names(side)[slugs[k]], width) for k in of]
        for side, slugs, of, width in (
            ("ally", played.allies, best[0], 22),
            ("opponent", played.opponents, best[1], 9),
        )
    )
    figure = blank_figure(PAGE, 3)
    axes = figure.subplots()
    image = axes.imshow(table, cmap="Blues", aspect="auto")
    for (row, column), value in np.ndenumerate(table):
        ink = "white" if value > (table.max() + table.min()) / 2 else "black"
        axes.text(
            column, row, f"{value:.1f}".replace("-", "\N{MINUS SIGN}"), ha="center", va="center", color=ink
        )
    axes.set_xticks(range(len(columns)), columns)
    axes.set_yticks(range(len(rows)), rows)
    axes.set(xlabel="opponents", ylabel="allies")
    figure.colorbar(image, label="ally's return per step")
    return figure


def clones() -> Figure:
    """Draw two minutes of a round in which one agent of the duel plays all three allies."""
    return TeamPicture(record_team([CLONE], ["watchful"]), f"{CLONE} in each seat, against watchful").show(
        120
    )


DIAGRAMS: Sequence[Callable[[], Figure]] = (system, detection, seasons, waterfall, crossplay, clones)


def canvas(height: float) -> tuple[Figure, Axes]:
    """Return a figure without axes, 9 units wide and in proportion high."""
    figure = blank_figure(PAGE, height)
    axes = figure.subplots()
    axes.set(xlim=(0, 9), ylim=(0, 9 * height / PAGE))
    axes.axis("off")
    return figure, axes


def box(axes: Axes, place: Place, text: str, colour: str) -> None:
    """Draw a box with a bold first line."""
    head, *rest = text.split("\n")
    (x, y), width, height = place, 2.15, 0.72
    style = "round,pad=0.03,rounding_size=0.08"
    patch = FancyBboxPatch(
        (x - width / 2, y - height / 2), width, height, boxstyle=style, fc="none", ec=colour, lw=1.8
    )
    axes.add_patch(patch)
    axes.text(x, y + (0.14 if rest else 0), head, ha="center", va="center", weight="bold", color=colour)
    if rest:
        axes.text(x, y - 0.16, rest[0], ha="center", va="center", color=GREY)


def arrow(axes: Axes, start: Place, end: Place, text: str, where: Place, colour: str = INK) -> None:
    """Draw an arrow, and its name at a place."""
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6})
    axes.text(*where, text, ha="center", va="center", color=colour)


def loop(axes: Axes, place: Place, text: str) -> None:
    """Draw an arrow from a box to itself, and its name above."""
    (x, y), style = place, {"arrowstyle": "-|>", "color": GREY, "lw": 1.4, "connectionstyle": "arc3,rad=-1.6"}
    axes.annotate("", (x + 0.25, y), (x - 0.25, y), arrowprops=style)
    axes.text(x, y + 0.5, text, ha="center", va="bottom", color=GREY)


def span(axes: Axes, ends: Place, text: str, y: float) -> None:
    """Draw a bracket over a span of the timeline, and its name above."""
    axes.annotate(
        "", (ends[1], y), (ends[0], y), arrowprops={"arrowstyle": "|-|,widthA=.3,widthB=.3", "color": GREY}
    )
    axes.text(sum(ends) / 2, y + 0.12, text, ha="center", va="bottom", color=GREY)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Draw the diagrams of the documentation.")
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    for draw in DIAGRAMS:
        write_figure(styled(draw)(), folder / f"{draw.__name__}.svg")
