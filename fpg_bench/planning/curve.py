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

import math

from fpg_bench.game.compiling import compiled

PARAMETERS = 13  # four control points, and the speed
SPEED = 12  # index of the speed among the parameters
CHORDS = 32  # chords of a curve, along which it is measured and flown
_BLUR_M = 30.0  # a part's mean reward does not come from its middle alone
_LEAST_VARIANCE = 1e-4
_FIRST_DAMPING, _LAST_DAMPING = 0.01, 1e6


@compiled
def measure(parameters, bernstein, corners, lengths):
    """Fill the ends of a curve's chords (``corners``) and the curve's length up to each of them."""
    lengths[0] = 0.0
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


@compiled
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


@compiled
def trace(parameters, times, bernstein, places, corners, lengths):
    """Fill ``places`` (K, 3) with the ally's positions at ``times`` (K,), in s, on a curve.

    ``bernstein`` (CHORDS + 1, 4) holds the control points' weights at the ends of the chords;
    ``corners`` (CHORDS + 1, 3) and ``lengths`` (CHORDS + 1,) are filled with those ends.
    """
    measure(parameters, bernstein, corners, lengths)
    for k in range(times.shape[0]):
        _, c, share = locate(parameters[SPEED] * times[k], lengths)
        for axis in range(3):
            places[k, axis] = corners[c, axis] + share * (corners[c + 1, axis] - corners[c, axis])


@compiled
def differentiate(parameters, times, bernstein, corners, lengths, growth, slopes):
    """Fill ``slopes`` (n, 3, 13) with the derivatives of the places on a curve that was just traced.

    ``growth`` (CHORDS + 1, 12) is filled with the derivatives of the lengths.
    """
    growth[0] = 0.0
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


@compiled
def regress(places, measured, rules, ratios, rewards, fit):
    """Fit a and s for given positions of the ally.

    Args:
        places: ``(n, 3)`` in m, the ally in the middle of each part.
        measured: ``(m, 4)`` own position in m and mean reward; measurement j belongs to part j % n.
        rules: ``(5,)`` the base station's position in m, E, and R in m.
        ratios, rewards: ``(m,)``, filled with ln(b / d) less its mean, and the rewards less the bonus.
        fit: ``(3,)``, filled with the mean of those rewards, s, and the sum of squared ratios.

    Returns:
        The sum of the squared residuals.
    """
    m, n = measured.shape[0], places.shape[0]
    ratio, reward = 0.0, 0.0
    for j in range(m):
        place, own = places[j % n], measured[j]
        b, d = _BLUR_M**2, 0.0
        for axis in range(3):
            b += (place[axis] - rules[axis]) ** 2
            d += (place[axis] - own[axis]) ** 2
        near = d / rules[4] ** 2
        ratios[j] = 0.5 * math.log(b / (d + _BLUR_M**2))
        rewards[j] = own[3] - rules[3] / (1.0 + near * near)
        ratio += ratios[j] / m
        reward += rewards[j] / m
    squares, product, total = 0.0, 0.0, 0.0
    for j in range(m):
        ratios[j] -= ratio
        squares += ratios[j] ** 2
        product += ratios[j] * (rewards[j] - reward)
        total += (rewards[j] - reward) ** 2
    fit[0], fit[1], fit[2] = reward, max(product, 0.0) / max(squares, 1e-12), squares
    return max(total - fit[1] * product, 0.0)


@compiled
def misfit(squares, count, parameters, prior):
    """Return minus twice the log posterior, with the variance of the noise fitted as well."""
    value = count * math.log(squares / count + _LEAST_VARIANCE)
    for p in range(PARAMETERS):
        value += ((parameters[p] - prior[0, p]) / prior[1, p]) ** 2
    return value


@compiled
def _normal_equations(
    parameters, places, slopes, measured, rules, ratios, rewards, fit, variance, prior, gradient, sums,
    matrix, vector,
):  # fmt: skip
    """Fill Gauss-Newton's ``matrix`` (lower triangle) and ``vector`` of the posterior.

    A measurement's derivative is that of its part's place (``gradient``, 3 numbers) times that part's
    slopes, so products are summed over a part before they are expanded to the 13 parameters. ``sums`` (2, 13)
    holds the sum of the derivatives and their product with the ratios, to project out a and s.
    """
    m, n = measured.shape[0], places.shape[0]
    vector[:] = 0.0
    sums[:] = 0.0
    matrix[:] = 0.0
    for k in range(n):
        gradient[:] = 0.0  # columns: products with x, y, z; with the residual; with 1; with the ratio
        b = _BLUR_M**2
        for axis in range(3):
            b += (places[k, axis] - rules[axis]) ** 2
        for j in range(k, m, n):
            d = 0.0
            for axis in range(3):
                d += (places[k, axis] - measured[j, axis]) ** 2
            near = d / rules[4] ** 2
            pull = fit[1] / (d + _BLUR_M**2) + 4.0 * rules[3] * near / (rules[4] * (1.0 + near * near)) ** 2
            rest = rewards[j] - fit[0] - fit[1] * ratios[j]
            g0 = fit[1] * (places[k, 0] - rules[0]) / b - pull * (places[k, 0] - measured[j, 0])
            g1 = fit[1] * (places[k, 1] - rules[1]) / b - pull * (places[k, 1] - measured[j, 1])
            g2 = fit[1] * (places[k, 2] - rules[2]) / b - pull * (places[k, 2] - measured[j, 2])
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
            taken = sums[0, p] * sums[0, q] / m + sums[1, p] * sums[1, q] / max(fit[2], 1e-12)
            matrix[p, q] = (matrix[p, q] - taken) / variance
        matrix[p, p] += 1.0 / prior[1, p] ** 2
        vector[p] = vector[p] / variance - (parameters[p] - prior[0, p]) / prior[1, p] ** 2


