"""Flight: the ally's Bezier curve; the opponent's patrols, pursuit, waypoints and own flight.

A ``game`` is a record of dtype ``state.GAME``; positions are changed in place.
"""

from __future__ import annotations

import math

import numpy as np

from fpg_bench.game.actions import VELOCITY
from fpg_bench.game.compiling import compiled
from fpg_bench.game.elementary import cos, sin
from fpg_bench.game.names import PATHS
from fpg_bench.game.state import Record

CIRCLE, TRIANGLE, RECTANGLE, PURSUIT, LEARNED, WAYPOINTS = range(len(PATHS))


@compiled
def distance_m(a: np.ndarray, b: np.ndarray) -> float:
    """Return the Euclidean distance of two positions in m."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@compiled
def bezier(control_points: np.ndarray, axis: int, t: float) -> float:
    """Return one coordinate of the cubic Bezier curve at the parameter t in [0, 1]."""
    u = 1.0 - t
    return (
        u * u * u * control_points[0, axis]
        + 3.0 * u * u * t * control_points[1, axis]
        + 3.0 * u * t * t * control_points[2, axis]
        + t * t * t * control_points[3, axis]
    )


@compiled
def begin_curve(game: Record, chords: int) -> None:
    """Put the ally at the start of its curve, flying outbound."""
    game.chord, game.outbound = -1, True
    for axis in range(3):
        game.ally_position[axis] = bezier(game.control_points, axis, 0.0)
        game.chord_start[axis], game.chord_vector[axis] = game.ally_position[axis], 0.0
    _enter_next_chord(game, chords)


@compiled
def fly_curve(game: Record, metres: float, rules: Record) -> None:
    """Move the ally along its curve by arc length (in chords); it turns round at both ends."""
    left = metres
    for _ in range(4 * rules.chords):  # a bound for curves of (almost) no length
        room = game.chord_length_m - game.chord_offset_m if game.outbound else game.chord_offset_m
        if left < room:
            game.chord_offset_m += left if game.outbound else -left
            share = game.chord_offset_m / game.chord_length_m
            for axis in range(3):
                game.ally_position[axis] = game.chord_start[axis] + share * game.chord_vector[axis]
            return
        left -= room
        _enter_next_chord(game, rules.chords)


@compiled
def _enter_next_chord(game: Record, chords: int) -> None:
    """Move to the next chord in the direction of flight, or turn round on the last one."""
    curve, start, vector = game.control_points, game.chord_start, game.chord_vector
    if game.chord == (chords - 1 if game.outbound else 0):
        game.outbound = not game.outbound
    elif game.outbound:
        game.chord += 1
        for axis in range(3):
            start[axis] += vector[axis]
            vector[axis] = bezier(curve, axis, (game.chord + 1) / chords) - start[axis]
    else:
        game.chord -= 1
        for axis in range(3):
            end = start[axis]
            start[axis] = bezier(curve, axis, game.chord / chords)
            vector[axis] = end - start[axis]
    game.chord_length_m = math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    game.chord_offset_m = 0.0 if game.outbound else game.chord_length_m


@compiled
def place_on_patrol(position: np.ndarray, path: int, flown_m: float, rules: Record) -> None:
    """Compute the position on a patrol after ``flown_m`` metres, counter-clockwise from +x.

    The polygons are regular, their first corner at +x, and inscribed in the circle.
    """
    radius, centre = rules.patrol_radius, rules.patrol_centre
    if path == CIRCLE:
        x, y = cos(flown_m / radius), sin(flown_m / radius)
    else:
        corners = 3 if path == TRIANGLE else 4
        angle = 2.0 * math.pi / corners
        sides = flown_m / (2.0 * radius * sin(angle / 2.0))
        corner = math.floor(sides)
        share = sides - corner
        a, b = angle * corner, angle * (corner + 1)
        x = (1.0 - share) * cos(a) + share * cos(b)
        y = (1.0 - share) * sin(a) + share * sin(b)
    position[0], position[1], position[2] = centre[0] + radius * x, centre[1] + radius * y, centre[2]


@compiled
def _fly_to(position: np.ndarray, target: np.ndarray, metres: float) -> None:
    """Move towards a target by at most ``metres``."""
    distance = distance_m(position, target)
    if distance > 0.0:
        share = min(metres, distance) / distance
        for axis in range(3):
            position[axis] += share * (target[axis] - position[axis])


@compiled
def fly_waypoints(position: np.ndarray, waypoints: np.ndarray, step: int, horizon: int, speed: float) -> None:
    """Move towards the next waypoint, to arrive when it is due: waypoint i at (i + 1) T / n."""
    n = waypoints.shape[0]
    due = (step * n) // horizon
    seconds = -((-(due + 1) * horizon) // n) - step
    _fly_to(position, waypoints[due], min(speed, distance_m(position, waypoints[due]) / seconds))


@compiled
def fly_opponent(game: Record, action: np.ndarray, waypoints: np.ndarray, rules: Record) -> None:
    """Move the opponent by one second, before the ally moves: pursuit aims at the ally's start."""
    position, speed, step = game.opponent_position, rules.opponent_speed, game.step
    if game.path <= RECTANGLE:
        place_on_patrol(position, game.path, speed * (step + 1), rules)
    elif game.path == PURSUIT:
        _fly_to(position, game.ally_position, speed)
    elif game.path == LEARNED:
        x, y, z = action[VELOCITY], action[VELOCITY + 1], action[VELOCITY + 2]
        length = math.sqrt(x**2 + y**2 + z**2)
        for axis in range(3):
            position[axis] += speed * action[VELOCITY + axis] / max(1.0, length)
    else:
        fly_waypoints(position, waypoints, step, rules.steps, speed)
    keep_inside(position, rules)


