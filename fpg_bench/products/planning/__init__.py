"""Planners of the opponent's path, their matches and comparisons."""
