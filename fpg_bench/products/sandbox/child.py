"""Entry point of sandboxed processes: sets limits, isolates itself, and runs a module's ``main``."""

from __future__ import annotations

import contextlib
import importlib
import os
import resource
import socket
import sys

from fpg_bench.products.sandbox import isolation
from fpg_bench.products.sandbox.process import HELLO


class SandboxChild:
    """Connection to the parent process, and the layers around this one.

    Args:
        connection: the socket to the parent.
        standing: the layers that stand already.
        outside: this process's id as seen from outside.
    """

    def __init__(self, connection: socket.socket, standing: isolation.Layer, outside: int) -> None:
        self.connection = connection
        self._standing, self._outside = standing, outside

    def lock_down(self) -> None:
        """Forbid files and processes, once everything is loaded; then report to the parent.

        The process ends here if it is not to read untrusted bytes; see
        :func:`fpg_bench.products.sandbox.isolation.refusal`.
        """
        threads = isolation.count_threads()
        isolation.close_files(but=self.connection.fileno())
        for kind in (resource.RLIMIT_FSIZE, resource.RLIMIT_NPROC):
            _limit(kind, 0)
        self._standing = isolation.shut(self._standing)
        self.connection.sendall(HELLO.pack(self._outside, int(self._standing), threads))
        if isolation.refusal(self._standing, threads):
            os._exit(1)


def main() -> None:
    """Set limits, isolate the process, and run a module; arguments: ``MODULE SOCKET MEMORY CPU``."""
    module, *numbers = sys.argv[1:]
    number, memory_bytes, cpu_s = map(int, numbers)
    _limit(resource.RLIMIT_AS, memory_bytes)
    _limit(resource.RLIMIT_CPU, cpu_s)
    _limit(resource.RLIMIT_CORE, 0)
    standing, outside = isolation.isolate()
    importlib.import_module(module).main(SandboxChild(socket.socket(fileno=number), standing, outside))


def rehearse(noise: bool = False) -> None:
    """Play a policy of our own once, so that everything that opens files is loaded and compiled."""
    import numpy as np
    from onnx import TensorProto, helper

    from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE
    from fpg_bench.players.agent import OnnxPlayer

    weights = helper.make_tensor("w", TensorProto.FLOAT, [15, 9], [0.0] * 135)
    sizes = {"observation": OBSERVATION_SIZE, "noise": ACTION_SIZE, "action": ACTION_SIZE}
    sizes = sizes if noise else {name: size for name, size in sizes.items() if name != "noise"}
    *inputs, action = (
        helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", size]) for name, size in sizes.items()
    )
    nodes = [helper.make_node("MatMul", ["observation", "w"], ["x"])]
    nodes.append(helper.make_node("Add", ["x", "noise" if noise else "x"], ["action"]))
    graph = helper.make_graph(nodes, "rehearsal", inputs, [action], [weights])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    OnnxPlayer(model.SerializeToString()).predict(np.zeros((2, OBSERVATION_SIZE), np.float32))


def _limit(kind: int, value: int) -> None:
    with contextlib.suppress(ValueError, OSError):  # macOS knows no limit of the address space
        resource.setrlimit(kind, (value, value))


if __name__ == "__main__":
    main()
