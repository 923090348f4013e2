"""Seasons: recipes of candidates, selection, closing and audit."""
