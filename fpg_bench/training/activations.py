"""What hidden layers may be followed by, said by name: torch's elementwise activations that ONNX has, too."""

from __future__ import annotations

import difflib
from typing import Any

from torch import nn

from fpg_bench.errors import UserError, nearest

# Without weights of their own and without chance. Left out: LogSigmoid, whose export differs by 8e-4.
_NAMES = (
    "CELU ELU GELU Hardshrink Hardsigmoid Hardswish Hardtanh LeakyReLU Mish ReLU ReLU6 SELU SiLU Sigmoid "
    "Softplus Softshrink Softsign Tanh Tanhshrink"
)
ACTIVATIONS: dict[str, type[nn.Module]] = {name: getattr(nn, name) for name in _NAMES.split()}


def as_activation(found: Any, where: str) -> type[nn.Module]:
    """The activation of a name, ``ReLU`` for instance; a class of torch's kind, from Python, is itself one.

    Raises:
        UserError: no such name, or something else; ``where`` begins the message.
    """
    if isinstance(found, type) and issubclass(found, nn.Module):
        return found
    if not isinstance(found, str):
        raise UserError(f"{where}: expected the name of an activation, ReLU for instance, got {found!r}")
    if found not in ACTIVATIONS:
        lower = {name.lower(): name for name in ACTIVATIONS}
        near = difflib.get_close_matches(found.lower(), lower, n=1)
        written = lower[near[0]] if near else found  # relu and RELU are near ReLU, too
        raise UserError(f"{where}: unknown activation {found!r}{nearest(written, ACTIVATIONS)}")
    return ACTIVATIONS[found]
