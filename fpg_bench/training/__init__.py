"""Training with Stable-Baselines3, and the export of what was trained."""

from fpg_bench.common.extras import need

need("train", "torch", "stable_baselines3", "sb3_contrib", "onnx", "onnxscript", "tensorboard")
