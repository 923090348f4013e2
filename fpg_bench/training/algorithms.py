"""Registry of algorithms: SB3's, with an LSTM or stacked frames, those of products, and custom classes."""

from __future__ import annotations

import pkgutil
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.ids import DUEL
from fpg_bench.common.imports import imported
from fpg_bench.common.products import offered


@dataclass(frozen=True)
class _Row:
    """Row of the table of algorithms.

    Attributes:
        place: its class, as ``module:Class``.
        base: the algorithm of which it is a variant, with hyper-parameters of its own; None: it is none.
        search: the algorithm whose search space it has; None: its own.
        stacks: it may see stacked frames, as ``ppo-stack8``.
        joint: it trains both sides at once.
        offline: it learns from a data set.
    """

    place: str
    base: str | None = None
    search: str | None = None
    stacks: bool = True
    joint: bool = False
    offline: bool = False


_TABLE = {
    "ppo": _Row("stable_baselines3:PPO"),
    "ppo-fast": _Row("fpg_bench.training.fast_ppo:FastPPO", base="ppo", stacks=False),  # soonest at a score
    "recurrent-ppo": _Row("sb3_contrib:RecurrentPPO", search="ppo", stacks=False),
    "maskable-ppo": _Row("sb3_contrib:MaskablePPO", search="ppo"),
    "sac": _Row("stable_baselines3:SAC"),
    "td3": _Row("stable_baselines3:TD3"),
    "dqn": _Row("stable_baselines3:DQN"),
    "qr-dqn": _Row("sb3_contrib:QRDQN", search="dqn"),
}
_TABLE |= {name: _Row(place) for name, place in offered("algorithm").items()}
ALGORITHMS = (*_TABLE, "ppo-stack8")  # of one side, that learn by playing; of stacked frames an example
JOINT, OFFLINE = tuple(offered("joint algorithm")), tuple(offered("offline algorithm"))
_TABLE |= {name: _Row(place, stacks=False, joint=True) for name, place in offered("joint algorithm").items()}
_TABLE |= {name: _Row(place, offline=True) for name, place in offered("offline algorithm").items()}
_STACKED = re.compile(r"(.+)-stack([1-9]\d*)")


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
        search: the algorithm whose search space it has.
        joint: True if it trains both sides at once.
        offline: True if it learns from a data set; then its class names the action ``modes`` that it learns.
    """

    name: str
    base: str
    kind: type[Any]
    frame_stack: int | None = None
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
            number of stacked frames (``sac-stack4``), ``package.module:Class``, or a class.

    Raises:
        UserError: no such algorithm, or a class that is not a subclass of SB3's ``BaseAlgorithm``.
    """
    if isinstance(name, type):
        return _custom(f"{name.__module__}:{name.__qualname__}", name)
    if ":" in name:
        return _custom(name, imported(name, "algorithm"))
    stacked = _STACKED.fullmatch(name)
    root = stacked[1] if stacked else name
    row = _TABLE.get(root)
    if row is None or (stacked and not row.stacks):
        raise UserError(f"unknown algorithm {name!r}{nearest(name, (*_TABLE, *ALGORITHMS))}")
    return Algorithm(
        name,
        row.base or root,
        pkgutil.resolve_name(row.place),  # unlike a user's own, not searched for in the current folder
        int(stacked[2]) if stacked else None,
        search=row.search or row.base or root,
        joint=row.joint,
        offline=row.offline,
    )


def _custom(name: str, kind: object) -> Algorithm:
    from stable_baselines3.common.base_class import BaseAlgorithm

    if not (isinstance(kind, type) and issubclass(kind, BaseAlgorithm)):
        raise UserError(f"algorithm {name!r}: is not a subclass of stable_baselines3's BaseAlgorithm")
    return Algorithm(name, name, kind, custom=True, search=name)
