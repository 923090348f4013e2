"""Which algorithm a name means: Stable-Baselines3's, with an LSTM or stacked frames, or one's own class."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from fpg_bench.errors import UserError, nearest
from fpg_bench.imports import imported

# Of one side, with shipped hyper-parameters.
ALGORITHMS = ("ppo", "ppo-fast", "ppo-stack8", "recurrent-ppo", "sac", "td3")
_CLASSES = {
    "ppo": "stable_baselines3:PPO",
    "sac": "stable_baselines3:SAC",
    "td3": "stable_baselines3:TD3",
    "recurrent-ppo": "sb3_contrib:RecurrentPPO",
    "maddpg": "fpg_bench.training.maddpg:MADDPG",
}
_VARIANTS = {"ppo-fast": "ppo"}  # the same class with a hyper-parameter file of its own
_STACKED = re.compile(r"(ppo|sac|td3)-stack([1-9]\d*)")


@dataclass(frozen=True)
class Algorithm:
    """What a name means.

    Attributes:
        name: what tables and folders say.
        base: the name of its class: without stacked frames, or what it is a variant of; where it has no
            hyper-parameter file and no search space of its own, it takes those of this name.
        kind: the class, a subclass of SB3's ``BaseAlgorithm``.
        frame_stack: how many of the last observations it sees at once; None: as its hyper-parameters say.
        custom: whether it is a class of the user's.
    """

    name: str
    base: str
    kind: type[Any]
    frame_stack: int | None = None
    custom: bool = False

    @property
    def joint(self) -> bool:
        """Whether it trains both sides at once."""
        return self.base == "maddpg"


def find_algorithm(name: str | type[Any]) -> Algorithm:
    """The algorithm of a name: ``ppo``, ``sac``, ``td3``, ``recurrent-ppo``, ``ppo-stack8`` (any number of
    frames, on any of the first three), ``ppo-fast`` (PPO with values that reach a score in the least time),
    ``maddpg``, or ``package.module:Class``; or of a class itself.

    Raises:
        UserError: no such algorithm, or no algorithm class of Stable-Baselines3's kind.
    """
    if isinstance(name, type):
        return _custom(f"{name.__module__}:{name.__qualname__}", name)
    if ":" in name:
        return _custom(name, imported(name, "algorithm"))
    if stacked := _STACKED.fullmatch(name):
        return Algorithm(name, stacked[1], imported(_CLASSES[stacked[1]], "algorithm"), int(stacked[2]))
    base = _VARIANTS.get(name, name)
    if base not in _CLASSES:
        hint = nearest(name, (*ALGORITHMS, "maddpg"))
        raise UserError(f"unknown algorithm {name!r}{hint}")
    return Algorithm(name, base, imported(_CLASSES[base], "algorithm"))


def _custom(name: str, kind: Any) -> Algorithm:
    from stable_baselines3.common.base_class import BaseAlgorithm

    if not (isinstance(kind, type) and issubclass(kind, BaseAlgorithm)):
        raise UserError(f"algorithm {name!r}: is no subclass of stable_baselines3's BaseAlgorithm")
    return Algorithm(name, name, kind, custom=True)
