"""Empty matplotlib figures without global state, and the colours of both sides."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = (".png", ".svg", ".pdf")
Style = dict[str, Any]  # keywords of matplotlib
_UNDATED = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}  # metadata
ALLY, OPPONENT = "#0072b2", "#d55e00"  # Okabe and Ito's colour-blind safe palette
SIDE_COLOURS = {"ally": ALLY, "opponent": OPPONENT}


def blank_figure(width: float, height: float, dpi: int = 100) -> Figure:
    """Return an empty figure of this size in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def literal(text: str) -> str:
    """Return a text, such as a user's name for something, that matplotlib shows as it is, without math."""
    return text.replace("$", r"\$")


def check_figure(path: Path) -> None:
    """Raise UserError if a figure cannot have the suffix of a path."""
    if path.suffix.lower() not in FIGURES:
        raise UserError(f"out: {path}: a figure is written as {', '.join(FIGURES)}")


def write_figure(figure: Figure, path: Path) -> None:
    """Write a matplotlib figure as PNG, SVG or PDF, by the path's suffix; see :func:`image_of`."""
    check_figure(path)
    write_whole(path, image_of(figure, path.suffix.lower().removeprefix("."), path.stem))


def image_of(figure: Figure, form: str, name: str, dpi: float | str = "figure") -> bytes:
    """Return a matplotlib figure as the content of a file, which is the same each time.

    Text stays text: TrueType fonts in PDF, as journals ask for, and ``<text>`` in SVG.

    Args:
        figure: the figure.
        form: ``png``, ``svg`` or ``pdf``.
        name: distinguishes its parts in SVG from those of other figures of a page.
        dpi: dots per inch.
    """
    from matplotlib import rc_context

    image = io.BytesIO()
    with rc_context({"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": name}):
        figure.savefig(image, format=form, metadata=_UNDATED[form], dpi=dpi)
    return image.getvalue()
