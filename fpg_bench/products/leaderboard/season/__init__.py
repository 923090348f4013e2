"""Seasons: recipes of candidates, selection, closing and description."""
