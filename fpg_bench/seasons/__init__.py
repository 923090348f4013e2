"""Seasons: suites of rivals that are trained, in the open, after all entries are in."""
