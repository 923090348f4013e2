"""Reproduction of the paper: its figures, tables and claims, over several seeds."""

from fpg_bench.common.extras import require_extra

require_extra("train", "torch", "stable_baselines3", "matplotlib", "jinja2", "markdown_it")
