"""A shipped ally whose hops go to an evenly drawn point, with nothing trained: what it then keeps.

fpg-bench best-response scripts.even_hops:EvenHops --side ally --algorithm ppo-stack8 --actions discrete
    --steps 1500000 --n-seeds 1 --out runs/even_hops                     on one line; about 2 minutes a seed
"""

from __future__ import annotations

import math

import numpy as np

from fpg_bench.game.actions import KNOWLEDGE_GATE, PREFERENCE
from fpg_bench.players.agent import load_agent
from fpg_bench.players.player import Memory
from fpg_bench.players.scripted import player_noise
from fpg_bench.players.seeded import SeededPolicy

AGENT = "ally-discrete/ppo-stack8/seed_0"
_erf = np.vectorize(math.erf, otypes=[np.float32])


class EvenHops(SeededPolicy):
    """Player that hops and spreads when the agent does; the preference of a hop is uniform in [-1, 1]."""

    def __init__(self) -> None:
        self._agent = load_agent(AGENT, "ally")

    def _answer(
        self, seen: np.ndarray, state: Memory, starts: np.ndarray | None
    ) -> tuple[np.ndarray, Memory]:
        memory, steps = (None, np.zeros(len(seen), np.int64)) if state is None else state
        actions, memory = self._agent.predict(seen, memory, starts)
        steps = steps if starts is None else np.where(starts, 0, steps)
        actions[:, KNOWLEDGE_GATE] = -1.0
        actions[:, PREFERENCE] = _erf(player_noise(self.keys(len(seen)), steps)[:, 0] / math.sqrt(2))
        return actions, (memory, steps + 1)
