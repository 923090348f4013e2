"""Measures under one protocol: suites, entries, lines, summaries and tables."""
