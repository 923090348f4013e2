"""The picture's view of the box: both tracks in space, their shadows, the link and the jamming."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.text import Text

from fpg_bench.rendering.canvas import ALLY, OPPONENT, SIDE_COLOURS
from fpg_bench.rendering.recording import Recording

SPREADING = "#56B4E9"
INK, GREY, PALE, GROUND = "#1b1f24", "#5f6773", "#cdd3db", "#f1f4f8"
_AZIMUTH, _ELEVATION = math.radians(-62), math.radians(40)
_DOTTED = (0, (1, 3))


def project(points: Any) -> np.ndarray:
    """Parallel projection of points ``(..., 3)`` in m, z up, onto the picture's plane ``(..., 2)``."""
    x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
    across = y * math.cos(_AZIMUTH) - x * math.sin(_AZIMUTH)
    deep = x * math.cos(_AZIMUTH) + y * math.sin(_AZIMUTH)
    return np.stack([across, z * math.cos(_ELEVATION) - deep * math.sin(_ELEVATION)], axis=-1)


def bezier_curve(control_points: np.ndarray) -> np.ndarray:
    """``(100, 3)`` places along the cubic Bezier curve of ``(4, 3)`` control points."""
    t = np.linspace(0, 1, 100)[:, None]
    u = 1 - t
    return np.hstack([u**3, 3 * u * u * t, 3 * u * t * t, t**3]) @ control_points


class ArenaPanel:
    """Draws the box and the plans once; :meth:`update` sets the artists in ``moving``.

    Args:
        axes: where to draw.
        recording: the round that will be shown.
    """

    def __init__(self, axes: Axes, recording: Recording) -> None:
        self._axes, self._scenario = axes, recording.scenario
        self._base = np.array(self._scenario.base_station_m)
        self.moving: list[Artist] = []
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

    def _line(self, colour: str, **style: Any) -> Line2D:
        (line,) = self._axes.plot([], [], color=colour, animated=True, **style)
        self.moving.append(line)
        return line

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

    def _path(self, *points: Any, **style: Any) -> None:
        self._axes.plot(*project(points).T, **style)

    def _note(self, text: str, place: Any, offset: tuple[float, float], **style: Any) -> None:
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
        """The ally's whole curve, and the waypoints where the opponent flies a plan."""
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
        """The upper one's name above it, the lower one's below it, the distance beside the line between."""
        ally, opponent = project(last["ally_position"]), project(last["opponent_position"])
        upward = 1 if ally[1] >= opponent[1] else -1
        left, right = self._axes.get_xlim()
        for side, place, away in (("ally", ally, upward), ("opponent", opponent, -upward)):
            across = min(max(place[0], left + self._room), right - self._room)
            self._labels[side].set_position((across, place[1] + away * self._room / 3.5))
        across, upwards = (ally + opponent) / 2
        if abs(ally[0] - opponent[0]) < self._room:  # else it would stand under a marker
            across = max(ally[0], opponent[0])
        self._distance.set_position((across + self._room / 2, upwards))
        self._distance.set_text(f"{last['distance_m']:.0f} m")

    def _set(self, line: Line2D, *points: Any) -> None:
        line.set_data(*project(points).T)
