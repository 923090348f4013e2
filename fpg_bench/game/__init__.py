"""The rules of the game, in NumPy and Numba only."""
