"""Errors, checks, files, rows, ids and parallel jobs: what every package stands on."""
