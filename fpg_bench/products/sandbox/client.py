"""Submitted policies, checked and played in processes of their own; their answers are validated here."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np

from fpg_bench.common.errors import one_line, printable
from fpg_bench.common.strict_json import read_plain
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.card import AgentCard
from fpg_bench.players.player import Memory, Prediction
from fpg_bench.players.seeded import Batched
from fpg_bench.products.sandbox.process import PolicyFailed, ProcessLimits, Sandbox, Unprotected

MOST_BYTES = 5_000_000  # of policy.onnx
AGENT_FILES = {"agent.json": 64_000, "policy.onnx": MOST_BYTES}  # of an untrusted agent, and their most bytes
SIZE = struct.Struct("<I")  # of a file that is checked, and of the answer
_READING = ProcessLimits(memory_bytes=2**30, call_s=60, total_s=600)
_UNREADABLE = "cannot be read and played within 1 GB of memory and 60 s"
_PROBLEMS: dict[str, list[str]] = {}  # of files that were checked, by hash; starting a process takes 0.5 s

# A message: its kind and two numbers, then what they say. To the process: LOAD (bytes of the model), RESET
# (games) and PLAY (games, flags). From it: READY (1 where it draws at random), ACTIONS (their shape) and
# FAILED (bytes of a reason).
HEAD = struct.Struct("<cII")
LOAD, RESET, PLAY, READY, ACTIONS, FAILED = b"L", b"R", b"P", b"H", b"A", b"E"
FRESH, STARTS = 1, 2
_ROUNDING = 1e-6
_LONGEST_REASON = 300


@dataclass(frozen=True)
class Policy:
    """Policy of one training seed, as data.

    Attributes:
        seed: the training seed.
        card: the agent's card; None if it cannot be read.
        model: the content of ``policy.onnx``.
        sha256: the hash of ``model``.
    """

    seed: int
    card: AgentCard | None
    model: bytes
    sha256: str


def check_policy(model: bytes) -> list[str]:
    """Return all problems of a ``policy.onnx``, one line each; none if it may be played.

    The file is parsed in a process of its own under limits; :mod:`fpg_bench.products.sandbox.onnx_checks`
    says what it may hold. External data is never read.
    """
    return check_policies([model])[0]


def check_policies(models: Sequence[bytes]) -> list[list[str]]:
    """Return the problems of each of one submission's policies; see :func:`check_policy`."""
    keys = [hashlib.sha256(model).hexdigest() for model in models]
    small = {key: model for key, model in zip(keys, models, strict=True) if len(model) <= MOST_BYTES}
    _check([model for key, model in small.items() if key not in _PROBLEMS])
    too_large = "holds {:,} bytes, at most {:,} are allowed"
    return [
        list(_PROBLEMS[key]) if key in small else [too_large.format(len(model), MOST_BYTES)]
        for key, model in zip(keys, models, strict=True)
    ]


def _check(models: list[bytes]) -> None:
    """Check policies in one process; in a new one after each that ends it."""
    while models:
        sandbox = Sandbox("fpg_bench.products.sandbox.onnx_checks", _READING)
        try:
            while models:
                model = models.pop(0)
                key = hashlib.sha256(model).hexdigest()
                try:
                    _PROBLEMS[key] = _ask(sandbox, model)
                except Unprotected:
                    raise
                except (PolicyFailed, ValueError) as error:
                    _PROBLEMS[key] = [f"{_UNREADABLE}: {one_line(error)}"]
                    break
        finally:
            sandbox.close()


def _ask(sandbox: Sandbox, model: bytes) -> list[str]:
    """Return the problems of a policy; raises PolicyFailed or ValueError without a sound answer."""
    with sandbox.within(_READING.call_s):
        sandbox.send(SIZE.pack(len(model)), model)
        (size,) = SIZE.unpack(sandbox.receive(SIZE.size))
        lines = read_plain(sandbox.receive(size))
    if not isinstance(lines, list):
        raise ValueError("answers with no list")
    return [printable(str(line)) for line in lines]


