"""Errors, checks, files, rows, ids and parallel jobs, used by all other packages."""
