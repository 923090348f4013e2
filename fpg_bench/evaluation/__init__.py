"""Measures under one protocol: fields, entries, lines, summaries and tables."""
