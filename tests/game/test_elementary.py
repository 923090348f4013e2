"""Elementary functions against mpmath, and their edges."""

from __future__ import annotations

import math
import re
from pathlib import Path

import mpmath
import numpy as np
import pytest

from fpg_bench.game import elementary

SMALL = np.exp(np.random.default_rng(0).uniform(-36, 0, 2000))
EVEN = np.random.default_rng(1).uniform(-1, 1, 3000)
WHOLE = np.exp(708 * EVEN)  # all normal numbers
RIGHT_ANGLES = np.arange(1, 1000) * math.pi / 2

RANGES = {
    "log": (1, [*WHOLE, *(1 + SMALL), *(1 - SMALL / 2), 5e-324, 1e-310, 1.7e308]),
    "log2": (2, [*WHOLE, *(1 + SMALL)]),
    "log1p": (2, [*SMALL, *-SMALL[SMALL < 0.999], *(3 * EVEN[EVEN > -0.3]), *WHOLE]),
    "exp": (1, [*(709 * EVEN), *EVEN, *SMALL, *-SMALL, 709.78]),
    "sin": (2, [*(7 * EVEN), *(1e4 * EVEN), *RIGHT_ANGLES, *SMALL]),
    "cos": (2, [*(7 * EVEN), *(1e4 * EVEN), *RIGHT_ANGLES, *SMALL]),
    "acos": (2, [*EVEN, *(1 - SMALL), *(SMALL - 1), 0.5, -0.5]),
}


@pytest.mark.parametrize("name", RANGES)
def test_a_function_errs_by_no_more_than_it_says(name):
    bound, values = RANGES[name]
    function, exact = getattr(elementary, name), getattr(mpmath, name, lambda x: mpmath.log(x, 2))
    with mpmath.workprec(200):
        for x in map(float, values):
            wanted = exact(mpmath.mpf(x))
            error = abs(mpmath.mpf(function(x)) - wanted) / math.ulp(float(wanted))
            assert error <= bound, x


def test_far_angles_lose_one_more_ulp():
    with mpmath.workprec(200):
        for x in map(float, 1e6 * EVEN):
            for got, wanted in zip(elementary.sin_cos(x), mpmath.cos_sin(x)[::-1], strict=True):
                assert abs(got - wanted) <= 3 * math.ulp(float(wanted)), x


@pytest.mark.parametrize(
    ("name", "x", "result"),
    [
        *[("log", 0.0, -math.inf), ("log", 1.0, 0.0), ("log", math.inf, math.inf), ("log", -1.0, math.nan)],
        *[("log1p", -1.0, -math.inf), ("log1p", 0.0, 0.0), ("log1p", math.inf, math.inf)],
        *[("exp", 0.0, 1.0), ("exp", 800.0, math.inf), ("exp", -800.0, 0.0), ("exp", -745.0, 5e-324)],
        *[("exp", -math.inf, 0.0), ("exp", math.inf, math.inf), ("sin", 0.0, 0.0), ("cos", 0.0, 1.0)],
        *[("acos", 1.0, 0.0), ("acos", 0.0, math.pi / 2), ("acos", -1.0, math.pi)],
        *[(name, math.nan, math.nan) for name in RANGES],
    ],
)
def test_an_edge(name, x, result):
    assert getattr(elementary, name)(x) == pytest.approx(result, rel=0, abs=0, nan_ok=True)


def test_the_game_and_its_players_use_no_function_of_another_library():
    """But for ``search.py``, which solves equations in a library that is not the same everywhere anyway, and
    ``stack.py``, which plays trained rivals in training alone.
    """
    package = Path(elementary.__file__).parents[1]
    other = r"\b(math|np)\.(a?cos|a?sin|a?tan|exp|log|pow)\w*\("
    folders = [package / name for name in ("game", "players", "products/planning")]
    files = [path for folder in folders for path in folder.glob("*.py")]
    assert {path.name for path in files if re.search(other, path.read_text())} - {"search.py"} == {"stack.py"}
