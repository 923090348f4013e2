"""Pictures of a round: the box with both tracks, the spectrum, the SNR and the distance over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from matplotlib.ticker import NullLocator
from numpy.typing import ArrayLike

from fpg_bench.common.canvas import ALLY, OPPONENT, SIDE_COLOURS, Style, literal
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario
from fpg_bench.products.rendering.recording import Recording

SPREADING = "#56B4E9"
INK, GREY, PALE, GROUND = "#1b1f24", "#5f6773", "#cdd3db", "#f1f4f8"
_AZIMUTH, _ELEVATION = math.radians(-62), math.radians(40)
_DOTTED = (0, (1, 3))


def project(points: ArrayLike) -> np.ndarray:
    """Project points ``(..., 3)`` in m, z up, onto the picture's plane ``(..., 2)``, in parallel."""
    x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
    across = y * math.cos(_AZIMUTH) - x * math.sin(_AZIMUTH)
    deep = x * math.cos(_AZIMUTH) + y * math.sin(_AZIMUTH)
    return np.stack([across, z * math.cos(_ELEVATION) - deep * math.sin(_ELEVATION)], axis=-1)


def bezier_curve(control_points: np.ndarray) -> np.ndarray:
    """Return ``(100, 3)`` points of the cubic Bezier curve of ``(4, 3)`` control points."""
    t = np.linspace(0, 1, 100)[:, None]
    u = 1 - t
    points: np.ndarray = np.hstack([u**3, 3 * u * u * t, 3 * u * t * t, t**3]) @ control_points
    return points


class Panel:
    """Part of a picture. What never changes is drawn once; the artists in ``moving`` are set for each step.

    Args:
        axes: where to draw.
        recording: the round that will be shown.
    """

    def __init__(self, axes: Axes, recording: Recording) -> None:
        self._axes, self._scenario = axes, recording.scenario
        self.moving: list[Artist] = []

    def _line(self, colour: str, **style: Any) -> Line2D:
        (line,) = self._axes.plot([], [], color=colour, animated=True, **style)
        self.moving.append(line)
        return line


