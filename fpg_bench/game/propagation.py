"""Propagation of the radio model ``link`` beyond free space: buildings in the way, and measured channels.

Gains are relative to free space. Sources: 3GPP TR 36.777, Tables B-1 and B-2 (UMi-AV): how often a path is
in line of sight, and the path loss where it is not; Kay and Kajiya, "Ray tracing complex scenes", SIGGRAPH
1986: the slab method.
"""

from __future__ import annotations

import math

import numpy as np

from fpg_bench.game import rng
from fpg_bench.game.compiling import compiled
from fpg_bench.game.elementary import DB, exp, log
from fpg_bench.game.state import Record

_LOG10 = 0.1 * DB  # log10 x = _LOG10 ln x
# Rows of buildings (5, n): they stand on the ground, their sides along x and y.
WEST, EAST, SOUTH, NORTH, TOP = range(5)
# The heights in m for which TR 36.777 gives a loss without line of sight.
LOWEST_M, HIGHEST_M = 22.5, 300.0


@compiled
def draw_buildings(buildings: np.ndarray, key: np.uint64, rules: Record, radio: Record) -> None:
    """Draw a match's buildings (5, n): uniform places in the box, uniform sides and heights.

    One that comes too near to the base station is not built: its height is 0.
    """
    city, base = rng.bits(key, 0, rng.BUILDINGS), rules.base_station
    sides, tops = radio.building_side, radio.building_height
    for j in range(buildings.shape[1]):
        away = 0.0
        for axis in range(2):
            side = sides[0] + rng.uniform(city, j, axis) * (sides[1] - sides[0])
            low = rng.uniform(city, j, 2 + axis) * (rules.box[axis] - side)
            buildings[2 * axis, j], buildings[2 * axis + 1, j] = low, low + side
            beside = max(low - base[axis], base[axis] - low - side, 0.0)
            away += beside * beside
        top = tops[0] + rng.uniform(city, j, 4) * (tops[1] - tops[0])
        buildings[TOP, j] = top if away >= radio.clearance * radio.clearance else 0.0


@compiled
def in_sight(a: np.ndarray, b: np.ndarray, buildings: np.ndarray, radio: Record) -> bool:
    """Return True if no building stands between two positions (slab method)."""
    if min(a[2], b[2]) >= radio.tallest:
        return True
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    per_x = 1.0 / (x if abs(x) > 1e-9 else 1e-9)
    per_y = 1.0 / (y if abs(y) > 1e-9 else 1e-9)
    blocked = 0
    for j in range(buildings.shape[1]):
        west, east = (buildings[WEST, j] - a[0]) * per_x, (buildings[EAST, j] - a[0]) * per_x
        south, north = (buildings[SOUTH, j] - a[1]) * per_y, (buildings[NORTH, j] - a[1]) * per_y
        enters = max(min(west, east), min(south, north), 0.0)
        leaves = min(max(west, east), max(south, north), 1.0)
        lowest = a[2] + min(enters * z, leaves * z)
        blocked |= (enters < leaves) & (lowest < buildings[TOP, j])
    return blocked == 0


@compiled
def blocked_gain(metres: float, height_m: float, rules: Record) -> float:
    """Return the gain of a path without line of sight, at most 1 (TR 36.777, UMi-AV).

    The loss is 32.4 + (43.2 - 7.6 log10 h) log10 d + 20 log10 f dB with d in m and f in GHz. h is the height
    of the higher end, which stands for that of the aerial vehicle.
    """
    height = min(max(height_m, LOWEST_M), HIGHEST_M)
    slope = 23.2 - 7.6 * _LOG10 * log(height)  # 20 log10 d is free space
    excess = slope * _LOG10 * log(max(metres, rules.minimum_distance)) + 32.4 - rules.path_loss_constant
    return exp(-max(excess, 0.0) / DB)


@compiled
def path_gain(
    a: np.ndarray, b: np.ndarray, metres: float, buildings: np.ndarray, rules: Record, radio: Record
) -> float:
    """Return the gain of the path between two positions, 1 in line of sight."""
    if in_sight(a, b, buildings, radio):
        return 1.0
    return blocked_gain(metres, max(a[2], b[2]), rules)


@compiled
def propagate(
    game: Record, distance_to_base_m: float, buildings: np.ndarray, rules: Record, radio: Record
) -> None:
    """Compute the gains from base station and opponent to the ally; both ends of a path have the same."""
    ally = game.ally_position
    game.base_gain = path_gain(rules.base_station, ally, distance_to_base_m, buildings, rules, radio)
    game.in_sight = in_sight(game.opponent_position, ally, buildings, radio)
    higher = max(game.opponent_position[2], ally[2])
    game.opponent_gain = 1.0 if game.in_sight else blocked_gain(game.distance_m, higher, rules)


@compiled
def channel_gain(
    channel: tuple[np.ndarray, np.ndarray, np.ndarray],
    place: np.ndarray,
    metres: float,
    frequency_mhz: float,
    rules: Record,
    radio: Record,
) -> float:
    """Return the gain of a channel's grid at a place in it, trilinear in dB, over that of free space."""
    gain_db, origin, per_spacing = channel
    x, i = _in_grid(place[0], origin[0], per_spacing[0], gain_db.shape[0])
    y, j = _in_grid(place[1], origin[1], per_spacing[1], gain_db.shape[1])
    z, k = _in_grid(place[2], origin[2], per_spacing[2], gain_db.shape[2])
    total = 0.0
    for a in range(2):
        for b in range(2):
            for c in range(2):
                share = (x if a else 1.0 - x) * (y if b else 1.0 - y) * (z if c else 1.0 - z)
                total += share * gain_db[i + a, j + b, k + c]
    product = max(metres, rules.minimum_distance) * frequency_mhz
    return exp(total / DB) * product * product / radio.path_gain


@compiled
def _in_grid(place: float, origin: float, per_spacing: float, count: int) -> tuple[float, int]:
    """Return how far a coordinate lies in its cell, in [0, 1], and the cell's index."""
    along = (place - origin) * per_spacing
    cell = min(max(math.floor(along), 0), count - 2)
    return along - cell, cell


@compiled
def keep_out(
    position: np.ndarray, x: float, y: float, z: float, climb: float, buildings: np.ndarray, radio: Record
) -> None:
    """Let an opponent that flew from (x, y, z) into a building climb in front of it by ``climb`` metres."""
    if position[2] < radio.tallest and roof_m(position, buildings) > position[2]:
        position[0], position[1], position[2] = x, y, z + climb


@compiled
def roof_m(position: np.ndarray, buildings: np.ndarray) -> float:
    """Return the height of the highest roof at a position, 0 beside all buildings."""
    x, y, roof = position[0], position[1], 0.0
    for j in range(buildings.shape[1]):
        within = (x > buildings[WEST, j]) & (x < buildings[EAST, j])
        within &= (y > buildings[SOUTH, j]) & (y < buildings[NORTH, j])
        roof = max(roof, buildings[TOP, j] if within else 0.0)
    return roof
