"""Model of the ally's flight: a curve fitted to the opponent's own positions and rewards, in compiled code.

Measurements. The opponent's reward (Eq. 6) grows with the logarithm of the jamming-to-signal ratio, whose two
path losses (Eq. 1) are at one frequency, plus a bonus E within a distance R. The mean reward over a part of a
round is therefore modelled as

    r = a + s ln(b / d) + E / (1 + (d / R)^4),

where d is the distance from the opponent to the ally in the middle of that part and b the distance from the
base station to the ally. a and s >= 0 stand for the ally's reaction to being jammed.

Model. The ally flies a cubic Bezier curve there and back, the same in every round: four control points and
the speed along the curve, 13 parameters. Several curves are refined side by side by Levenberg-Marquardt
steps, with a and s projected out of each (variable projection, Golub and Pereyra, 1973). The best curves of
earlier rounds are among the starting points of the next fit.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from fpg_bench.game.compiling import compiled
from fpg_bench.game.elementary import log

_compiled = functools.partial(compiled, allocates=True)

PARAMETERS = 13  # four control points, and the speed
SPEED = 12  # index of the speed among the parameters
CHORDS = 32  # chords of a curve, along which it is measured and flown
_BLUR_M = 30.0  # a part's mean reward does not come from its middle alone
_LEAST_VARIANCE = 1e-4
_FIRST_DAMPING, _LAST_DAMPING = 0.01, 1e6
_STEPS = 6  # of each curve's refinement
_FINALS, _FINAL_STEPS = 8, 12  # the best curves are refined further


@_compiled
def measure(parameters, bernstein):
    """Return the ends (CHORDS + 1, 3) of a curve's chords and the curve's length up to each of them."""
    corners, lengths = np.empty((CHORDS + 1, 3)), np.zeros(CHORDS + 1)
    for c in range(CHORDS + 1):
        for axis in range(3):
            place = 0.0
            for point in range(4):
                place += bernstein[c, point] * parameters[3 * point + axis]
            corners[c, axis] = place
        if c > 0:
            squares = 0.0
            for axis in range(3):
                squares += (corners[c, axis] - corners[c - 1, axis]) ** 2
            lengths[c] = lengths[c - 1] + math.sqrt(squares) + 1e-9  # no chord has no length
    return corners, lengths


@_compiled
def locate(metres, lengths):
    """Return the number of turns, the chord and the share of that chord after some metres there and back."""
    turns = int(metres / lengths[CHORDS])
    flown = metres - turns * lengths[CHORDS]
    if turns % 2 == 1:
        flown = lengths[CHORDS] - flown
    low, high = 0, CHORDS
    while high - low > 1:
        middle = (low + high) // 2
        if lengths[middle] <= flown:
            low = middle
        else:
            high = middle
    return turns, low, (flown - lengths[low]) / (lengths[high] - lengths[low])


@_compiled
def trace(parameters, times, bernstein):
    """Return the ally's positions (K, 3) at ``times`` (K,), in s, on a curve.

    ``bernstein`` (CHORDS + 1, 4) holds the control points' weights at the ends of the chords.
    """
    corners, lengths = measure(parameters, bernstein)
    places = np.empty((times.shape[0], 3))
    for k in range(times.shape[0]):
        _, c, share = locate(parameters[SPEED] * times[k], lengths)
        for axis in range(3):
            places[k, axis] = corners[c, axis] + share * (corners[c + 1, axis] - corners[c, axis])
    return places


@_compiled
def differentiate(parameters, times, bernstein):
    """Return the derivatives (K, 3, 13) of the positions on a curve."""
    corners, lengths = measure(parameters, bernstein)
    growth = np.zeros((CHORDS + 1, SPEED))  # derivatives of the lengths
    slopes = np.empty((times.shape[0], 3, PARAMETERS))
    for c in range(CHORDS):
        length = lengths[c + 1] - lengths[c]
        for point in range(4):
            weight = (bernstein[c + 1, point] - bernstein[c, point]) / length
            for axis in range(3):
                p = 3 * point + axis
                growth[c + 1, p] = growth[c, p] + weight * (corners[c + 1, axis] - corners[c, axis])
    for k in range(times.shape[0]):
        turns, c, share = locate(parameters[SPEED] * times[k], lengths)
        back = turns % 2 == 1
        length = lengths[c + 1] - lengths[c]
        for axis in range(3):
            along = (corners[c + 1, axis] - corners[c, axis]) / length  # the place's change per metre flown
            for p in range(SPEED):
                flown = (turns + 1) * growth[CHORDS, p] if back else -turns * growth[CHORDS, p]
                flown -= growth[c, p] + share * (growth[c + 1, p] - growth[c, p])
                slopes[k, axis, p] = flown * along
            for point in range(4):
                weight = bernstein[c, point] + share * (bernstein[c + 1, point] - bernstein[c, point])
                slopes[k, axis, 3 * point + axis] += weight
            slopes[k, axis, SPEED] = -along * times[k] if back else along * times[k]
    return slopes


@_compiled
def regress(places, measured, rules):
    """Fit a and s for given positions of the ally.

    Args:
        places: ``(n, 3)`` in m, the ally in the middle of each part.
        measured: ``(m, 4)`` own position in m and mean reward; measurement j belongs to part j % n.
        rules: ``(5,)`` the base station's position in m, E, and R in m.

    Returns:
        The sum of the squared residuals; s; ``(m,)`` ratios ln(b / d) and ``(m,)`` rewards without the bonus,
        both less their mean.
    """
    m, n = measured.shape[0], places.shape[0]
    ratios, rewards = np.empty(m), np.empty(m)
    ratio, reward = 0.0, 0.0
    for j in range(m):
        place, own = places[j % n], measured[j]
        b, d = _BLUR_M**2, 0.0
        for axis in range(3):
            b += (place[axis] - rules[axis]) ** 2
            d += (place[axis] - own[axis]) ** 2
        near = d / rules[4] ** 2
        ratios[j] = 0.5 * log(b / (d + _BLUR_M**2))
        rewards[j] = own[3] - rules[3] / (1.0 + near * near)
        ratio += ratios[j] / m
        reward += rewards[j] / m
    squares, product, total = 0.0, 0.0, 0.0
    for j in range(m):
        ratios[j] -= ratio
        rewards[j] -= reward
        squares += ratios[j] ** 2
        product += ratios[j] * rewards[j]
        total += rewards[j] ** 2
    slope = max(product, 0.0) / max(squares, 1e-12)
    return max(total - slope * product, 0.0), slope, ratios, rewards


@_compiled
def misfit(squares, count, parameters, prior):
    """Return minus twice the log posterior, with the variance of the noise fitted as well."""
    value = count * log(squares / count + _LEAST_VARIANCE)
    for p in range(PARAMETERS):
        value += ((parameters[p] - prior[0, p]) / prior[1, p]) ** 2
    return value


@_compiled
def _normal_equations(parameters, places, slopes, measured, rules, regression, prior):
    """Return Gauss-Newton's matrix (13, 13), its lower triangle alone, and vector (13,) of the posterior.

    A measurement's derivative is that of its part's place (``gradient``, 3 numbers) times that part's
    slopes, so products are summed over a part before they are expanded to the 13 parameters. ``sums`` (2, 13)
    holds the sum of the derivatives and their product with the ratios, to project out a and s.
    """
    residual, slope, ratios, rewards = regression
    m, n = measured.shape[0], places.shape[0]
    variance, squares = residual / m + _LEAST_VARIANCE, 0.0
    for j in range(m):
        squares += ratios[j] ** 2
    matrix, vector, sums = np.zeros((PARAMETERS, PARAMETERS)), np.zeros(PARAMETERS), np.zeros((2, PARAMETERS))
    for k in range(n):
        gradient = np.zeros(
            (3, 6)
        )  # columns: products with x, y, z; with the residual; with 1; with the ratio
        b = _BLUR_M**2
        for axis in range(3):
            b += (places[k, axis] - rules[axis]) ** 2
        for j in range(k, m, n):
            d = 0.0
            for axis in range(3):
                d += (places[k, axis] - measured[j, axis]) ** 2
            near = d / rules[4] ** 2
            pull = slope / (d + _BLUR_M**2) + 4.0 * rules[3] * near / (rules[4] * (1.0 + near * near)) ** 2
            rest = rewards[j] - slope * ratios[j]
            g0 = slope * (places[k, 0] - rules[0]) / b - pull * (places[k, 0] - measured[j, 0])
            g1 = slope * (places[k, 1] - rules[1]) / b - pull * (places[k, 1] - measured[j, 1])
            g2 = slope * (places[k, 2] - rules[2]) / b - pull * (places[k, 2] - measured[j, 2])
            for axis, g in enumerate((g0, g1, g2)):
                gradient[axis, 0] += g * g0
                gradient[axis, 1] += g * g1
                gradient[axis, 2] += g * g2
                gradient[axis, 3] += g * rest
                gradient[axis, 4] += g
                gradient[axis, 5] += g * ratios[j]
        for p in range(PARAMETERS):
            x, y, z = slopes[k, 0, p], slopes[k, 1, p], slopes[k, 2, p]
            vector[p] += x * gradient[0, 3] + y * gradient[1, 3] + z * gradient[2, 3]
            sums[0, p] += x * gradient[0, 4] + y * gradient[1, 4] + z * gradient[2, 4]
            sums[1, p] += x * gradient[0, 5] + y * gradient[1, 5] + z * gradient[2, 5]
            gx = x * gradient[0, 0] + y * gradient[1, 0] + z * gradient[2, 0]
            gy = x * gradient[0, 1] + y * gradient[1, 1] + z * gradient[2, 1]
            gz = x * gradient[0, 2] + y * gradient[1, 2] + z * gradient[2, 2]
            for q in range(p + 1):
                matrix[p, q] += gx * slopes[k, 0, q] + gy * slopes[k, 1, q] + gz * slopes[k, 2, q]
    for p in range(PARAMETERS):
        for q in range(p + 1):
            taken = sums[0, p] * sums[0, q] / m + sums[1, p] * sums[1, q] / max(squares, 1e-12)
            matrix[p, q] = (matrix[p, q] - taken) / variance
        matrix[p, p] += 1.0 / prior[1, p] ** 2
        vector[p] = vector[p] / variance - (parameters[p] - prior[0, p]) / prior[1, p] ** 2
    return matrix, vector


@_compiled
def _solve(matrix, vector, damping):
    """Solve (matrix + damping diag) step = vector by Cholesky; only the lower triangle is read."""
    factor, step = np.zeros((PARAMETERS, PARAMETERS)), np.zeros(PARAMETERS)
    for p in range(PARAMETERS):
        for q in range(p + 1):
            value = matrix[p, q] * (1.0 + damping if p == q else 1.0)
            for k in range(q):
                value -= factor[p, k] * factor[q, k]
            factor[p, q] = math.sqrt(max(value, 1e-12)) if p == q else value / factor[q, q]
    for p in range(PARAMETERS):
        value = vector[p]
        for k in range(p):
            value -= factor[p, k] * step[k]
        step[p] = value / factor[p, p]
    for p in range(PARAMETERS - 1, -1, -1):
        value = step[p]
        for k in range(p + 1, PARAMETERS):
            value -= factor[k, p] * step[k]
        step[p] = value / factor[p, p]
    return step


@_compiled
def refine(parameters, measured, times, bernstein, rules, prior, bounds, steps):
    """Improve one curve's parameters in place by Levenberg-Marquardt steps; return their misfit."""
    m = measured.shape[0]
    places = trace(parameters, times, bernstein)
    regression = regress(places, measured, rules)
    best, damping, improved = misfit(regression[0], m, parameters, prior), _FIRST_DAMPING, True
    for _ in range(steps):
        if improved:
            slopes = differentiate(parameters, times, bernstein)
            matrix, vector = _normal_equations(parameters, places, slopes, measured, rules, regression, prior)
        step = _solve(matrix, vector, damping)
        trial = np.empty(PARAMETERS)
        for p in range(PARAMETERS):
            trial[p] = min(max(parameters[p] + step[p], bounds[0, p]), bounds[1, p])
        places = trace(trial, times, bernstein)
        regression = regress(places, measured, rules)
        value = misfit(regression[0], m, trial, prior)
        improved = value < best
        damping *= 0.3 if improved else 8.0
        if improved:
            best = value
            for p in range(PARAMETERS):
                parameters[p] = trial[p]
        elif damping > _LAST_DAMPING:
            break
    return best