# Rotary-wing aircraft of Zeng, Xu and Zhang, "Energy minimization for wireless communication with rotary-wing
# UAV", IEEE Transactions on Wireless Communications 18(4), 2019, Table I (weight 20 N, four rotors).
BLADE_W, INDUCED_W = 79.8563, 88.6279  # P_0 and P_i, in hover
TIP_M_S, INDUCED_M_S = (
    120.0,
    4.03,
)  # U_tip, speed of the blades' tips; v_0, of the air through the rotor in hover
DRAG_W = 0.5 * 0.6 * 1.225 * 0.05 * 0.503  # times v^3: half of d_0 rho s A


@compiled
def rotary_wing_w(speed_m_s: float) -> float:
    """Return the power in W of level flight at a constant speed, Eq. 12 of Zeng, Xu and Zhang.

    Its parts are the drag of the blades, the thrust against the weight, and the drag of the body. It falls
    from 168 W in hover to 126 W at 10 m/s, and rises from there on.
    """
    square = speed_m_s * speed_m_s
    half = square / (2.0 * INDUCED_M_S * INDUCED_M_S)
    blade = BLADE_W * (1.0 + 3.0 * square / (TIP_M_S * TIP_M_S))
    induced = INDUCED_W * math.sqrt(math.sqrt(1.0 + half * half) - half)
    return blade + induced + DRAG_W * square * speed_m_s


def thriftiest_m_s() -> float:
    """Return the speed of the least power of :func:`rotary_wing_w`, about 10.2 m/s, by ternary search."""
    low, high = 0.0, 30.0
    while high - low > 1e-7:
        left, right = low + (high - low) / 3, high - (high - low) / 3
        low, high = (low, right) if rotary_wing_w(left) < rotary_wing_w(right) else (left, high)
    return low


@compiled
def keep_inside(position: np.ndarray, rules: Record) -> None:
    """Clip a position to the box."""
    for axis in range(3):
        position[axis] = min(max(position[axis], 0.0), rules.box[axis])
