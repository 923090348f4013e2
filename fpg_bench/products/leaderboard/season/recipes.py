"""Recipes of a season's candidates: how each is trained or searched, and against whom.

All draws follow from the season's seed by SHA-256, so they are the same on every machine and version.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TypeVar

from fpg_bench.common.errors import UserError
from fpg_bench.common.schema import Items, Strict
from fpg_bench.products.leaderboard.season.entries import SeasonEntry
from fpg_bench.training.rl_zoo3_format import Entry

REWARD = "own"  # who is paid otherwise plays what nobody would who pays the prices of the rules
DISCRETE = "-discrete"  # ends the names of algorithms that choose from the list of actions
# How candidates are made, in turn: by PPO, or as rules and tables (fpg_bench.products.league), which are
# searched without a network. A weakness that is common to one kind of players shall not decide a ranking.
SEARCHED = ("rule", "table")
ALGORITHMS = (
    "ppo-fast-stack8-discrete",
    "rule",
    "ppo-fast-memory-discrete",
    "table",
    "ppo-fast-discrete",
    "rule",
)
# Value learners, a kind that no member is of, tell whether others than the members order entries alike.
STRANGERS = ("qr-dqn-memory-discrete", "dqn-memory-discrete")
STEPS = {  # of a search, its generations
    **dict.fromkeys(ALGORITHMS, (1_000_000, 2_000_000)),
    "rule": (70, 100),
    "table": (100, 200),
    **dict.fromkeys(STRANGERS, (400_000,)),
}
GAMMAS = dict.fromkeys(ALGORITHMS, (0.9, 0.95, 0.8)) | dict.fromkeys(STRANGERS, (0.9, 0.8))
# Number of players that each is trained against.
TARGETS = dict.fromkeys(ALGORITHMS, (6, 3, 12)) | dict.fromkeys(STRANGERS, (12,))
FIRST_SEED, SEEDS = 300_000, 700_000  # candidates have the training seeds from 300,000 to 999,999
_PPO = {
    "policy": "MlpPolicy",
    "n_envs": 192,
    "n_steps": 64,
    "batch_size": 3072,
    "n_epochs": 4,
    "learning_rate": "lin_0.001",
    "gae_lambda": 0.8,
    "ent_coef": 0.005,
    "normalize": {"norm_obs": False, "norm_reward": True},
}
_DQN = {
    "policy": "MlpPolicy",
    "n_envs": 64,
    "learning_starts": 5000,
    "buffer_size": 200_000,
    "batch_size": 256,
    "train_freq": 2,
    "gradient_steps": 4,
    "learning_rate": 0.0005,
    "target_update_interval": 2000,
    "exploration_fraction": 0.3,
    "exploration_final_eps": 0.03,
    "normalize": {"norm_obs": False, "norm_reward": True},
}
T = TypeVar("T")


class Recipe(Strict):
    """Training configuration of one candidate.

    Attributes:
        name: the candidate's name in the suite.
        side: the side it plays.
        steps: of training; of a search, its generations.
        gamma: None of a search.
        log_std: initial log standard deviation of PPO's continuous actions; None for choices from the list.
        targets: the players it is trained against, one drawn per round.
        path: the opponent's path during training.
    """

    name: str
    side: str
    algorithm: str
    steps: int
    reward: str
    gamma: float | None
    log_std: float | None = None
    targets: Items[str]
    path: str
    training_seed: int


def draw_number(below: int, *key: object) -> int:
    """Draw a whole number in [0, below) from the hash of a key."""
    return int(_digest(*key), 16) % below


def shuffled(items: Sequence[T], *key: object) -> list[T]:
    """Return the items in an order drawn from a key."""
    order = sorted(range(len(items)), key=lambda i: _digest(*key, i))
    return [items[i] for i in order]


def assign_balanced(values: Sequence[T], count: int, *key: object) -> list[T]:
    """Assign values to ``count`` places in an order drawn from a key.

    Each value is assigned equally often; if they do not divide evenly, the first ones once more.
    """
    return shuffled([values[i % len(values)] for i in range(count)], *key)


def _digest(*key: object) -> str:
    return hashlib.sha256("/".join(map(str, key)).encode()).hexdigest()


def draw_recipes(
    seed: str,
    side: str,
    count: int,
    pool: Sequence[SeasonEntry],
    algorithms: Sequence[str] = ALGORITHMS,
    prefix: str = "",
) -> list[Recipe]:
    """Draw the recipes of a side's candidates.

    Algorithms take turns. The values of all other properties are balanced over the candidates of an
    algorithm, so the seed decides only how they are combined.

    Args:
        seed: the season's seed.
        side: the candidates' side.
        count: number of candidates.
        pool: players of the other side, to be trained against.
        algorithms: their algorithms.
        prefix: of their names, before the side's letter.

    Raises:
        UserError: nobody to train against.
    """
    if not pool:
        raise UserError(f"season: no entries to train candidates of the {side} against")
    taken = [algorithms[i % len(algorithms)] for i in range(count)]
    of = prefix + side

    def assign(name: str, choices: Mapping[str, Sequence[T]] | Sequence[T]) -> list[T]:
        """Return a property's value for each candidate; choices may depend on the algorithm."""
        per_algorithm = {}
        for algorithm, number in Counter(taken).items():
            values = choices[algorithm] if isinstance(choices, Mapping) else choices
            per_algorithm[algorithm] = iter(assign_balanced(values, number, seed, of, name, algorithm))
        return [next(per_algorithm[algorithm]) for algorithm in taken]

    gammas, steps = assign("gamma", GAMMAS), assign("steps", STEPS)
    targets = _draw_targets(seed, of, assign("size", TARGETS), pool)
    return [
        Recipe(
            name=f"{prefix}{side[0]}{i:02d}",
            side=side,
            algorithm=algorithm,
            steps=steps[i],
            reward=REWARD,
            gamma=None if algorithm in SEARCHED else gammas[i],
            targets=targets[i][0],
            path=targets[i][1],
            training_seed=FIRST_SEED + draw_number(SEEDS, seed, of, "seed", i),
        )
        for i, algorithm in enumerate(taken)
    ]


