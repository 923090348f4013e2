"""Both sides of N games as one Stable-Baselines3 ``VecEnv``."""

from __future__ import annotations

from typing import Any

from fpg_bench.envs.sb3 import SB3View
from fpg_bench.envs.two_sided import TwoSided


def make_sb3_duel(n_envs: int = 1, seed: int | None = None, stagger: bool = False, **options: Any) -> SB3View:
    """Both sides of N games as one SB3 ``VecEnv``, for :class:`fpg_bench.training.maddpg.MADDPG`.

    Observations ``(N, 30)``, actions ``(N, 18)``, rewards ``(N, 2)``, the ally's first.

    Args:
        n_envs, seed, stagger: as in :func:`fpg_bench.envs.sb3.make_sb3`.
        **options: those of :func:`fpg_bench.envs.duel.make_duel`.

    Raises:
        UserError: something unknown, out of range, or impossible together.
    """
    return SB3View(TwoSided(n_envs, **options), seed, stagger)
