"""Registry of algorithms: SB3's, with an LSTM or stacked frames, MADDPG, offline ones, and custom classes."""

from __future__ import annotations

import importlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.ids import DUEL, OFFLINE
from fpg_bench.common.imports import imported
from fpg_bench.common.products import offered

# Of one side, with shipped hyper-parameters.
ALGORITHMS = ("ppo", "ppo-fast", "ppo-stack8", "recurrent-ppo", "maskable-ppo", "sac", "td3", "dqn", "qr-dqn")
_CLASSES = {
    "ppo": "stable_baselines3:PPO",
    "sac": "stable_baselines3:SAC",
    "td3": "stable_baselines3:TD3",
    "dqn": "stable_baselines3:DQN",
    "recurrent-ppo": "sb3_contrib:RecurrentPPO",
    "qr-dqn": "sb3_contrib:QRDQN",
    "maskable-ppo": "sb3_contrib:MaskablePPO",
    **offered("algorithm"),
}
_VARIANTS = {"ppo-fast": "ppo"}  # the same class with its own hyper-parameter file
_STACKED = re.compile(rf"(ppo|sac|td3|dqn|qr-dqn|maskable-ppo|{'|'.join(OFFLINE)})-stack([1-9]\d*)")


@dataclass(frozen=True)
class Algorithm:
    """A registered algorithm.

    Attributes:
        name: name in tables and folders.
        base: name of its class, without stacked frames or variant; an algorithm without a hyper-parameter
            file or search space uses those of the base.
        kind: the class, a subclass of SB3's ``BaseAlgorithm``.
        frame_stack: number of stacked observations; None leaves it to the hyper-parameters.
        custom: True for a user's own class.
    """

    name: str
    base: str
    kind: type[Any]
    frame_stack: int | None = None
    custom: bool = False

    @property
    def joint(self) -> bool:
        """True if it trains both sides at once."""
        return self.base == "maddpg"

    @property
    def offline(self) -> bool:
        """True if it learns from a data set."""
        return self.base in OFFLINE

    def check_sides(self, env_id: str, sides: Sequence[str]) -> None:
        """Raise UserError if it trains both sides and the id has one, or the other way round."""
        if self.joint != (len(sides) == 2):
            scope = "both sides, in" if self.joint else "one side, not both, as in"
            raise UserError(f"{self.name}: trains {scope} {DUEL}; got {env_id}")


def find_algorithm(name: str | type[Any]) -> Algorithm:
    """Return the algorithm of a name or a class.

    Args:
        name: ``ppo``, ``sac``, ``td3``, ``recurrent-ppo``, ``ppo-fast`` (PPO tuned for the least time to a
            score), ``dqn``, ``qr-dqn``, ``maskable-ppo``, ``ppo-stack8`` (any number of frames, on any of
            them without an LSTM), ``maddpg``, a name of :data:`fpg_bench.common.ids.OFFLINE`,
            ``package.module:Class``, or a class.

    Raises:
        UserError: no such algorithm, or a class that is not a subclass of SB3's ``BaseAlgorithm``.
    """
    if isinstance(name, type):
        return _custom(f"{name.__module__}:{name.__qualname__}", name)
    if ":" in name:
        return _custom(name, imported(name, "algorithm"))
    if stacked := _STACKED.fullmatch(name):
        return Algorithm(name, stacked[1], _registered(stacked[1]), int(stacked[2]))
    base = _VARIANTS.get(name, name)
    if base not in _CLASSES:
        raise UserError(f"unknown algorithm {name!r}{nearest(name, (*ALGORITHMS, *offered('algorithm')))}")
    return Algorithm(name, base, _registered(base))


def _registered(base: str) -> Any:
    """Return a registered class; unlike a user's own, it is not searched in the current folder."""
    module, _, name = _CLASSES[base].partition(":")
    return getattr(importlib.import_module(module), name)


def _custom(name: str, kind: object) -> Algorithm:
    from stable_baselines3.common.base_class import BaseAlgorithm

    if not (isinstance(kind, type) and issubclass(kind, BaseAlgorithm)):
        raise UserError(f"algorithm {name!r}: is not a subclass of stable_baselines3's BaseAlgorithm")
    return Algorithm(name, name, kind, custom=True)
