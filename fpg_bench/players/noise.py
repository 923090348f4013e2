"""Standard normal numbers of a round's own stream, for policies that draw at random."""

from __future__ import annotations

from fpg_bench.game import rng
from fpg_bench.game.compiling import compiled


@compiled
def fill_noise(noise, keys, steps):
    """Fill ``noise`` (n, k) with the draws of these rounds (n,) at these steps (n,)."""
    for i in range(noise.shape[0]):
        for j in range(noise.shape[1]):
            noise[i, j], _ = rng.gaussians(keys[i], steps[i], rng.PLAYER_DRAW + j)
