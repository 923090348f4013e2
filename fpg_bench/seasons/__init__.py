"""Seasons: fields of counterparts that are trained, in the open, only after all entries are in."""
