"""Hyper-parameter tuning with Optuna: search, retrain the best trials on fresh seeds, export their values."""
