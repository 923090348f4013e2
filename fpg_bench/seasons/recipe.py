"""Recipes: how each candidate for a field is trained, drawn evenly from what makes players differ.

Draws follow from a season's seed by SHA-256 alone: the same on every machine, in every version.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from fpg_bench.errors import UserError

# What candidates are paid for. An ally that is paid for spending little never hops: that is the script idle.
REWARDS = {
    "opponent": ("against", "jamming", "overlap", "own", "spending"),
    "ally": ("against", "jamming", "own", "overlap"),
}
# TD3 twice: it finds opponents that herd, to whom most entries fall, where PPO of this budget seldom does.
ALGORITHMS = ("td3", "ppo", "td3", "ppo-stack8")
STEPS = {
    "ppo": (500_000, 250_000),
    "ppo-stack8": (500_000, 250_000),
    "td3": (40_000,),
}
GAMMAS = (0.9, 0.95, 0.8)
# How widely PPO draws at first decides what an opponent learns: if widely, it learns to jam broadly.
LOG_STDS = {"opponent": (-2.5, -1.5, -3.5), "ally": (-0.2, -1.0)}
TARGETS = (1, 3, 1, 5)  # a single entry, or a mixture of so many
FIRST_SEED, SEEDS = 300_000, 700_000  # training seeds that nobody else takes
T = TypeVar("T")


@dataclass(frozen=True)
class Target:
    """An entry that candidates may be trained against.

    Attributes:
        name: the entry's.
        players: its training seeds as players, or the script itself.
        flight: how it flies where it is an opponent: ``pursuit`` or ``learned``; scripts do both.
    """

    name: str
    players: tuple[str, ...]
    flight: str | None = None

    @property
    def scripted(self) -> bool:
        """Whether it is a script."""
        return "/" not in self.players[0]


@dataclass(frozen=True)
class Recipe:
    """How one candidate is trained.

    Attributes:
        name: what the field calls it.
        side: the side that it plays.
        log_std: of PPO's first draws; None for TD3.
        targets: the players that it is trained against, one drawn per round.
        path: how the opponent flies meanwhile.
    """

    name: str
    side: str
    algorithm: str
    steps: int
    reward: str
    gamma: float
    log_std: float | None
    targets: tuple[str, ...]
    path: str
    training_seed: int

    def words(self) -> dict[str, Any]:
        """As YAML and JSON hold it."""
        return {**self.__dict__, "targets": list(self.targets)}


def draw_recipes(
    seed: str, side: str, count: int, targets: Sequence[Target], scale: float = 1.0
) -> list[Recipe]:
    """The candidates of a side.

    The algorithms take turns, and every other property is dealt evenly over the candidates of an
    algorithm: what a closing consists of does not depend on its seed, only what goes together with what.

    Args:
        seed: the season's.
        side: the side that the candidates play.
        count: how many.
        targets: the entries of the other side.
        scale: multiplies all budgets.

    Raises:
        UserError: no entry to be trained against.
    """
    if not targets:
        raise UserError(f"season: there is no entry that candidates of the {side} could be trained against")
    algorithms = [ALGORITHMS[i % len(ALGORITHMS)] for i in range(count)]
    dealer = _Dealer((seed, side), algorithms)
    rewards, gammas = dealer.deal("reward", REWARDS[side]), dealer.deal("gamma", GAMMAS)
    steps = dealer.deal("steps", STEPS)
    log_stds = dealer.deal("log_std", LOG_STDS[side])
    met = _met((seed, side), dealer.deal("size", TARGETS), targets)
    return [
        Recipe(
            name=f"{side[0]}{i:02d}",
            side=side,
            algorithm=algorithm,
            steps=round(scale * steps[i]),
            reward=rewards[i],
            gamma=gammas[i],
            log_std=None if algorithm == "td3" else log_stds[i],
            targets=met[i][0],
            path=met[i][1],
            training_seed=FIRST_SEED + number(SEEDS, seed, side, "seed", i),
        )
        for i, algorithm in enumerate(algorithms)
    ]


class _Dealer:
    """Deals the values of a property evenly over the candidates of each algorithm.

    Args:
        seed: words of the draw.
        algorithms: of each candidate.
    """

    def __init__(self, seed: tuple[str, str], algorithms: Sequence[str]) -> None:
        self._seed, self._algorithms = seed, algorithms

    def deal(self, what: str, levels: Any) -> list[Any]:
        """A value for each candidate.

        Args:
            what: the property.
            levels: its values, or those of each algorithm.
        """
        counts, hands = Counter(self._algorithms), {}
        for name, count in counts.items():
            own = levels[name] if isinstance(levels, dict) else levels
            hands[name] = iter(dealt(own, count, *self._seed, what, name))
        return [next(hands[name]) for name in self._algorithms]


def _met(
    seed: tuple[str, str], sizes: Sequence[int], targets: Sequence[Target]
) -> list[tuple[tuple[str, ...], str]]:
    """Per candidate: the players that it is trained against, and how the opponent flies there.

    The first, or only, one is a trained entry wherever there are any; each of them is first equally often.
    """
    trained = [target for target in targets if not target.scripted] or list(targets)
    firsts = dealt(trained, len(sizes), *seed, "first")
    found = []
    for i, (first, size) in enumerate(zip(firsts, sizes, strict=True)):
        others = [t for t in targets if t.name != first.name and t.flight in (None, first.flight)]
        chosen = [first, *shuffled(others, *seed, "mixture", i)[: size - 1]]
        players = tuple(t.players[number(len(t.players), *seed, "player", i, t.name)] for t in chosen)
        found.append((players, first.flight or "pursuit"))
    return found


def digest(*words: object) -> str:
    """SHA-256 of words, as 64 hexadecimal digits; slashes part them."""
    return hashlib.sha256("/".join(map(str, words)).encode()).hexdigest()


def number(below: int, *words: object) -> int:
    """A whole number in [0, below)."""
    return int(digest(*words), 16) % below


def shuffled(items: Sequence[T], *words: object) -> list[T]:
    """The items in a drawn order."""
    order = sorted(range(len(items)), key=lambda i: digest(*words, i))
    return [items[i] for i in order]


def dealt(levels: Sequence[T], count: int, *words: object) -> list[T]:
    """One level for each of ``count``, in a drawn order; the first ones once more where they are too few."""
    return shuffled([levels[i % len(levels)] for i in range(count)], *words)
