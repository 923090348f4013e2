"""Evaluation under one protocol: suites, entries, records, summaries and tables."""
