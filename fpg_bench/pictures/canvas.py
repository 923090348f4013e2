"""An empty figure to draw on, without a window and without matplotlib's global state."""

from __future__ import annotations

from typing import Any


def blank_figure(width: float, height: float, dpi: int = 100) -> Any:
    """A matplotlib ``Figure`` of this size in inches, at so many dots each."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure
