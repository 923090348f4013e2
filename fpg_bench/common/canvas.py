"""The one style of all figures, for a paper's column and for pages: sizes, colours, marks, and files.

A figure is as wide as a column or a page of a journal, its text has 8 pt, and colour is never alone: players
differ by their markers and dashes, too. A player has the same style in all figures.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_Draw = TypeVar("_Draw", bound=Callable[..., Any])
_STYLE = str(Path(__file__).with_name("figures.mplstyle"))
FIGURES = (".png", ".svg", ".pdf")
COLUMN, PAGE = 3.5, 7.16  # widths in inches, as IEEE's journals have them
Style = dict[str, Any]  # keywords of matplotlib
Styles = Mapping[str, Style]
_UNDATED = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}  # metadata
# Okabe and Ito's colour-blind safe palette without its yellow, and grey
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#7f7f7f")
MARKERS = "oDs^vPX*"
_DASHES = ("-", "--", "-.", ":", (0, (8, 2)))
ALLY, OPPONENT = COLOURS[:2]
GREY = COLOURS[-1]
SIDE_COLOURS = {"ally": ALLY, "opponent": OPPONENT}
# Players with a style of their own; grey, the eighth, is nobody's, and those after it share no figure with
# those of their colour
_PLAYERS = (
    *("ppo", "sac", "td3", "dqn", "recurrent-ppo", "maskable-ppo", "ppo-stack8", ""),
    *("maddpg", "qr-dqn", "ppo-fast", "dqn-stack8"),
)
# On a dark page ink turns light and blue lighter; other colours are read on both, and the cells of an image
# stay as they are, with their text. Python's colours stand in an SVG as they are written here.
_ON_CELLS = "#010101"
_DARK_INKS = {"#000000": "#e6e6e6", "#1b1f24": "#e6e6e6", "#5f6773": "#a3acb8"}
_DARK_INKS |= {"#0072b2": "#4aa8e8", "#ffffff": "#15191e", "#f1f4f8": "#1c222b"}
_TURNED = "".join(
    f":is(path,use{',text' * (ink != '#ffffff')})[style*='{kind}: {ink}']{{{kind}:{dark}!important}}"
    for ink, dark in _DARK_INKS.items()
    for kind in ("fill", "stroke")
)
_DARK = (
    "<style>svg{color-scheme:light dark} @media (prefers-color-scheme:dark){"
    f"text:not([style*='fill:']){{fill:{_DARK_INKS['#000000']}}}{_TURNED}}}</style>"
).encode()


def styled(draw: _Draw) -> _Draw:
    """Let a function draw in the style of all figures, and leave matplotlib's settings as they are."""

    @wraps(draw)
    def drawn(*args: Any, **kwargs: Any) -> Any:
        from matplotlib import rc_context

        with rc_context(fname=_STYLE):
            return draw(*args, **kwargs)

    return cast(_Draw, drawn)


def styles_of(names: Iterable[str]) -> Styles:
    """Return the colour, marker and dashes of each player; known ones have theirs, others follow in order."""
    names = list(names)
    known = {name: _PLAYERS.index(name.lower()) for name in names if name.lower() in _PLAYERS}
    free = (place for place in count() if place not in known.values())
    return {name: _style(known[name] if name in known else next(free)) for name in names}


def _style(place: int) -> Style:
    turn = place + place // len(COLOURS)  # after so many players, colours come back with another marker
    dashes = _DASHES[turn % len(_DASHES)]
    return {"color": COLOURS[place % len(COLOURS)], "marker": MARKERS[turn % len(MARKERS)], "ls": dashes}


SIDE_STYLES = styles_of(SIDE_COLOURS)


def blank_figure(width: float, height: float) -> Figure:
    """Return an empty figure of this size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=200, layout="constrained")


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


def image_of(figure: Figure, form: str, name: str) -> bytes:
    """Return a matplotlib figure as the content of a file, which is the same each time.

    Text stays text: TrueType fonts in PDF, as journals ask for, and ``<text>`` in SVG. An SVG has no
    background, and is dark where the reader's system or page is.

    Args:
        figure: the figure.
        form: ``png``, ``svg`` or ``pdf``.
        name: distinguishes its parts in SVG from those of other figures of a page.
    """
    from matplotlib import colors, rc_context

    for axes in figure.axes:
        for text in axes.texts if axes.images else ():
            if colors.to_hex(text.get_color()) == "#000000":
                text.set_color(_ON_CELLS)
    image = io.BytesIO()
    background = "auto" if form == "png" else "none"
    with rc_context({"svg.hashsalt": name}, fname=_STYLE):
        figure.savefig(image, format=form, metadata=_UNDATED[form], facecolor=background)
    return image.getvalue().replace(b"<defs>", _DARK + b"<defs>", 1) if form == "svg" else image.getvalue()
