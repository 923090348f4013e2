"""Training with Stable-Baselines3, and the export of what was trained."""

from fpg_bench.common.extras import require_extra


def require_libraries() -> None:
    """Raise UserError if a library of training is missing; modules call it before they import one."""
    require_extra("train", "torch", "stable_baselines3", "sb3_contrib", "onnx", "tensorboard")
