"""Measures under one protocol: panels, the match runner, rows, statistics and tables."""
