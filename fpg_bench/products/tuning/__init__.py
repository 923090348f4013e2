"""Hyper-parameter tuning with Optuna: search, retrain the best trials on fresh seeds, export their values."""

from fpg_bench.common.extras import require_extra

require_extra("tune", "optuna")
