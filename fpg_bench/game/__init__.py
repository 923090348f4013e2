"""The rules of the game: NumPy and Numba only."""
