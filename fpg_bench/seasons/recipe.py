"""Recipes: how each candidate for a field is trained, drawn evenly from what makes players differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.seasons.drawing import dealt, digest, number, shuffled

# What candidates are paid for. An ally that is paid for spending little never hops: that is the script idle.
REWARDS = {
    "opponent": ("own", "against", "jamming", "overlap", "spending"),
    "ally": ("own", "against", "jamming", "overlap"),
}
# Written twice: dealt twice as often.
ALGORITHMS = ("ppo", "ppo", "ppo", "ppo-stack8", "ppo-stack8", "sac")
STEPS = {
    "ppo": (250_000, 500_000, 1_000_000),
    "ppo-stack8": (250_000, 500_000, 1_000_000),
    "sac": (20_000, 40_000),
}
GAMMAS = (0.8, 0.9, 0.95)
ENTROPIES = (0.0, 0.0, 0.01)
TARGETS = (1, 1, 3, 5)  # a single entry, or a mixture of so many
FLIGHTS = ("pursuit",) * 7 + ("learned",)
FIRST_SEED, SEEDS = 300_000, 700_000  # training seeds that nobody else takes


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


@dataclass(frozen=True)
class Recipe:
    """How one candidate is trained.

    Attributes:
        name: what the field calls it.
        side: the side that it plays.
        targets: the players that it is trained against, one drawn per round.
        path: how the opponent flies meanwhile, and where it is met.
    """

    name: str
    side: str
    algorithm: str
    steps: int
    reward: str
    gamma: float
    ent_coef: float
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

    Every property is dealt evenly over the candidates, in an order of its own, so that a few of them hold
    all of its values. Single entries are taken in turn: nobody is answered twice before everybody was once.

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
    own = (seed, side)
    rewards = dealt(REWARDS[side], count, *own, "reward")
    algorithms = dealt(ALGORITHMS, count, *own, "algorithm")
    gammas = dealt(GAMMAS, count, *own, "gamma")
    entropies = dealt(ENTROPIES, count, *own, "entropy")
    flights = dealt(FLIGHTS, count, *own, "flight") if side == "opponent" else [None] * count
    steps = {name: dealt(levels, count, *own, "steps", name) for name, levels in STEPS.items()}
    met = _met(seed, side, count, targets)
    recipes = []
    for i in range(count):
        players, path = met[i]
        recipes.append(
            Recipe(
                name=f"{side[0]}{i:02d}",
                side=side,
                algorithm=algorithms[i],
                steps=round(scale * steps[algorithms[i]][i]),
                reward=rewards[i],
                gamma=gammas[i],
                ent_coef=entropies[i],
                targets=players,
                path=flights[i] or path,
                training_seed=FIRST_SEED + number(SEEDS, *own, "seed", i),
            )
        )
    return recipes


def _met(seed: str, side: str, count: int, targets: Sequence[Target]) -> list[tuple[tuple[str, ...], str]]:
    """Per candidate: the players that it is trained against, and how opponents fly there."""
    sizes = dealt(TARGETS, count, seed, side, "size")
    singles = iter(dealt(targets, count, seed, side, "single"))
    found = []
    for i, size in enumerate(sizes):
        first = next(singles)
        others = [t for t in targets if t.name != first.name and _fly_alike(first, t)]
        chosen = [first, *shuffled(others, seed, side, "mixture", i)[: size - 1]]
        players = tuple(t.players[number(len(t.players), seed, side, "player", i, t.name)] for t in chosen)
        learned = any(t.flight == "learned" for t in chosen)
        found.append((players, "learned" if learned else "pursuit"))
    return found


def _fly_alike(first: Target, other: Target) -> bool:
    """Whether two opponents can be met in one game; a script flies in either."""
    return None in (first.flight, other.flight) or first.flight == other.flight


def plan_hash(recipes: Sequence[Recipe]) -> str:
    """SHA-256 of recipes: two lists of one hash train the same candidates."""
    return digest(*(sorted(recipe.words().items()) for recipe in recipes))
