"""The paper's experiments: every figure, table and claim, made again over seeds."""
