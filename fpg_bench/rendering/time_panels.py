"""The picture's panels over time: the band as a waterfall, the SNR, and the distance."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario
from fpg_bench.rendering.arena_panel import ALLY, GREY, INK, OPPONENT, PALE, SPREADING
from fpg_bench.rendering.recording import Recording

_ROWS = 300
WINDOW = 120  # steps on the time axis
_SHADE = 70  # opacity of 255 while the ally spreads


def footprints(frames: np.ndarray, scenario: Scenario, rows_mhz: np.ndarray) -> np.ndarray:
    """``(rows, n)`` bool: whether each frame's jamming footprint holds each frequency (Eq. 7-10)."""
    kind = frames["jamming_type"]
    offset = rows_mhz[:, None] - frames["jamming_mhz"]
    spacing = scenario.comb_spacing_points * scenario.point_spacing_mhz
    to_tooth = offset - spacing * np.floor(offset / spacing + 0.5)
    distance = np.abs(np.where(kind == JAMMING_TYPES.index("comb"), to_tooth, offset))
    return (distance <= np.asarray(scenario.footprint_half_widths_mhz)[kind]) & (kind >= 0)


def held(step: np.ndarray, values: np.ndarray, shown: Any = True) -> tuple[np.ndarray, np.ndarray]:
    """A line with a level stroke per step where ``shown``, from the second it began to the one it ended."""
    values = np.where(shown, values, np.nan)
    gap = np.full(len(step), np.nan)
    return np.stack([step - 1, step, gap], axis=1).ravel(), np.stack([values, values, gap], axis=1).ravel()


class TimePanel:
    """One panel: a time axis that scrolls over the last seconds, and shading while the ally spreads.

    Args:
        axes: where to draw.
        recording: the round that will be shown.
        label: of the vertical axis.
        low, high: its limits.
    """

    def __init__(self, axes: Axes, recording: Recording, label: str, low: float, high: float) -> None:
        self._axes, self._scenario = axes, recording.scenario
        self._window = min(recording.horizon, WINDOW)
        self.moving: list[Artist] = []
        axes.set_ylabel(label, color=GREY, size=8.5)
        axes.tick_params(colors=GREY, labelsize=8, length=3, bottom=False, labelbottom=False)
        axes.spines[["top", "right"]].set_visible(False)
        axes.spines[["left", "bottom"]].set_color(PALE)
        self._shade = self._image(1, SPREADING)
        axes.set_ylim(low, high)

    def _image(self, rows: int, colour: str) -> AxesImage:
        """An image of one colour all over the panel; its columns are the steps, its opacity moves."""
        pixels = np.zeros((rows, self._window, 4), np.uint8)
        pixels[..., :3] = np.round(255 * np.array(to_rgb(colour)))
        style: dict[str, Any] = {"interpolation": "nearest", "origin": "lower", "extent": (0, 1, 0, 1)}
        image = AxesImage(self._axes, animated=True, **style)
        image.set_transform(self._axes.transAxes)
        image.set_data(pixels)
        self._axes.add_image(image)
        self.moving.append(image)
        return image

    def _mark(self, value: float, text: str, colour: str) -> None:
        """A dashed line across the panel, named at its right end."""
        self._axes.axhline(value, color=colour, lw=0.9, ls="--")
        place = self._axes.get_yaxis_transform()
        self._axes.text(1.008, value, text, transform=place, color=colour, size=8, va="center")

    def _line(self, colour: str, **style: Any) -> Line2D:
        (line,) = self._axes.plot([], [], color=colour, animated=True, **style)
        self.moving.append(line)
        return line

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
    """The band over time: jamming footprints, both sides' frequencies, hops and checks."""

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
    """The SNR with and without jamming over time, and the threshold M."""

    def __init__(self, axes: Axes, recording: Recording) -> None:
        super().__init__(axes, recording, "SNR, dB", -20, 100)
        threshold = recording.scenario.snr_threshold_db
        self._mark(threshold, f"M {threshold:g}", INK)
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
    """The distance between the two over time, on a logarithmic axis, and the reward radius."""

    def __init__(self, axes: Axes, recording: Recording) -> None:
        s = recording.scenario
        radius = s.distance_reward_m
        low, high = max(radius, 1) / 4, 1.1 * float(np.linalg.norm(s.box_m))
        axes.set_yscale("log")
        super().__init__(axes, recording, "distance, m", low, high)
        self._mark(radius, f"{radius:g} m", OPPONENT)
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
