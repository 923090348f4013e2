"""One picture that lets a person follow a round: arena, spectrum, SNR, distance, and a line of figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text

from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.rendering.arena_panel import ALLY, GREY, INK, OPPONENT, SPREADING, ArenaPanel
from fpg_bench.rendering.recording import Recording
from fpg_bench.rendering.time_panels import DistancePanel, SnrPanel, SpectrumPanel

WIDTH, HEIGHT = 1120, 640  # multiples of 16, which video encoders want
_DPI = 100
_TILES = (  # heading, left end, colour
    ("step", 0.022, INK),
    ("ally reward", 0.125, ALLY),
    ("opponent reward", 0.24, OPPONENT),
    ("link", 0.375, INK),
    ("jamming", 0.555, OPPONENT),
    ("frequency known to the opponent", 0.785, INK),
)


class Picture:
    """Draws a recording as it stands at any of its steps.

    What never changes is drawn once; a step then costs the moving lines alone.

    Args:
        recording: the round; it may go on growing.
        title: a line at the top, who plays whom for instance.
    """

    def __init__(self, recording: Recording, title: str = "") -> None:
        self._recording = recording
        self._figure = Figure((WIDTH / _DPI, HEIGHT / _DPI), dpi=_DPI, facecolor="white")
        self._canvas = FigureCanvasAgg(self._figure)
        self._background: Any = None
        self._limits: tuple[float, float] | None = None
        self._figure.text(0.022, 0.965, _heading(recording, title), color=INK, size=11, va="center")
        self._values = [self._tile(*tile) for tile in _TILES]
        axes = self._figure.add_axes
        self._panels = (
            ArenaPanel(axes((0.015, 0.015, 0.445, 0.82)), recording),
            SpectrumPanel(axes((0.52, 0.43, 0.435, 0.36)), recording),
            SnrPanel(axes((0.52, 0.235, 0.435, 0.17)), recording),
            DistancePanel(axes((0.52, 0.07, 0.435, 0.14)), recording),
        )
        self._add_legend()

    def _tile(self, name: str, left: float, colour: str) -> Text:
        """A small heading, and under it the text that moves."""
        self._figure.text(left, 0.92, name.upper(), color=GREY, size=7, va="center")
        style: dict[str, Any] = {"size": 12, "weight": "bold", "va": "center", "color": colour}
        return self._figure.text(left, 0.885, "", animated=True, **style)

    def _add_legend(self) -> None:
        check: dict[str, Any] = {"ls": "", "marker": "v", "color": INK, "ms": 6}
        handles: Sequence[Artist] = (
            Line2D([], [], color=ALLY, lw=3, label="ally"),
            Line2D([], [], color=INK, lw=5, label="outage"),
            Line2D([], [], color=ALLY, ls="", marker="o", ms=5, mfc="white", label="hop"),
            Patch(facecolor=SPREADING, alpha=0.35, label="spreading"),
            Patch(facecolor=OPPONENT, label="jamming"),
            Line2D([], [], color=INK, lw=1, ls=(0, (1, 1)), label="known to opponent"),
            Line2D([], [], label="check: heard", **check),
            Line2D([], [], label="not heard", mfc="white", mew=0.8, **check),
        )
        self._figure.legend(
            handles=handles,
            loc="upper right",
            bbox_to_anchor=(0.962, 0.85),
            ncols=4,
            frameon=False,
            fontsize=7.5,
            labelcolor=INK,
            columnspacing=1.6,
            handlelength=1.6,
            borderaxespad=0,
        )

    def draw(self, step: int | None = None) -> np.ndarray:
        """The picture, ``(640, 1120, 3)`` uint8, after ``step`` steps (None: the last that is recorded)."""
        frames = self._recording.frames
        frames = frames if step is None else frames[: step + 1]
        for panel in self._panels:
            panel.update(frames)
        for text, value in zip(self._values, _figures(frames, self._recording), strict=True):
            text.set_text(value)
        self._restore_background()
        renderer = self._canvas.get_renderer()
        for artist in [*(artist for panel in self._panels for artist in panel.moving), *self._values]:
            artist.draw(renderer)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _restore_background(self) -> None:
        """Put back what never changes; draw it anew where an axis has grown."""
        limits = self._figure.axes[2].get_ylim()
        if limits != self._limits:
            self._canvas.draw()
            self._background = self._canvas.copy_from_bbox(self._figure.bbox)
            self._limits = limits
        self._canvas.restore_region(self._background)


def _heading(recording: Recording, title: str) -> str:
    which = f"seed {recording.seed}, match {recording.match}, round {recording.round}"
    return f"{title or 'Frequency point game'}     {which}, path {recording.path}"


def _figures(frames: np.ndarray, recording: Recording) -> tuple[str, ...]:
    """The line of figures over the panels, in the order of ``_TILES``."""
    last = frames[-1]
    outage = last["snr_db"] < recording.scenario.snr_threshold_db
    kind = last["jamming_type"]
    jamming = "none yet" if kind < 0 else f"{JAMMING_TYPES[kind]}  {last['jamming_mhz']:.1f} MHz"
    return (
        f"{last['step']} / {recording.horizon}",
        f"{frames['ally_reward'].sum():+.0f}",
        f"{frames['opponent_reward'].sum():+.0f}",
        f"{last['snr_db']:.1f} dB  {'OUTAGE' if outage else 'up'}",
        jamming,
        f"{last['known_mhz']:.1f} MHz  {last['age_s']} s old",
    )
