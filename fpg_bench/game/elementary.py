"""Elementary functions of IEEE basic operations alone, so that a game has the same bits on every machine.

C libraries choose among versions of ``log``, ``exp`` and ``sin`` by processor, and these differ in the last
bit. Addition, multiplication, division, square root and moving bits do not, as long as no product and sum
are fused; Numba fuses none. Series are Taylor's, cut where the rest is below half an ulp, but that of
``acos``: (arcsin s - s) / s^3 over z = s^2 from 0 to 1/4, by ``mpmath.chebyfit`` with 13 terms. Ranges are
reduced as by Cody and Waite, *Software Manual for the Elementary Functions*, 1980: a constant in parts, the
first of which have so few bits that products with the multiple are exact. The errors stated are bounds of
those found against mpmath (``tests/game/test_elementary.py``).
"""

from __future__ import annotations

import math

import numpy as np

from fpg_bench.game.compiling import compiled

LN2, LN10 = 0.6931471805599453, 2.302585092994046
DB = 10.0 / LN10  # 10 log10 x = DB ln x
_LN2_HIGH, _LN2_LOW = 0.6931471804855391, 7.440617110012397e-11  # 33 bits, and the rest
_HALF_PI = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)  # 33 bits, 33 bits, the rest
_ARC_SINE = (  # from z^12 down to 1
    *(0.028757851367421566, -0.014851887071247204, 0.01740087944269402, 0.005457506718640358),
    *(0.01032281433018578, 0.011479177415184906, 0.013971212973552933, 0.017352392720869973),
    *(0.02237217294214989, 0.030381944138531247, 0.04464285714635543, 0.07499999999998433),
    0.16666666666666669,
)
_TO_INTEGER = 6755399441055744.0  # 1.5 * 2^52: added and subtracted again, it rounds to an integer
_SQRT_HALF_BITS = 0x3FE6A09E667F3BCD
_LEAST_NORMAL = 2.2250738585072014e-308


@compiled
def _power_of_two(k: int) -> float:
    return np.int64((k + 1023) << 52).view(np.float64)


@compiled
def log(x: float) -> float:
    """Return the natural logarithm, within 1 ulp; -inf at 0, NaN below."""
    shift = 0
    if not _LEAST_NORMAL <= x < math.inf:
        if not 0.0 < x < math.inf:
            return x if x > 0.0 else (-math.inf if x == 0.0 else math.nan)
        x, shift = x * 18014398509481984.0, 54  # 2^54: a subnormal number
    word = np.float64(x).view(np.int64)
    k = (word - _SQRT_HALF_BITS) >> 52
    f = np.int64(word - (k << 52)).view(np.float64) - 1.0  # x = 2^k (1 + f), 1 + f within sqrt(2) of 1
    s = f / (2.0 + f)  # ln(1 + f) = 2 artanh s = f - s (f - rest)
    z = s * s
    w = z * z
    v = w * w
    rest = z * (2 / 3 + w * (2 / 7) + v * (2 / 11 + w * (2 / 15) + v * (2 / 19)))
    rest += w * (2 / 5 + w * (2 / 9) + v * (2 / 13 + w * (2 / 17)))
    half = 0.5 * f * f
    n = float(k - shift)
    return n * _LN2_HIGH - ((half - (s * (half + rest) + n * _LN2_LOW)) - f)


@compiled
def log2(x: float) -> float:
    """Return the logarithm to the base 2, within 2 ulp."""
    return log(x) * (1.0 / LN2)


@compiled
def log1p(x: float) -> float:
    """Return ln(1 + x), within 2 ulp."""
    u = 1.0 + x
    if not 0.0 < u < math.inf:
        return log(u)
    return log(u) + (x - (u - 1.0) if x < 1.0 else 1.0 - (u - x)) / u


@compiled
def exp(x: float) -> float:
    """Return e^x, within 1 ulp; inf above the range, 0 below."""
    if not -746.0 < x < 710.0:
        return math.inf if x > 0.0 else (0.0 if x < 0.0 else x)
    n = x * (1.0 / LN2) + _TO_INTEGER - _TO_INTEGER
    high, low = x - n * _LN2_HIGH, n * _LN2_LOW
    r = high - low
    z = r * r  # (e^r + 1) / (e^r - 1) = coth(r / 2), a series with Bernoulli's numbers
    w = z * z
    c = z * (1 / 6 + w * (1 / 15120 + w * (1 / 23950080)))
    c = r - (c - w * (1 / 360 + w * (1 / 604800 + w * (691 / 653837184000))))
    k = int(n)
    result = 1.0 + (high - (low - r * c / (2.0 - c)))
    if -1022 < k < 1024:
        return result * _power_of_two(k)
    return result * _power_of_two(k >> 1) * _power_of_two(k - (k >> 1))


@compiled
def sin_cos(x: float) -> tuple[float, float]:
    """Return the sine and the cosine, within 2 ulp up to |x| = 1e4, 3 ulp up to 1e6."""
    n = x * (1.0 / _HALF_PI[0]) + _TO_INTEGER - _TO_INTEGER
    r = x - n * _HALF_PI[0] - n * _HALF_PI[1] - n * _HALF_PI[2]
    z = r * r
    w = z * z
    v = w * w
    odd = 1 / 6 + w * (1 / 5040) + v * (1 / 39916800 + w * (1 / 1307674368000))
    odd -= z * (1 / 120 + w * (1 / 362880) + v * (1 / 6227020800))
    even = 1 / 24 + w * (1 / 40320) + v * (1 / 479001600 + w * (1 / 20922789888000))
    even -= z * (1 / 720 + w * (1 / 3628800) + v * (1 / 87178291200))
    sine, cosine = r - r * z * odd, 1.0 - 0.5 * z + w * even
    quarters = int(n)
    if quarters & 1:
        sine, cosine = cosine, -sine
    return (-sine, -cosine) if quarters & 2 else (sine, cosine)


@compiled
def sin(x: float) -> float:
    """Return the sine; see :func:`sin_cos`."""
    return sin_cos(x)[0]


@compiled
def cos(x: float) -> float:
    """Return the cosine; see :func:`sin_cos`."""
    return sin_cos(x)[1]


@compiled
def acos(x: float) -> float:
    """Return the angle in [0, pi] whose cosine is ``x`` in [-1, 1], within 2 ulp."""
    size = abs(x)
    z = size * size if size <= 0.5 else 0.5 * (1.0 - size)
    s = size if size <= 0.5 else math.sqrt(z)
    rest = 0.0
    for coefficient in _ARC_SINE:
        rest = rest * z + coefficient
    angle = s + s * z * rest  # the arc sine of s
    if size <= 0.5:
        return 0.5 * math.pi - math.copysign(angle, x)
    return 2.0 * angle if x > 0.0 else math.pi - 2.0 * angle
