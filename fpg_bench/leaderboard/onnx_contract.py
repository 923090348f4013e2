"""The contract of a submitted ``policy.onnx``: what it may hold, read where it cannot hurt."""

from __future__ import annotations

import hashlib
import json
import struct

from fpg_bench.leaderboard.sandbox import Limits, PolicyFailed, Sandbox

MOST_BYTES = 5_000_000
SIZE = struct.Struct("<I")
_READING = Limits(memory_bytes=2**30, call_s=120, total_s=120)
_FOUND: dict[str, list[str]] = {}  # by the policy's hash; to start a process takes half a second


def check_policy(model: bytes) -> list[str]:
    """All that is wrong with a policy, one line each; none where it may be played.

    The file is parsed in a process of its own under limits; see :mod:`fpg_bench.leaderboard.onnx_rules` for
    what it may hold. No external data is followed.
    """
    if len(model) > MOST_BYTES:
        return [f"holds {len(model):,} bytes, at most {MOST_BYTES:,} are allowed"]
    key = hashlib.sha256(model).hexdigest()
    if key not in _FOUND:
        _FOUND[key] = _read(model)
    return list(_FOUND[key])


def _read(model: bytes) -> list[str]:
    sandbox = Sandbox("fpg_bench.leaderboard.onnx_process", _READING)
    try:
        with sandbox.within(_READING.call_s):
            sandbox.send(SIZE.pack(len(model)), model)
            (size,) = SIZE.unpack(sandbox.receive(SIZE.size))
            lines = json.loads(sandbox.receive(size))
    except (PolicyFailed, ValueError) as error:
        return [f"cannot be read within 1 GB of memory and {_READING.call_s:g} s: {error}"]
    finally:
        sandbox.close()
    lines = lines if isinstance(lines, list) else ["cannot be read"]
    return ["".join(c if c.isprintable() else " " for c in str(line)) for line in lines]
