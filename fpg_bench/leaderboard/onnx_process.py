"""What runs in the process that reads somebody's ONNX: files in, what is wrong with each out, as JSON."""

from __future__ import annotations

import contextlib
import json

from fpg_bench.leaderboard.inside import Inside
from fpg_bench.leaderboard.onnx_contract import SIZE
from fpg_bench.leaderboard.onnx_rules import violations
from fpg_bench.leaderboard.sandbox import Reader


def main(inside: Inside) -> None:
    """Read policies until whoever started the process is gone."""
    inside.lock_down()
    connection, reader = inside.connection, Reader(inside.connection)
    with contextlib.suppress(EOFError, ConnectionError):
        while True:
            (size,) = SIZE.unpack(reader.read(SIZE.size))
            try:
                found = violations(reader.read(size))
            except MemoryError:
                found = ["takes more memory to read than a policy may"]
            answer = json.dumps([line[:400] for line in found[:50]]).encode()
            connection.sendall(SIZE.pack(len(answer)) + answer)