def _draw_targets(
    seed: str, of: str, sizes: Sequence[int], pool: Sequence[SeasonEntry]
) -> list[tuple[tuple[str, ...], str]]:
    """Draw the players that each candidate is trained against, and the opponent's path.

    Each player of the pool is the first target equally often, so of at most two candidates where the pool is
    half as large as their number. Opponents with different paths are never mixed; scripts fit either path.
    """
    targets = []
    for i, (first, size) in enumerate(
        zip(assign_balanced(pool, len(sizes), seed, of, "first"), sizes, strict=True)
    ):
        flight = None if first.is_script else first.flight
        others = [e for e in pool if e.name != first.name and (e.is_script or e.flight in (None, flight))]
        chosen = [first, *shuffled(others, seed, of, "mixture", i)[: size - 1]]
        players = tuple(e.players[draw_number(len(e.players), seed, of, "player", i, e.name)] for e in chosen)
        targets.append((players, flight or "pursuit"))
    return targets


def hyperparameters(recipe: Recipe) -> Entry:
    """Return a trained recipe's hyperparameters for :class:`fpg_bench.training.config.RunConfig`."""
    policy_kwargs: Entry = {"net_arch": [64, 64]}
    own = {"n_timesteps": recipe.steps, "gamma": recipe.gamma, "policy_kwargs": policy_kwargs}
    if recipe.algorithm in STRANGERS:
        policy_kwargs |= {"n_quantiles": 20} if recipe.algorithm.startswith("qr-dqn") else {}
        return _DQN | own
    policy_kwargs["activation_fn"] = "ReLU"
    return _PPO | own


def kind_of(algorithm: str) -> str:
    """Return the kind of a candidate's algorithm: ``rule``, ``table`` or ``ppo``."""
    return algorithm if algorithm in SEARCHED else "ppo"