class BoxPanel(Panel):
    """Panel of the box with both tracks, seen from the side."""

    def __init__(self, axes: Axes, recording: Recording) -> None:
        super().__init__(axes, recording)
        self._base = np.array(self._scenario.base_station_m)
        axes.set_axis_off()
        axes.set_aspect("equal")
        self._draw_box()
        self._room = 0.13 * (axes.get_xlim()[1] - axes.get_xlim()[0])  # half the width of a name
        self._draw_plans(recording)
        self._draw_base_station()
        self._shadows = {side: self._line(GREY, alpha=0.3, linewidth=1.4) for side in SIDE_COLOURS}
        self._drops = {side: self._line(GREY, linewidth=0.8) for side in SIDE_COLOURS}
        self._link = self._line(ALLY, linewidth=1.3)
        self._jam = self._line(OPPONENT, linewidth=1.3)
        self._circle = self._line(OPPONENT, linewidth=1)
        self._tracks = {side: self._line(colour, linewidth=2.2) for side, colour in SIDE_COLOURS.items()}
        self._distance = self._label(INK)  # under the markers, where they are near
        self._markers = {side: self._marker(side) for side in SIDE_COLOURS}
        self._labels = {side: self._label(colour) for side, colour in SIDE_COLOURS.items()}

    def _marker(self, side: str) -> Line2D:
        shape = "o" if side == "ally" else "D"
        return self._line(SIDE_COLOURS[side], marker=shape, ms=9, mec="white", mew=1.4)

    def _label(self, colour: str) -> Text:
        text = self._axes.text(
            0, 0, "", color=colour, size=9, weight="bold", ha="center", va="center", animated=True
        )
        text.set_bbox({"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 1})
        self.moving.append(text)
        return text

    def _path(self, *points: ArrayLike, **style: Any) -> None:
        self._axes.plot(*project(np.array(points)).T, **style)

    def _note(self, text: str, place: ArrayLike, offset: tuple[float, float], **style: Any) -> None:
        style = {"color": GREY, "size": 8, "ha": "center", "va": "center", **style}
        self._axes.annotate(text, tuple(project(place)), offset, textcoords="offset points", **style)

    def _draw_box(self) -> None:
        x, y, z = self._scenario.box_m
        corners = [(0, 0), (x, 0), (x, y), (0, y)]
        self._axes.fill(
            *project([(*corner, 0) for corner in corners]).T, facecolor=GROUND, edgecolor=GREY, lw=0.8
        )
        for share in np.arange(1, 5) / 5:
            self._path((share * x, 0, 0), (share * x, y, 0), color="white", lw=1)
            self._path((0, share * y, 0), (x, share * y, 0), color="white", lw=1)
        for corner in corners:
            self._path((*corner, 0), (*corner, z), color=PALE, lw=0.8)
        self._path(*[(*corner, z) for corner in [*corners, corners[0]]], color=PALE, lw=0.8)
        self._note(f"x  {x:g} m", (x / 2, 0, 0), (-14, -10))
        self._note(f"y  {y:g} m", (x, y / 2, 0), (18, -8))
        self._note(f"{z:g} m", (0, 0, z / 2), (5, 0), ha="left")

    def _draw_base_station(self) -> None:
        self._path(self._base, marker="^", color=INK, ms=10)
        self._note("base station", self._base, (0, -14), color=INK)

    def _draw_plans(self, recording: Recording) -> None:
        """Draw the ally's curve, and the waypoints of a planned path."""
        self._path(*bezier_curve(recording.control_points), color=ALLY, lw=1.2, alpha=0.5, ls=":")
        if recording.waypoints is not None:
            self._path(*recording.waypoints, color=OPPONENT, lw=1, alpha=0.5, ls=":", marker="+")

    def update(self, frames: np.ndarray) -> None:
        """Show the round up to the last of ``frames`` (records of dtype ``recording.FRAME``)."""
        last = frames[-1]
        for side in SIDE_COLOURS:
            self._update_side(side, frames[f"{side}_position"])
        ally, opponent = last["ally_position"], last["opponent_position"]
        self._set(self._link, self._base, ally)
        self._link.set_linestyle(_DOTTED if last["snr_db"] < self._scenario.snr_threshold_db else "-")
        self._set(self._jam, opponent, ally)
        self._jam.set_linestyle("-" if last["covered"] else _DOTTED)
        turn = np.linspace(0, 2 * np.pi, 41)
        ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1) * self._scenario.distance_reward_m
        self._set(self._circle, *(ally + ring))
        self._place_labels(last)

    def _update_side(self, side: str, track: np.ndarray) -> None:
        here = track[-1]
        self._set(self._tracks[side], *track)
        self._set(self._shadows[side], *(track * (1, 1, 0)))
        self._set(self._drops[side], here, here * (1, 1, 0))
        self._set(self._markers[side], here)
        self._labels[side].set_text(f"{side}  {here[2]:.0f} m high")

    def _place_labels(self, last: np.void) -> None:
        """Place the names above and below both sides, and the distance beside the line between them."""
        ally, opponent = project(last["ally_position"]), project(last["opponent_position"])
        upward = 1 if ally[1] >= opponent[1] else -1
        left, right = self._axes.get_xlim()
        for side, place, away in (("ally", ally, upward), ("opponent", opponent, -upward)):
            across = min(max(place[0], left + self._room), right - self._room)
            self._labels[side].set_position((across, place[1] + away * self._room / 3.5))
        across, upwards = (ally + opponent) / 2
        if abs(ally[0] - opponent[0]) < self._room:  # otherwise a marker would hide it
            across = max(ally[0], opponent[0])
        self._distance.set_position((across + self._room / 2, upwards))
        self._distance.set_text(f"{last['distance_m']:.0f} m")

    def _set(self, line: Line2D, *points: ArrayLike) -> None:
        line.set_data(*project(np.array(points)).T)


_ROWS = 300
WINDOW = 120  # steps on the time axis
_SHADE = 70  # opacity of 255 while the ally spreads


def footprints(frames: np.ndarray, scenario: Scenario, rows_mhz: np.ndarray) -> np.ndarray:
    """Return ``(rows, n)`` bool: frequencies covered by the jamming of each frame (Eq. 7-10)."""
    kind = frames["jamming_type"]
    offset = rows_mhz[:, None] - frames["jamming_mhz"]
    spacing = scenario.comb_spacing_points * scenario.point_spacing_mhz
    to_tooth = offset - spacing * np.floor(offset / spacing + 0.5)
    distance = np.abs(np.where(kind == JAMMING_TYPES.index("comb"), to_tooth, offset))
    covered: np.ndarray = (distance <= np.asarray(scenario.footprint_half_widths_mhz)[kind]) & (kind >= 0)
    return covered


def held(step: np.ndarray, values: np.ndarray, shown: ArrayLike = True) -> tuple[np.ndarray, np.ndarray]:
    """Return a line of one level stroke per step where ``shown`` is true, over the second of the step."""
    values = np.where(shown, values, np.nan)
    gap = np.full(len(step), np.nan)
    return np.stack([step - 1, step, gap], axis=1).ravel(), np.stack([values, values, gap], axis=1).ravel()


class TimePanel(Panel):
    """Panel with a scrolling time axis, shaded while the ally spreads.

    Args:
        axes: where to draw.
        recording: the round that will be shown.
        label: label of the vertical axis.
        low, high: limits of the vertical axis.
    """

    def __init__(self, axes: Axes, recording: Recording, label: str, low: float, high: float) -> None:
        super().__init__(axes, recording)
        self._window = min(recording.horizon, WINDOW)
        axes.set_ylabel(label, color=GREY, size=8.5)
        axes.tick_params(colors=GREY, labelsize=8, length=3, bottom=False, labelbottom=False)
        axes.spines[["top", "right"]].set_visible(False)
        axes.spines[["left", "bottom"]].set_color(PALE)
        self._shade = self._image(1, SPREADING)
        axes.set_ylim(low, high)

    def _image(self, rows: int, colour: str) -> AxesImage:
        """Add an image of one colour over the panel, with one column per step and variable opacity."""
        pixels = np.zeros((rows, self._window, 4), np.uint8)
        pixels[..., :3] = np.round(255 * np.array(to_rgb(colour)))
        style: Style = {"interpolation": "nearest", "origin": "lower", "extent": (0, 1, 0, 1)}
        image = AxesImage(self._axes, animated=True, **style)
        image.set_transform(self._axes.transAxes)
        image.set_data(pixels)
        self._axes.add_image(image)
        self.moving.append(image)
        return image

    def _mark(self, value: float, text: str, colour: str) -> None:
        """Draw a dashed line across the panel, and at its right end what begins below it."""
        self._axes.axhline(value, color=colour, lw=0.9, ls="--")
        place, below = self._axes.get_yaxis_transform(), f"{text}\nbelow {value:g}"
        self._axes.text(1.008, value, below, transform=place, color=colour, size=7, va="center")

    def _opacity(self, image: AxesImage, opacity: np.ndarray) -> None:
        pixels = image.get_array()
        pixels[..., 3] = 0  # type: ignore[index]
        pixels[:, : opacity.shape[-1], 3] = opacity  # type: ignore[index]
        image.set_data(pixels)

    def update(self, frames: np.ndarray) -> None:
        """Show the end of ``frames`` (records of dtype ``recording.FRAME``, the round's start the first)."""
        start = max(0, len(frames) - 1 - self._window)
        self._axes.set_xlim(start, start + self._window)
        self._update(frames[start:], frames[start + 1 :])

    def _update(self, frames: np.ndarray, played: np.ndarray) -> None:
        """Set the artists: ``played`` are the steps in the window, ``frames`` one more before them."""
        self._opacity(self._shade, played["spreading"] * _SHADE)


class SpectrumPanel(TimePanel):
    """Panel of the band over time: jamming footprints, frequencies of both sides, hops and checks."""

    def __init__(self, axes: Axes, recording: Recording) -> None:
        s = recording.scenario
        margin = 0.06 * (s.band_high_mhz - s.band_low_mhz)
        low, high = s.band_low_mhz - margin, s.band_high_mhz + 2 * margin
        super().__init__(axes, recording, "frequency, MHz", low, high)
        self._lane = s.band_high_mhz + 1.2 * margin  # where checks are marked
        self._rows = low + (np.arange(_ROWS) + 0.5) * (high - low) / _ROWS
        powers = np.asarray(s.jamming_coefficients) * s.opponent_power_dbm
        self._opacities = np.interp(powers, (0, 30), (80, 215))  # stronger is darker
        self._jamming = self._image(_ROWS, OPPONENT)
        axes.set_yticks(np.linspace(s.band_low_mhz, s.band_high_mhz, 5))
        self._jumps = self._line(ALLY, lw=0.8, drawstyle="steps-pre")
        self._known = self._line(INK, lw=1, ls=(0, (1, 1)))
        self._halo = self._line("white", lw=5, solid_capstyle="butt")
        self._ally = self._line(ALLY, lw=3, solid_capstyle="butt")
        self._outage = self._line(INK, lw=5, solid_capstyle="butt")
        self._hops = self._line(ALLY, ls="", marker="o", ms=5, mfc="white", mew=1.3)
        self._heard = self._line(INK, ls="", marker="v", ms=6)
        self._unheard = self._line(INK, ls="", marker="v", ms=6, mfc="white", mew=0.8)

    def _update(self, frames: np.ndarray, played: np.ndarray) -> None:
        super()._update(frames, played)
        footprint = footprints(played, self._scenario, self._rows)
        self._opacity(self._jamming, footprint * self._opacities[played["jamming_type"]])
        step, frequency = played["step"], played["frequency_mhz"]
        self._jumps.set_data(frames["step"], frames["frequency_mhz"])
        for line in (self._halo, self._ally):
            line.set_data(*held(step, frequency))
        outage = played["snr_db"] < self._scenario.snr_threshold_db
        self._outage.set_data(*held(step, frequency, outage))
        # A step is jammed at the frequency that was known before it.
        self._known.set_data(*held(step, frames["known_mhz"][:-1]))
        hopped = played["hopped"]
        self._hops.set_data(step[hopped] - 0.5, frequency[hopped])
        for line, result in ((self._heard, 1), (self._unheard, -1)):
            at = step[played["checked"] & (played["last_check"] == result)]
            line.set_data(at - 0.5, np.full(at.shape, self._lane))


class SnrPanel(TimePanel):
    """Panel of the SNR over time, with and without jamming, and the threshold of an outage."""

    def __init__(self, axes: Axes, recording: Recording) -> None:
        super().__init__(axes, recording, "SNR, dB", -20, 100)
        threshold = recording.scenario.snr_threshold_db
        self._mark(threshold, "outage", INK)
        self._clean = self._line(GREY, lw=1, alpha=0.8)
        self._snr = self._line(ALLY, lw=1.5)
        self._outage = self._line(INK, ls="", marker="o", ms=3.5)

    def _update(self, frames: np.ndarray, played: np.ndarray) -> None:
        super()._update(frames, played)
        step, snr, clean = frames["step"], frames["snr_db"], frames["clean_snr_db"]
        self._clean.set_data(step, clean)
        self._snr.set_data(step, snr)
        outage = snr < self._scenario.snr_threshold_db
        self._outage.set_data(step[outage], snr[outage])
        low, high = self._axes.get_ylim()
        lowest, highest = snr.min(), max(snr.max(), clean.max())
        if lowest < low or highest > high:  # the axis grows, and never shrinks
            self._axes.set_ylim(min(low, lowest - 10), max(high, highest + 10))


class DistancePanel(TimePanel):
    """Panel of the distance over time on a logarithmic axis, and the reward radius."""

    def __init__(self, axes: Axes, recording: Recording) -> None:
        s = recording.scenario
        radius = s.distance_reward_m
        low, high = max(radius, 1) / 4, 1.1 * float(np.linalg.norm(s.box_m))
        axes.set_yscale("log")
        super().__init__(axes, recording, "distance, m", low, high)
        self._mark(radius, "bonus", OPPONENT)
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_locator(NullLocator())
        axes.tick_params(bottom=True, labelbottom=True)
        axes.xaxis.set_animated(True)
        self.moving.append(axes.xaxis)
        axes.set_xlabel("step, s", color=GREY, size=8.5, labelpad=1)
        self._floor = low
        self._distance = self._line(INK, lw=1.5)

    def _update(self, frames: np.ndarray, played: np.ndarray) -> None:
        super()._update(frames, played)
        self._distance.set_data(frames["step"], np.maximum(frames["distance_m"], self._floor))


WIDTH, HEIGHT = 1120, 640  # multiples of 16, which video encoders require
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
    """Picture of a recording after any of its steps.

    The static parts are drawn once, so a step costs the moving lines alone.

    Args:
        recording: the round; steps may be added to it.
        title: title of the picture, such as the players' names.
    """

    def __init__(self, recording: Recording, title: str = "") -> None:
        self.recording = recording
        self._figure = Figure((WIDTH / _DPI, HEIGHT / _DPI), dpi=_DPI, facecolor="white")
        self._canvas = FigureCanvasAgg(self._figure)
        self._background: object = None
        self._limits: tuple[float, float] | None = None
        self._figure.text(0.022, 0.965, literal(_heading(recording, title)), color=INK, size=11, va="center")
        self._values = [self._tile(*tile) for tile in _TILES]
        axes = self._figure.add_axes
        self._panels: tuple[BoxPanel | TimePanel, ...] = (
            BoxPanel(axes((0.015, 0.015, 0.445, 0.82)), recording),
            SpectrumPanel(axes((0.52, 0.43, 0.435, 0.36)), recording),
            SnrPanel(axes((0.52, 0.235, 0.435, 0.17)), recording),
            DistancePanel(axes((0.52, 0.07, 0.435, 0.14)), recording),
        )
        self._add_legend()

    def _tile(self, name: str, left: float, colour: str) -> Text:
        """Add a small heading, and return the text below it."""
        self._figure.text(left, 0.92, name.upper(), color=GREY, size=7, va="center")
        style: Style = {"size": 12, "weight": "bold", "va": "center", "color": colour}
        return self._figure.text(left, 0.885, "", animated=True, **style)

    def _add_legend(self) -> None:
        check: Style = {"ls": "", "marker": "v", "color": INK, "ms": 6}
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
        """Return the picture ``(640, 1120, 3)`` uint8 after ``step`` steps (None: the last recorded one)."""
        frames = self.recording.frames
        frames = frames if step is None else frames[: step + 1]
        for panel in self._panels:
            panel.update(frames)
        for text, value in zip(self._values, _figures(frames, self.recording), strict=True):
            text.set_text(value)
        self._restore_background()
        renderer = self._canvas.get_renderer()
        for artist in [*(artist for panel in self._panels for artist in panel.moving), *self._values]:
            artist.draw(renderer)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _restore_background(self) -> None:
        """Restore the static background; redraw it if an axis has grown."""
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
    """Return the texts above the panels, in the order of ``_TILES``."""
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
