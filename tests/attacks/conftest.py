"""The boards of the leaderboard's tests, to be attacked."""

import contextlib

with contextlib.suppress(ModuleNotFoundError):  # of a product that was deleted, as its own tests are
    from tests.products.leaderboard.conftest import board, in_process, small_suites  # noqa: F401
