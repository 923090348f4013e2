"""The picture of a run: what its policy was worth while it trained."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from fpg_bench.files import write_whole
from fpg_bench.pictures.canvas import SIDE_COLOURS, blank_figure
from fpg_bench.rows import Row


def draw_curve(rows: Sequence[Row], title: str, path: Path) -> None:
    """Draw each side's score over the steps into a PNG file.

    Args:
        rows: those of ``evaluations.jsonl``.
        title: above the picture.
        path: the file.
    """
    figure = blank_figure(6, 3.6)
    axes = figure.subplots()
    for side in dict.fromkeys(row["side"] for row in rows):
        points = [(row["steps"], row["score"]) for row in rows if row["side"] == side]
        axes.plot(*zip(*points, strict=True), "o-", ms=3, color=SIDE_COLOURS[side], label=side)
    axes.set(xlabel="steps", ylabel="score (few rounds, tuning seeds)", title=title)
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    image = io.BytesIO()
    figure.savefig(image, format="png")
    write_whole(path, image.getvalue())
