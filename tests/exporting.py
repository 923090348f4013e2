"""PyTorch reads its table of ONNX operators anew for each export, half of its time: read it once."""

from __future__ import annotations

import functools
import sys

_REGISTRATION = "torch.onnx._internal.exporter._registration"


def keep_operators() -> None:
    """Keep the table from now on, if PyTorch has one; nothing of what is exported changes."""
    registry = getattr(sys.modules.get(_REGISTRATION), "ONNXRegistry", None)
    read = getattr(registry, "from_torchlib", None)
    if read is not None and not hasattr(read, "cache_info"):
        registry.from_torchlib = staticmethod(functools.cache(read))