class PolicyClient(Batched):
    """Player whose policy runs in a process of its own under limits; plays one batch of games.

    An answer that is not finite, lies outside [-1, 1] or has another shape loses that game's round: zeros
    are played there, and ``invalid`` is set until the game's next round begins.

    Args:
        policy: has passed :func:`check_policies`.
        limits: of memory and time.

    Attributes:
        invalid: ``(n,)`` bool, the games whose current round is lost.
        card: the agent's card; None if it cannot be read.

    Raises:
        Unprotected: on entering: nothing would isolate the process.
        PolicyFailed: on entering, or in a later ``predict``: the process died or exceeded its limits.
        ValueError: ``predict`` with a ``state`` that is not what the last call returned.
    """

    def __init__(self, policy: Policy, limits: ProcessLimits | None = None) -> None:
        self.policy, self.card = policy, policy.card
        self.limits = limits or ProcessLimits()
        self.invalid = np.zeros(0, bool)
        self._calls = 0
        self._sandbox: Sandbox | None = None

    def __enter__(self) -> PolicyClient:
        self._sandbox = Sandbox("fpg_bench.products.sandbox.policy", self.limits)
        try:
            with self._sandbox.within(self.limits.start_s):
                self._sandbox.send(HEAD.pack(LOAD, len(self.policy.model), 0), self.policy.model)
                _, self._draws, _ = self._head(READY)
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        if self._sandbox is not None:
            self._sandbox.close()
            self._sandbox = None

    @property
    def pid(self) -> int:
        """Process id of the policy."""
        return self._running().pid

    def reset(self, mask: np.ndarray, seeds: np.ndarray) -> None:
        """Start a round in the masked games with these seeds for their noise."""
        if len(self.invalid) != len(mask):
            self.invalid = np.zeros(len(mask), bool)
        self.invalid[mask] = False
        if self._draws:
            parts = (np.ascontiguousarray(mask, bool).data, np.ascontiguousarray(seeds, np.uint64).data)
            with self._running().within(self.limits.call_s):
                self._running().send(HEAD.pack(RESET, len(mask), 0), *parts)

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        """Return the process's actions; the memory stays there.

        Raises:
            PolicyFailed: it died, failed, or gave no answer in time.
            ValueError: ``state`` is not what the last call returned: another batch has been played since.
        """
        is_fresh = not self._calls and starts is not None and bool(starts.all())  # of a copy of its games
        if state not in (None, self._calls) and not is_fresh:
            raise ValueError("a PolicyClient keeps the memory of one batch of games only")
        count = len(seen)
        if len(self.invalid) != count:
            self.invalid = np.zeros(count, bool)
        parts: list[Any] = [np.ascontiguousarray(seen, np.float32).data]
        flags = 0 if state is not None else FRESH
        if starts is not None:
            flags |= STARTS
            parts.append(np.ascontiguousarray(starts, bool).data)
        sandbox = self._running()
        with sandbox.within(self.limits.call_s + count * self.limits.row_s):
            sandbox.send(HEAD.pack(PLAY, count, flags), *parts)
            actions = self._actions(count)
        self._calls += 1
        return self._valid(actions), self._calls

    def _actions(self, count: int) -> np.ndarray:
        """Receive the actions; all NaN if they have another shape."""
        _, rows, columns = self._head(ACTIONS)
        if (rows, columns) != (count, ACTION_SIZE):
            return np.full((count, ACTION_SIZE), np.nan, np.float32)
        data = self._running().receive(4 * count * ACTION_SIZE)
        return np.frombuffer(bytearray(data), np.float32).reshape(count, ACTION_SIZE)

    def _valid(self, actions: np.ndarray) -> np.ndarray:
        """Return the actions, with zeros in the games that lose their round by them."""
        most = 1 + _ROUNDING
        if actions.size and not (actions.max() <= most and actions.min() >= -most):  # NaN too
            wrong = ~(np.abs(actions) <= most).all(axis=1)
            self.invalid |= wrong
            actions[wrong] = 0
        return actions

    def _head(self, wanted: bytes) -> tuple[bytes, int, int]:
        """Receive the head of the wanted message; raises PolicyFailed for every other."""
        sandbox = self._running()
        kind, first, second = HEAD.unpack(sandbox.receive(HEAD.size))
        if kind == FAILED:
            reason = sandbox.receive(min(first, _LONGEST_REASON)).decode(errors="replace")
            raise PolicyFailed(printable(reason))
        if kind != wanted:
            raise PolicyFailed("its process answers out of turn")
        return kind, first, second

    def _running(self) -> Sandbox:
        if self._sandbox is None:
            raise ValueError("a PolicyClient plays inside a with block")
        return self._sandbox
