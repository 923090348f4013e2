"""Process of a submitted policy: it loads the policy, keeps its memory, and answers with actions."""

from __future__ import annotations

import socket

import numpy as np
from numpy.typing import DTypeLike

from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.players.player import Memory
from fpg_bench.products.sandbox.child import SandboxChild, rehearse
from fpg_bench.products.sandbox.client import ACTIONS, FAILED, FRESH, HEAD, LOAD, READY, RESET, STARTS
from fpg_bench.products.sandbox.process import MessageReader

_LONGEST_REASON = 300
_MEMORY = ("bad_alloc", "alloc", "memory")


def main(inside: SandboxChild) -> None:
    """Serve one policy until the parent process is gone."""
    connection = inside.connection
    try:
        serve(inside)
    except (EOFError, ConnectionError):
        pass
    except Exception as error:  # onnxruntime's, of any kind; the process has nothing to clean up
        reason = _reason(error).encode()[:_LONGEST_REASON]
        connection.sendall(HEAD.pack(FAILED, len(reason), 0) + reason)


def serve(inside: SandboxChild) -> None:
    """Load the policy, which is the first message, then answer each message."""
    connection, reader = inside.connection, MessageReader(inside.connection)
    kind, size, _ = HEAD.unpack(reader.read(HEAD.size))
    assert kind == LOAD
    data = reader.read(size)
    rehearse(noise=b"noise" in data)
    inside.lock_down()
    player = OnnxPlayer(data)
    player.predict(np.zeros((1, OBSERVATION_SIZE), np.float32))
    connection.sendall(HEAD.pack(READY, int(player.noise_size > 0), 0))
    memory: Memory = None
    while True:
        kind, count, flags = HEAD.unpack(reader.read(HEAD.size))
        if kind == RESET:
            mask = np.frombuffer(reader.read(count), bool)
            player.reset(mask, np.frombuffer(reader.read(8 * count), np.uint64))
            continue
        seen = _array(reader, np.float32, count, OBSERVATION_SIZE)
        starts = _array(reader, bool, count, 1)[:, 0] if flags & STARTS else None
        before = None if flags & FRESH else memory
        actions, memory = player.predict(seen, before, starts)
        if player.state_size and memory[0].shape != (count, player.state_size):  # not as it declares
            actions, memory = np.empty(0), None
        _send(connection, actions, count)


def _array(reader: MessageReader, dtype: DTypeLike, rows: int, columns: int) -> np.ndarray:
    data = reader.read(rows * columns * np.dtype(dtype).itemsize)
    return np.frombuffer(data, dtype).reshape(rows, columns)


def _send(connection: socket.socket, actions: np.ndarray, count: int) -> None:
    """Send the actions, or only their shape if it is wrong."""
    rows, columns = actions.shape if getattr(actions, "ndim", 0) == 2 else (0, 0)
    is_valid = (rows, columns) == (count, ACTION_SIZE) and actions.dtype == np.float32
    data = np.ascontiguousarray(actions).tobytes() if is_valid else b""
    connection.sendall(HEAD.pack(ACTIONS, rows if is_valid else 0, columns) + data)


def _reason(error: Exception) -> str:
    """Return one line on why it failed."""
    text = " ".join(str(error).split())
    if isinstance(error, MemoryError) or any(word in text.lower() for word in _MEMORY):
        return "asks for more memory than it may use"
    return f"failed: {text or type(error).__name__}"
