"""MADDPG: both sides learn at once, each with a critic that sees all observations and actions."""

from fpg_bench.products.maddpg.maddpg import MADDPG

__all__ = ["MADDPG"]