@_compiled
def _best_first(curves, misfits):
    """Sort a game's curves by their misfits, in place."""
    for s in range(misfits.shape[0]):
        lowest = s + misfits[s:].argmin()
        misfits[s], misfits[lowest] = misfits[lowest], misfits[s]
        for p in range(PARAMETERS):
            curves[s, p], curves[lowest, p] = curves[lowest, p], curves[s, p]


@_compiled
def fit_games(measured, curves, kept, library, library_places, times, bernstein, rules, prior, bounds):
    """Fit the ally's curve of every game: refine some curves a little, and the best of them further.

    Args:
        measured: ``(G, m, 4)``; see :func:`regress`.
        curves: ``(G, S, 13)``, refined in place, best first.
        kept: number of each game's curves that are given; the rest are the library's best.
        library: ``(M, 13)`` curves to start from, and ``library_places`` ``(M, n, 3)``.
        times: ``(n,)`` the middle of each part, in s.
        bernstein: see :func:`trace`.
        rules: see :func:`regress`.
        prior: ``(2, 13)`` mean and standard deviation of the parameters.
        bounds: ``(2, 13)`` lowest and highest parameters.
    """
    scores, misfits = np.empty(library.shape[0]), np.empty(curves.shape[1])
    for g in range(measured.shape[0]):
        for c in range(library.shape[0]):
            scores[c] = regress(library_places[c], measured[g], rules)[0]
        for s in range(kept, curves.shape[1]):
            lowest = scores.argmin()
            scores[lowest] = math.inf
            for p in range(PARAMETERS):
                curves[g, s, p] = library[lowest, p]
        for count, steps in ((curves.shape[1], _STEPS), (_FINALS, _FINAL_STEPS)):
            for s in range(count):
                misfits[s] = refine(curves[g, s], measured[g], times, bernstein, rules, prior, bounds, steps)
            _best_first(curves[g], misfits)
