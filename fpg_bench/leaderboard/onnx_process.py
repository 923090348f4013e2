"""What runs in the process that reads somebody's ONNX: one file in, what is wrong with it out, as JSON."""

from __future__ import annotations

import json
import sys

from fpg_bench.leaderboard.onnx_contract import SIZE
from fpg_bench.leaderboard.onnx_rules import violations
from fpg_bench.leaderboard.sandbox import Reader, inside, lock_down


def main() -> None:
    """Read one policy and end."""
    connection = inside(sys.argv[1:])
    lock_down()
    reader = Reader(connection)
    (size,) = SIZE.unpack(reader.read(SIZE.size))
    try:
        found = violations(reader.read(size))
    except MemoryError:
        found = ["takes more memory to read than a policy may"]
    answer = json.dumps([line[:400] for line in found[:50]]).encode()
    connection.sendall(SIZE.pack(len(answer)) + answer)


if __name__ == "__main__":
    main()
