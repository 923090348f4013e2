"""Tuning hyper-parameters with Optuna: search, train the best again on fresh seeds, write them down."""
