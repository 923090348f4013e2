"""A submitted policy as a player: it plays in a process of its own, and what it answers is checked here."""

from __future__ import annotations

import struct
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from fpg_bench.common.errors import printable
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.leaderboard.sandbox import Limits, PolicyFailed, Sandbox
from fpg_bench.players.seeded import Batched

if TYPE_CHECKING:  # its process needs none of what a submission is made of
    from fpg_bench.leaderboard.policies import Policy

__all__ = ["Limits", "PolicyClient", "PolicyFailed"]

# A message: its kind and two numbers, then what they say. To the process: LOAD (bytes of the model), RESET
# (games) and PLAY (games, flags). From it: READY (1 where it draws at random), ACTIONS (their shape) and
# FAILED (bytes of a reason).
HEAD = struct.Struct("<cII")
LOAD, RESET, PLAY, READY, ACTIONS, FAILED = b"L", b"R", b"P", b"H", b"A", b"E"
FRESH, STARTS = 1, 2
_ROUNDING = 1e-6
_LONGEST_REASON = 300


class PolicyClient(Batched):
    """Plays a policy in a process of its own under limits; a player to whoever plays it, and one batch only.

    An answer that is not finite, lies outside [-1, 1] or has another shape loses that game's round: it
    plays zeros there, and ``invalid`` says so until the game's next round begins.

    Args:
        policy: what is played; ``onnx_contract`` has found nothing wrong with it.
        limits: of memory and time.

    Attributes:
        invalid: ``(n,)`` bool, the games whose present round is lost.
        about: the content of ``agent.json``.

    Raises:
        PolicyFailed: entering, or a later ``predict``: it died or outran its limits.
        ValueError: ``predict`` of a ``state`` that is not what the last call returned.
    """

    def __init__(self, policy: Policy, limits: Limits | None = None) -> None:
        self.policy, self.about = policy, policy.about
        self.limits = limits or Limits()
        self.invalid = np.zeros(0, bool)
        self._calls = 0
        self._sandbox: Sandbox | None = None

    def __enter__(self) -> PolicyClient:
        self._sandbox = Sandbox("fpg_bench.leaderboard.policy_process", self.limits)
        try:
            with self._sandbox.within(self.limits.start_s):
                self._sandbox.send(HEAD.pack(LOAD, len(self.policy.model), 0), self.policy.model)
                _, self._draws, _ = self._head(READY)
        except PolicyFailed:
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
        """The process that plays."""
        return self._running().pid

    def reset(self, mask: np.ndarray, seeds: np.ndarray) -> None:
        """Begin a round in the masked games, whose draws come from these seeds."""
        if len(self.invalid) != len(mask):
            self.invalid = np.zeros(len(mask), bool)
        self.invalid[mask] = False
        if self._draws:
            parts = (np.ascontiguousarray(mask, bool).data, np.ascontiguousarray(seeds, np.uint64).data)
            with self._running().within(self.limits.call_s):
                self._running().send(HEAD.pack(RESET, len(mask), 0), *parts)

    def _answer(self, seen: np.ndarray, state: Any, starts: np.ndarray | None) -> tuple[np.ndarray, Any]:
        """What the process answers; the memory stays there.

        Raises:
            PolicyFailed: it died, failed, or gave no answer in time.
            ValueError: ``state`` is not what the last call returned: another batch has been played since.
        """
        if state not in (None, self._calls):
            raise ValueError("a PolicyHost keeps the memory of one batch of games only")
        count = len(seen)
        if len(self.invalid) != count:
            self.invalid = np.zeros(count, bool)
        parts: list[Any] = [np.ascontiguousarray(seen, np.float32).data]
        flags = 0 if state is not None else FRESH
        if starts is not None:
            flags |= STARTS
            parts.append(np.ascontiguousarray(starts, bool).data)
        sandbox = self._running()
        with sandbox.within(self.limits.call_s):
            sandbox.send(HEAD.pack(PLAY, count, flags), *parts)
            actions = self._actions(count)
        self._calls += 1
        return self._valid(actions), self._calls

    def _actions(self, count: int) -> np.ndarray:
        """The answer; all NaN where it has another shape."""
        _, rows, columns = self._head(ACTIONS)
        if (rows, columns) != (count, ACTION_SIZE):
            return np.full((count, ACTION_SIZE), np.nan, np.float32)
        data = self._running().receive(4 * count * ACTION_SIZE)
        return np.frombuffer(bytearray(data), np.float32).reshape(count, ACTION_SIZE)

    def _valid(self, actions: np.ndarray) -> np.ndarray:
        """The actions, with zeros in the games that lose their round by them."""
        most = 1 + _ROUNDING
        if actions.size and not (actions.max() <= most and actions.min() >= -most):  # NaN too
            wrong = ~(np.abs(actions) <= most).all(axis=1)
            self.invalid |= wrong
            actions[wrong] = 0
        return actions

    def _head(self, wanted: bytes) -> tuple[bytes, int, int]:
        """The head of the wanted message; raises PolicyFailed for every other."""
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
            raise ValueError("a PolicyHost plays inside a with block")
        return self._sandbox

    def __repr__(self) -> str:
        return f"PolicyHost(seed {self.policy.seed}, {self.about.get('algorithm')})"
