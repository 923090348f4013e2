"""Croissant descriptions of data sets."""
