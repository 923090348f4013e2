"""Tuning hyper-parameters with Optuna: search, train the best again on fresh seeds, write them down."""

from fpg_bench.common.extras import need

need("tune", "optuna", "plotly")