@compiled
def _solve(matrix, vector, damping, factor, step):
    """Solve (matrix + damping diag) step = vector by Cholesky; lower triangles are read and written."""
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


@compiled
def refine(parameters, measured, times, bernstein, rules, prior, bounds, steps, scratch):
    """Improve one curve's parameters in place by Levenberg-Marquardt steps; return their misfit."""
    (ratios, rewards, fit, matrix, factor, vector, step, trial, sums, gradient, places, growth, slopes,
     corners, lengths) = scratch  # fmt: skip
    m = measured.shape[0]
    trace(parameters, times, bernstein, places, corners, lengths)
    squares = regress(places, measured, rules, ratios, rewards, fit)
    best, damping, improved = misfit(squares, m, parameters, prior), _FIRST_DAMPING, True
    for _ in range(steps):
        if improved:
            differentiate(parameters, times, bernstein, corners, lengths, growth, slopes)
            _normal_equations(
                parameters, places, slopes, measured, rules, ratios, rewards, fit,
                squares / m + _LEAST_VARIANCE, prior, gradient, sums, matrix, vector,
            )  # fmt: skip
        _solve(matrix, vector, damping, factor, step)
        for p in range(PARAMETERS):
            trial[p] = min(max(parameters[p] + step[p], bounds[0, p]), bounds[1, p])
        trace(trial, times, bernstein, places, corners, lengths)
        squares = regress(places, measured, rules, ratios, rewards, fit)
        value = misfit(squares, m, trial, prior)
        improved = value < best
        damping *= 0.3 if improved else 8.0
        if improved:
            best = value
            for p in range(PARAMETERS):
                parameters[p] = trial[p]
        elif damping > _LAST_DAMPING:
            break
    return best


@compiled
def _best_first(curves, misfits):
    """Sort a game's curves by their misfits, in place."""
    for s in range(misfits.shape[0]):
        lowest = s
        for r in range(s + 1, misfits.shape[0]):
            if misfits[r] < misfits[lowest]:
                lowest = r
        misfits[s], misfits[lowest] = misfits[lowest], misfits[s]
        for p in range(PARAMETERS):
            curves[s, p], curves[lowest, p] = curves[lowest, p], curves[s, p]


@compiled
def fit_games(
    measured, library, library_places, times, bernstein, rules, prior, bounds, kept, steps, finals,
    final_steps, curves, misfits, explained, scores, scratch,
):  # fmt: skip
    """Fit the ally's curve of every game: refine some curves a little, and the best of them further.

    Args:
        measured: ``(G, m, 4)``; see :func:`regress`.
        library: ``(M, 13)`` curves to start from, and ``library_places`` ``(M, n, 3)``.
        times: ``(n,)`` the middle of each part, in s.
        prior: ``(2, 13)`` mean and standard deviation of the parameters. bounds: ``(2, 13)``.
        kept: number of each game's ``curves`` that are given; the rest are the library's best.
        steps, finals, final_steps: each curve is refined by ``steps``, then the best ``finals`` by more.
        curves: ``(G, S, 13)``, refined in place, best first. misfits: ``(G, S)``, filled.
        explained: ``(G,)``, filled with the share of the rewards' variance that the best curve explains.
        scores: ``(M,)``, and ``scratch``: scratch arrays.
    """
    ratios, rewards, fit = scratch[0], scratch[1], scratch[2]
    places, corners, lengths = scratch[10], scratch[13], scratch[14]
    for g in range(measured.shape[0]):
        for c in range(library.shape[0]):
            scores[c] = regress(library_places[c], measured[g], rules, ratios, rewards, fit)
        for s in range(kept, curves.shape[1]):
            lowest = 0
            for c in range(library.shape[0]):
                if scores[c] < scores[lowest]:
                    lowest = c
            scores[lowest] = math.inf
            for p in range(PARAMETERS):
                curves[g, s, p] = library[lowest, p]
        for rank in range(2):
            for s in range(finals if rank else curves.shape[1]):
                misfits[g, s] = refine(
                    curves[g, s], measured[g], times, bernstein, rules, prior, bounds,
                    final_steps if rank else steps, scratch,
                )  # fmt: skip
            _best_first(curves[g], misfits[g])
        trace(curves[g, 0], times, bernstein, places, corners, lengths)
        squares = regress(places, measured[g], rules, ratios, rewards, fit)
        mean, total = 0.0, 0.0
        for j in range(measured.shape[1]):
            mean += measured[g, j, 3] / measured.shape[1]
        for j in range(measured.shape[1]):
            total += (measured[g, j, 3] - mean) ** 2
        explained[g] = 1.0 - squares / max(total, 1e-12)
