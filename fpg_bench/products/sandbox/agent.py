"""Agents of submissions as players: each plays in a sandbox, and what it does there stops nobody."""

from __future__ import annotations

import contextlib
import logging
import weakref
from collections.abc import Iterator

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.game.state import ACTION_SIZE
from fpg_bench.players.card import AgentCard
from fpg_bench.players.player import Memory, Prediction
from fpg_bench.players.seeded import Batched
from fpg_bench.products.sandbox import client
from fpg_bench.products.sandbox.client import Policy, check_policy
from fpg_bench.products.sandbox.process import PolicyFailed, ProcessLimits

_logger = logging.getLogger(__name__)
# Training asks millions of times, so only the start and each answer are limited.
_LIMITS = ProcessLimits(total_s=1e7)


class SandboxedAgent(Batched):
    """Player of an untrusted policy, as part of a training, a season or an evaluation.

    Its process starts with the first answer. An invalid answer loses that game's round, as in
    :class:`fpg_bench.products.sandbox.client.PolicyClient`. If the process dies, exceeds a limit or breaks
    the contract, the present rounds of all games and all later ones are lost, with actions of zeros.

    Args:
        model: the bytes of ``policy.onnx``.
        card: the agent's card.

    Attributes:
        invalid: ``(n,)`` bool, the games whose current round is lost.
        failure: why the process could not play on; None while it can.

    Raises:
        UserError: the file breaks the contract; see :func:`fpg_bench.products.sandbox.client.check_policy`.
    """

    def __init__(self, model: bytes, card: AgentCard) -> None:
        if problems := check_policy(model):
            raise UserError(f"policy.onnx: {problems[0]}")
        self.model, self.card = model, card
        self.failure: str | None = None
        self.invalid = np.zeros(0, bool)
        self._policy = Policy(0, card, model, card.policy_sha256)
        self._client: client.PolicyClient | None = None

    def reset(self, mask: np.ndarray, seeds: np.ndarray) -> None:
        """Start a round in the masked games with these seeds for their noise."""
        if self.failure is None:
            with self._failures():
                self._running().reset(mask, seeds)
                self.invalid = self._running().invalid
        if self.failure is not None:
            self.invalid = np.ones(len(mask), bool)

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        if self.failure is None:
            with self._failures():
                actions, state = self._running().predict(seen, state, starts)
                self.invalid = self._running().invalid
                return actions, state
        self.invalid = np.ones(len(seen), bool)
        return np.zeros((len(seen), ACTION_SIZE), np.float32), None

    def _running(self) -> client.PolicyClient:
        if self._client is None:
            self._client = client.PolicyClient(self._policy, _LIMITS).__enter__()
            # A ``__del__`` would come too late in a cycle of references, and never at the interpreter's end.
            weakref.finalize(self, self._client.close)
        return self._client

    @contextlib.contextmanager
    def _failures(self) -> Iterator[None]:
        """Turn the failure of the process into lost rounds."""
        try:
            yield
        except PolicyFailed as error:
            self.failure = str(error)
            if self._client is not None:
                self._client.close()
            _logger.warning(f"{self!r}: {error}; its rounds are lost from here on")

    def __reduce__(self) -> tuple[type[SandboxedAgent], tuple[bytes, AgentCard]]:
        return type(self), (self.model, self.card)

    def __repr__(self) -> str:
        return f"SandboxedAgent({self.card})"
