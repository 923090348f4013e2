"""Where an ally is when along a Bezier curve, and how that moves with the curve and the speed."""

from __future__ import annotations

import math

from fpg_bench.game.compiling import compiled

CHORDS = 32  # of a curve, along which it is measured and flown
SPEED = 12  # which of the parameters it is


@compiled
def measure(parameters, bernstein, corners, lengths):
    """Fill the ends of the chords of a curve, and the curve's lengths up to them."""
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
    """After so many metres there and back: how often it has turned, its chord, and the share of that."""
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
    """Fill ``places`` (K, 3) with where the ally is at ``times`` (K,), in s, on the curve of some parameters.

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

    ``growth`` (CHORDS + 1, 12) is filled with those of the lengths.
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
