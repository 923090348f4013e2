"""Empty matplotlib figures without global state, and the colours of both sides."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ALLY, OPPONENT = "#0072b2", "#d55e00"  # Okabe and Ito's colour-blind safe palette
SIDE_COLOURS = {"ally": ALLY, "opponent": OPPONENT}


def blank_figure(width: float, height: float, dpi: int = 100) -> Figure:
    """Return an empty figure of this size in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure
