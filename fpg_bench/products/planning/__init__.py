"""Planners of the opponent's path that learn or see the ally."""
