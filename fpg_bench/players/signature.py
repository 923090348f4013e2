"""The inputs and outputs that a policy as ONNX may have."""

from __future__ import annotations

from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE

MAX_NOISE = 16


def check_signature(inputs: dict[str, list[Any]], outputs: dict[str, list[Any]]) -> None:
    """Refuse a policy whose inputs and outputs are not those of the contract.

    Args:
        inputs, outputs: their shapes by name; a size that is free is no int.

    Raises:
        UserError: a name, shape or size that does not fit.
    """
    wanted_in = {"observation": OBSERVATION_SIZE, "state": None, "noise": None}
    wanted_out = {"action": ACTION_SIZE, "next_state": None}
    for found, wanted, what in ((inputs, wanted_in, "input"), (outputs, wanted_out, "output")):
        for name, shape in found.items():
            if name not in wanted:
                raise UserError(f"policy.onnx: unknown {what} {name!r}; known: {', '.join(wanted)}")
            size = wanted[name]
            fixed = len(shape) == 2 and isinstance(shape[1], int) and not isinstance(shape[0], int)
            if not fixed or (size is not None and shape[1] != size):
                raise UserError(
                    f"policy.onnx: {what} {name!r} has shape {shape}, expected [n, {size or 'fixed'}]"
                )
    if "observation" not in inputs or "action" not in outputs:
        raise UserError("policy.onnx: needs the input 'observation' and the output 'action'")
    if inputs.get("state", [0, 0])[1] != outputs.get("next_state", [0, 0])[1]:
        raise UserError("policy.onnx: input 'state' and output 'next_state' must have the same size")
    if inputs.get("noise", [0, 0])[1] > MAX_NOISE:
        raise UserError(f"policy.onnx: noise of size {inputs['noise'][1]}, at most {MAX_NOISE}")
