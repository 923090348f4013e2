"""The paper's experiments: every figure, table and claim, made again over seeds."""

from fpg_bench.common.extras import need

need("train", "torch", "stable_baselines3", "matplotlib", "jinja2", "markdown_it")
