"""Somebody else's policy, made to look like another one: by its bytes it is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from onnx import ModelProto, numpy_helper

from tests.leaderboard.making import node


def copies(data: bytes, seed: int = 0) -> Iterator[tuple[str, bytes]]:
    """Copies of a policy, each with what was done; all play as it does."""
    for share in (1e-6, 1e-3, 0.01, 0.05):
        yield f"weights {share:g} off", _weights_off(data, share, seed)
    yield "another name", _renamed(data)
    yield "nodes that do nothing", _padded(data)


def _weights_off(data: bytes, share: float, seed: int) -> bytes:
    proto, rng = ModelProto.FromString(data), np.random.default_rng(seed)
    for tensor in proto.graph.initializer:
        weights = numpy_helper.to_array(tensor)
        if weights.dtype == np.float32 and weights.size > 1:
            off = weights * (1 + share * rng.normal(size=weights.shape))
            tensor.CopyFrom(numpy_helper.from_array(off.astype(np.float32), tensor.name))
    return proto.SerializeToString()


def _renamed(data: bytes) -> bytes:
    proto = ModelProto.FromString(data)
    proto.producer_name, proto.graph.name = "mine", "mine"
    return proto.SerializeToString()


def _padded(data: bytes) -> bytes:
    proto = ModelProto.FromString(data)
    for last in proto.graph.node:
        for place, name in enumerate(last.output):
            if name == "action":
                last.output[place] = "inner"
    proto.graph.node.append(node("Identity", ["inner"], ["action"]))
    return proto.SerializeToString()
