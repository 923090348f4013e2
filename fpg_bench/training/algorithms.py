"""Registry of algorithms: SB3's, with an LSTM or stacked frames, those of products, and custom classes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

from fpg_bench.common.checks import of_kind
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.ids import DUEL
from fpg_bench.common.imports import imported
from fpg_bench.common.products import load, offered

_ONE, JOINT, OFFLINE = (
    tuple(name for name, offer in offered("algorithm").items() if offer.trains == what)
    for what in ("one", "both", "data")
)
# Of one side, that learn by playing; of stacked frames and of memory an example.
ALGORITHMS = (*_ONE, "ppo-stack8", "ppo-memory")
_OBSERVING = re.compile(r"(.*?)(?:-stack([1-9]\d*))?(-memory)?", re.DOTALL)


@dataclass(frozen=True)
class Algorithm:
    """A registered algorithm.

    Attributes:
        name: name in tables and folders.
        base: name of its class, without stacked frames, memory or variant; an algorithm without a
            hyper-parameter file or search space uses those of the base.
        kind: the class, a subclass of SB3's ``BaseAlgorithm``.
        frame_stack: number of stacked observations; None leaves it to the hyper-parameters.
        memory: True if it observes its memory; False leaves it to the hyper-parameters.
        custom: True for a user's own class.
        search: the algorithm whose search space it has.
        joint: True if it trains both sides at once.
        offline: True if it learns from a data set; then its class names the action ``modes`` that it learns.
    """

    name: str
    base: str
    kind: type[Any]
    frame_stack: int | None = None
    memory: bool = False
    custom: bool = False
    search: str = ""
    joint: bool = False
    offline: bool = False

    def check_sides(self, env_id: str, sides: Sequence[str]) -> None:
        """Raise UserError if it trains both sides and the id has one, or the other way round."""
        if self.joint != (len(sides) == 2):
            scope = "both sides, in" if self.joint else "one side, not both, as in"
            got = env_id if self.joint or env_id == DUEL else f"{env_id} without a side"
            raise UserError(f"{self.name}: trains {scope} {DUEL}; got {got}")


def find_algorithm(name: str | type[Any]) -> Algorithm:
    """Return the algorithm of a name or a class.

    Args:
        name: one of :data:`ALGORITHMS`, :data:`JOINT` and :data:`OFFLINE`, of most of them also with any
            number of stacked frames (``sac-stack4``), with a memory (``ppo-stack8-memory``),
            ``package.module:Class``, or a class.

    Raises:
        UserError: no such algorithm, or a class that is not a subclass of SB3's ``BaseAlgorithm``.
    """
    if isinstance(name, type):
        return _custom(f"{name.__module__}:{name.__qualname__}", name)
    if ":" in of_kind(name, "algorithm", "a name or a class", str):
        return _custom(name, imported(name, "algorithm"))
    root, frames, memory = cast("re.Match[str]", _OBSERVING.fullmatch(name)).groups()
    offer = offered("algorithm").get(root)
    if offer is None or (frames and not offer.stacks) or (memory and offer.trains != "one"):
        import stable_baselines3

        is_sb3 = hasattr(stable_baselines3, name.upper())
        hint = f"; write stable_baselines3:{name.upper()}" if is_sb3 else ""
        raise UserError(f"unknown algorithm {name!r}{hint or nearest(name, (*ALGORITHMS, *JOINT, *OFFLINE))}")
    return Algorithm(
        name,
        offer.base or root,
        load("algorithm", root),  # unlike a user's own, not searched for in the current folder
        int(frames) if frames else None,
        bool(memory),
        search=offer.search or offer.base or root,
        joint=offer.trains == "both",
        offline=offer.trains == "data",
    )


def _custom(name: str, kind: object) -> Algorithm:
    from stable_baselines3.common.base_class import BaseAlgorithm

    if not (isinstance(kind, type) and issubclass(kind, BaseAlgorithm)):
        raise UserError(f"algorithm {name!r}: is not a subclass of stable_baselines3's BaseAlgorithm")
    return Algorithm(name, name, kind, custom=True, search=name)
