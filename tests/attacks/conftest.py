"""The boards of the leaderboard's tests, to be attacked."""

from tests.products.leaderboard.conftest import board, in_process, small_suites

__all__ = ["board", "in_process", "small_suites"]
