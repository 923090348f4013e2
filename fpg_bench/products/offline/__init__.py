"""Data sets for offline reinforcement learning: specifications, their making and their check."""
