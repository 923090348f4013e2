"""PyTorch reads its table of ONNX operators anew for each export, half of its time: it is read once."""

from __future__ import annotations

import functools
import importlib

_REGISTRATION = "torch.onnx._internal.exporter._registration"  # a private door, opened here alone


def keep_operators() -> None:
    """Keep the table of a process once it is read; nothing of what is exported changes.

    Where this PyTorch has no such table, exports stay as slow as they are.
    """
    try:
        registry = importlib.import_module(_REGISTRATION).ONNXRegistry
    except (ImportError, AttributeError):
        return
    read = getattr(registry, "from_torchlib", None)
    if read is not None and not hasattr(read, "cache_info"):
        registry.from_torchlib = staticmethod(functools.cache(read))
