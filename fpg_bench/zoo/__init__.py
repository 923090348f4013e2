"""The zoo of trained agents: what is in it, how it is trained, its scores, curves and page."""
