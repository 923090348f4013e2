"""Pictures of a round of teams: the box from above, the band over time, and who is jammed by whom."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from fpg_bench.common.canvas import ALLY, COLOURS, OPPONENT, PAGE, literal, styled
from fpg_bench.products.rendering.picture import (
    GREY,
    GROUND,
    HEIGHT,
    INK,
    PALE,
    WIDTH,
    bezier_curve,
    footprints,
    held,
)

ALLIES = (ALLY, *COLOURS[2:4], COLOURS[5], "#8c6d1f")  # by seat
JAMMERS = (OPPONENT, COLOURS[4], "#8c3b00")
MARKERS = {"ally_position": "os^vP", "opponent_position": "DX*"}  # by seat
WINDOW = 120  # steps on the axis of time
_DPI = WIDTH / PAGE
_ROWS = 300
_TRACK = 60  # steps
_APART_MHZ = 1.7  # between the strokes of allies on one point
_LEAST_MHZ = 0.5  # half the width of a drawn tone


class TeamPicture:
    """Picture of a round of teams after any of its steps.

    Args:
        recording: the round, a :class:`fpg_bench.products.teams.watching.TeamRecording`.
        title: title of the picture, such as the players' names.
    """

    def __init__(self, recording: Any, title: str = "") -> None:
        self.recording, self._title = recording, title
        self._figure = Figure((WIDTH / _DPI, HEIGHT / _DPI), dpi=_DPI, facecolor="white")
        self._canvas = FigureCanvasAgg(self._figure)

    def draw(self, step: int | None = None) -> np.ndarray:
        """Return the picture ``(640, 1120, 3)`` uint8 after ``step`` steps (None: the last)."""
        self.show(step)
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    @styled
    def show(self, step: int | None = None) -> Figure:
        """Return the figure after ``step`` steps (None: the last)."""
        figure, whole = self._figure, self.recording
        end = len(whole.frames) if step is None else step + 1
        seen = slice(max(0, end - WINDOW), end)
        figure.clear()
        figure.text(0.022, 0.965, literal(self._title), color=INK, va="center")
        earned = whole.frames["ally_reward"][:end].sum(axis=0).mean() / max(end - 1, 1)
        about = f"seed {whole.seed}, step {end - 1}: {earned:.2f} per step and ally"
        figure.text(0.022, 0.925, about, color=GREY, va="center")
        self._draw_above(figure.add_axes((0.022, 0.16, 0.435, 0.73)), end)
        band = figure.add_axes((0.54, 0.41, 0.445, 0.48))
        self._draw_band(band, seen)
        self._draw_lanes(figure.add_axes((0.54, 0.17, 0.445, 0.19), sharex=band), seen)
        self._add_legend()
        return figure

    def _draw_above(self, axes: Axes, end: int) -> None:
        """Draw the part of the box in which they fly, from above: tracks, and who jams whom."""
        whole = self.recording
        curve, base = bezier_curve(whole.control_points)[:, :2], whole.scenario.base_station_m[:2]
        sides = ((whole.jammers, "opponent_position", JAMMERS), (whole.frames, "ally_position", ALLIES))
        flown = [frames[side][..., :2].reshape(-1, 2) for frames, side, _ in sides]
        every = np.concatenate([curve, [base], *flown])
        middle, half = (every.max(0) + every.min(0)) / 2, 0.55 * np.ptp(every, axis=0).max()
        axes.set(xlim=middle[0] + half * np.array([-1, 1]), ylim=middle[1] + half * np.array([-1, 1]))
        axes.set(aspect="equal", facecolor=GROUND, xticks=[], yticks=[])
        axes.set_xlabel(f"{2 * half:.0f} m x {2 * half:.0f} m, from above", color=GREY)
        for spine in axes.spines.values():
            spine.set_color(PALE)
        axes.plot(*curve.T, color=GREY, lw=1, ls=":")
        axes.plot(*base, "p", color=INK, ms=6)
        for j, i in zip(*np.nonzero(whole.jams[end - 1]), strict=True):
            ends = whole.jammers[end - 1, j]["opponent_position"], whole.frames[end - 1, i]["ally_position"]
            axes.plot(*np.array(ends)[:, :2].T, color=JAMMERS[j], lw=1)
        for frames, side, colours in sides:
            for seat in range(frames.shape[1]):
                track, colour = frames[side][max(0, end - _TRACK) : end, seat, :2], colours[seat]
                axes.plot(*track.T, color=colour, lw=1, alpha=0.6)
                axes.plot(*track[-1], MARKERS[side][seat], color=colour, ms=6, mec="white", mew=0.8)

    def _draw_band(self, axes: Axes, seen: slice) -> None:
        """Draw the band over time: the jammers' bands, and each ally's point or spread signal."""
        s, allies = self.recording.scenario, self.recording.frames[seen]
        edge = 0.06 * (s.band_high_mhz - s.band_low_mhz)
        low, high = s.band_low_mhz - edge, s.band_high_mhz + edge
        rows = low + (np.arange(_ROWS) + 0.5) * (high - low) / _ROWS
        widths = tuple(max(half, _LEAST_MHZ) for half in s.footprint_half_widths_mhz)
        drawn = dataclasses.replace(s, footprint_half_widths_mhz=widths)
        first, end = self._frame(axes, seen)
        for j, frames in enumerate(self.recording.jammers[seen].T):
            _paint(axes, 0.45 * footprints(frames, drawn, rows), JAMMERS[j], (first, end, low, high))
        half = s.spread_bandwidth_mhz / 2
        for i, frames in enumerate(allies.T):
            within = abs(rows[:, None] - frames["frequency_mhz"]) <= half
            _paint(axes, 0.12 * (within & frames["spreading"]), ALLIES[i], (first, end, low, high))
        for i, frames in enumerate(allies.T):
            beside = (i - (allies.shape[1] - 1) / 2) * _APART_MHZ
            stroke = held(frames["step"], frames["frequency_mhz"] + beside)
            axes.plot(*stroke, color=ALLIES[i], lw=1.8, solid_capstyle="butt")
        axes.set(xlim=max(first, 0) + np.array([0, WINDOW]), ylim=(low, high))
        axes.set_yticks(np.linspace(s.band_low_mhz, s.band_high_mhz, 5))
        axes.yaxis.set_major_formatter("{x:.0f}")
        axes.set_ylabel("frequency, MHz", color=GREY)
        axes.tick_params(labelbottom=False)

    def _draw_lanes(self, axes: Axes, seen: slice) -> None:
        """Draw a lane for each ally: its reward as depth of its colour, and the jammers that cover it."""
        allies, jams = self.recording.frames[seen], self.recording.jams[seen]
        first, end = self._frame(axes, seen)
        scale, (n, m) = self.recording.scenario.reward_scale, (jams.shape[2], jams.shape[1])
        for i, frames in enumerate(allies.T):
            depth = np.clip(frames["ally_reward"] / scale, 0, 1) ** 2
            _paint(axes, depth[None], ALLIES[i], (first, end, i + 0.3, i + 0.95))
            for j in range(m):
                stroke = held(frames["step"], np.full(len(frames), i + 0.24 - 0.13 * j), jams[:, j, i])
                axes.plot(*stroke, color=JAMMERS[j], lw=1.5, solid_capstyle="butt")
        axes.set(xlim=max(first, 0) + np.array([0, WINDOW]), ylim=(n, -0.05))
        axes.set_yticks(np.arange(n) + 0.5, [f"ally {i}" for i in range(n)])
        axes.set_xlabel("step, s", color=GREY, labelpad=1)

    def _frame(self, axes: Axes, seen: slice) -> tuple[int, int]:
        """Set up axes over time; returns the beginning of the first step and the end of the last."""
        axes.tick_params(colors=GREY, length=3)
        axes.spines[["left", "bottom"]].set_color(PALE)
        return seen.start - 1, seen.stop - 1

    def _add_legend(self) -> None:
        n, m = self.recording.jams.shape[2], self.recording.jams.shape[1]
        handles: list[Artist] = [
            Line2D([], [], color=ALLIES[i], lw=2, marker=MARKERS["ally_position"][i], label=f"ally {i}")
            for i in range(n)
        ]
        handles += [
            Line2D(
                [], [], color=JAMMERS[j], lw=2, marker=MARKERS["opponent_position"][j], label=f"jammer {j}"
            )
            for j in range(m)
        ]
        handles += [Line2D([], [], color=INK, ls="", marker="p", label="base station")]
        handles += [Patch(color=GREY, alpha=0.15, label="spread signal")]
        self._figure.legend(
            handles=handles,
            loc="lower left",
            bbox_to_anchor=(0.015, 0.0),
            ncols=8,
            handlelength=1.5,
            columnspacing=1.2,
        )


def _paint(axes: Axes, opacity: np.ndarray, colour: str, extent: tuple[float, float, float, float]) -> None:
    """Fill an extent, left, right, bottom and top, with cells ``(rows, n)`` of one colour."""
    pixels = np.broadcast_to(to_rgba(colour), (*opacity.shape, 4)).copy()
    pixels[..., 3] = opacity
    axes.imshow(pixels, extent=extent, origin="lower", aspect="auto", interpolation="nearest")
