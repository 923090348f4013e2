"""The contract of a submitted ``policy.onnx``: what it may hold, read where it cannot hurt."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Sequence

from fpg_bench.common.errors import printable
from fpg_bench.common.strict_json import read_plain
from fpg_bench.leaderboard.sandbox import Limits, PolicyFailed, Sandbox

MOST_BYTES = 5_000_000
SIZE = struct.Struct("<I")
_READING = Limits(memory_bytes=2**30, call_s=60, total_s=600)
_UNREADABLE = "cannot be read within 1 GB of memory and 60 s"
_FOUND: dict[str, list[str]] = {}  # by the policy's hash; to start a process takes half a second


def check_policy(model: bytes) -> list[str]:
    """All that is wrong with a policy, one line each; none where it may be played.

    The file is parsed in a process of its own under limits; see :mod:`fpg_bench.leaderboard.onnx_rules` for
    what it may hold. No external data is followed.
    """
    return check_policies([model])[0]


def check_policies(models: Sequence[bytes]) -> list[list[str]]:
    """What is wrong with each of one submission's policies, which are read one after the other."""
    keys = [hashlib.sha256(model).hexdigest() for model in models]
    small = [model for model in models if len(model) <= MOST_BYTES]
    _read([model for model in small if hashlib.sha256(model).hexdigest() not in _FOUND])
    too_large = "holds {:,} bytes, at most {:,} are allowed"
    return [
        list(_FOUND[key]) if len(model) <= MOST_BYTES else [too_large.format(len(model), MOST_BYTES)]
        for key, model in zip(keys, models, strict=True)
    ]


def _read(models: list[bytes]) -> None:
    """Read policies in one process; in a new one after each that ends it."""
    while models:
        sandbox = Sandbox("fpg_bench.leaderboard.onnx_rules", _READING)
        try:
            while models:
                model = models.pop(0)
                _FOUND[hashlib.sha256(model).hexdigest()] = found = _asked(sandbox, model)
                if found == [_UNREADABLE]:
                    break
        finally:
            sandbox.close()


def _asked(sandbox: Sandbox, model: bytes) -> list[str]:
    try:
        with sandbox.within(_READING.call_s):
            sandbox.send(SIZE.pack(len(model)), model)
            (size,) = SIZE.unpack(sandbox.receive(SIZE.size))
            lines = read_plain(sandbox.receive(size))
    except (PolicyFailed, ValueError):
        return [_UNREADABLE]
    lines = lines if isinstance(lines, list) else [_UNREADABLE]
    return [printable(str(line)) for line in lines]
