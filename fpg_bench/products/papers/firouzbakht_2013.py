"""Firouzbakht, Noubir and Salehi 2013: rates against jamming powers, solved and learned (arXiv 1310.5420)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import gymnasium
import numpy as np

from fpg_bench.common.checks import one_of
from fpg_bench.common.errors import UserError
from fpg_bench.products.papers.learners import Strategies, fictitious_play, minimax_q, q_learning
from fpg_bench.products.papers.reproduction import (
    Paper,
    PaperClaim,
    PaperResults,
    checked_action,
    differences,
    read_facts,
)

LEVELS, NOISE, SIGNAL, GREATEST = 20, 1.0, 100.0, 100.0
RATES = np.log2(1 + SIGNAL / (NOISE + np.linspace(0, GREATEST, LEVELS + 1))) / 2
EQUILIBRIUM, CONSTANT = JAMMERS = ("equilibrium", "constant")
PACKETS = 100
ROUNDS, PARTS = 50_000, (0.001, 0.01, 0.1, 1.0)
_EXPLOITABILITY = {part: f"exploitability, {100 * part:g} % of training" for part in PARTS}
MEASURES = {
    "guarantee": "mean rate kept against the best jammer of that mean power, bit per channel use",
    "ceiling": "mean rate of the best sender against this jammer, bit per channel use",
    **{
        name: f"ceiling less guarantee as a share of the value, after {100 * part:g} % of the training"
        for part, name in _EXPLOITABILITY.items()
    },
}


@dataclass(frozen=True)
class RateGame:
    """A packet at a rate gets through unless the jammer's power is above the level that the rate withstands.

    Attributes:
        rates: rates by the greatest level of power that they withstand, falling; the levels are equally
            spaced, from silence to the greatest power.
        mean_power: greatest mean power of the jammer, as a share of its greatest power.
    """

    rates: np.ndarray
    mean_power: float

    @property
    def mean_level(self) -> float:
        """Return the greatest mean level."""
        return round(self.mean_power * (len(self.rates) - 1), 9)

    @property
    def threshold(self) -> float:
        """Return the share of the greatest power from which on the mean power does not matter."""
        return float(1 - self.rates[-1] * (1 / self.rates[:-1]).mean())

    @property
    def payoffs(self) -> np.ndarray:
        """Return the pay-off of each rate against each level, ``(levels, levels)``."""
        return np.tril(np.tile(self.rates[:, None], len(self.rates)))

    @property
    def mixes(self) -> np.ndarray:
        """Return the extreme ones of the jammer's strategies, of one or two levels, ``(mixes, levels)``."""
        pure, levels, mean = np.eye(len(self.rates)), np.arange(len(self.rates)), self.mean_level
        low, high = (each.ravel() for each in np.meshgrid(levels[levels < mean], levels[levels > mean]))
        share = ((mean - low) / (high - low))[:, None]
        return np.vstack([pure[levels <= mean], (1 - share) * pure[low] + share * pure[high]])

    def equilibrium(self) -> Strategies:
        """Return the strategies of sender and jammer at equilibrium, in closed form.

        A sender that draws the first rates in inverse proportion to them is met with a pay-off that falls in
        a line over the jammer's power, and then is zero: mixing powers gains the jammer nothing. A jammer
        whose power is at most a level with a probability of v divided by its rate leaves v to each of them.
        """
        inverse = 1 / self.rates
        spread = (np.arange(1, len(inverse)) - self.mean_level) / inverse.cumsum()[:-1]
        count = int(spread.argmax()) + 1
        sender = np.where(np.arange(len(inverse)) < count, inverse, 0) / inverse[:count].sum()
        if spread.max() <= self.rates[-1]:
            sender = np.eye(len(inverse))[-1]
        value = max(float(spread.max()), float(self.rates[-1]))
        return sender, np.diff(np.minimum(1, value * inverse), prepend=0.0)

    def guarantee(self, sender: np.ndarray) -> float:
        """Return what a sender's strategy keeps against the best jammer."""
        return float((self.mixes @ (sender @ self.payoffs)).min())

    def ceiling(self, jammer: np.ndarray) -> float:
        """Return what the best sender keeps against a jammer's strategy."""
        return float((self.payoffs @ jammer).max())


def semi_uniform(game: RateGame) -> Strategies:
    """Return the best strategies that draw evenly from a range; a jammer is silent for the rest."""
    levels, silence = np.arange(len(game.rates)), np.eye(len(game.rates))[0]
    ranges = [
        ((levels >= first) & (levels <= last)) / (last - first + 1)
        for first, last in combinations_with_replacement(levels, 2)
    ]
    shares = [game.mean_level / max(float(each @ levels), game.mean_level) for each in ranges]
    jammers = [share * each + (1 - share) * silence for share, each in zip(shares, ranges, strict=True)]
    return max(ranges, key=game.guarantee), min(jammers, key=game.ceiling)


def one_choice(game: RateGame) -> Strategies:
    """Return the single rate with the best guarantee, and the jammer whose power is constant."""
    pure = np.eye(len(game.rates))
    return max(pure, key=game.guarantee), pure[int(game.mean_level)]


class RateEnv(gymnasium.Env[np.int64, np.int64]):
    """A sender chooses the rate of each packet, and a jammer of limited mean power draws a power.

    The observation is the level of jamming that the last packet met, from 0 to 20. The reward is the rate in
    bit per channel use if the packet got through, and 0 otherwise. Action 0 is the greatest rate.

    Args:
        jammer: ``equilibrium``, or ``constant``, which always has the mean power, rounded down to a level.
        mean_power: mean power of the jammer, as a share of its greatest power.

    Raises:
        UserError: an unknown jammer, or a mean power above the greatest one.
    """

    def __init__(self, jammer: str = EQUILIBRIUM, mean_power: float = 0.2) -> None:
        self.jammer = one_of(jammer, "jammer", JAMMERS)
        if not 0 < mean_power <= 1:
            raise UserError(f"mean_power: expected a share above 0, up to 1, got {mean_power}")
        game = RateGame(RATES, mean_power)
        self._chances = (game.equilibrium() if jammer == EQUILIBRIUM else one_choice(game))[1].cumsum()
        self.action_space = gymnasium.spaces.Discrete(len(RATES))
        self.observation_space = gymnasium.spaces.Discrete(len(RATES))
        self._packet = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.int64, dict[str, Any]]:
        """Start an episode of a hundred packets."""
        super().reset(seed=seed)
        self._packet = 0
        return self._level(), {}

    def step(self, action: np.int64) -> tuple[np.int64, float, bool, bool, dict[str, Any]]:
        """Send a packet."""
        level, rate = self._level(), checked_action(action, self.action_space)
        self._packet += 1
        reward = float(RATES[rate]) if level <= rate else 0.0
        return level, reward, False, self._packet >= PACKETS, {}

    def _level(self) -> np.int64:
        return np.int64(np.searchsorted(self._chances[:-1], self.np_random.random(), side="right"))


RULES = {"equilibrium": RateGame.equilibrium, "semi-uniform": semi_uniform, "one rate, one power": one_choice}
HEDGE = "Hedge"
SELF_PLAY = ("fictitious play", HEDGE, "minimax-Q")
Q_LEARNING = "Q-learning"


def learned(player: str, game: RateGame, rounds: Sequence[int], seed: int) -> list[Strategies]:
    """Train a player, and return the strategies of both sides after each number of rounds."""
    if player == Q_LEARNING:
        env, jammer = RateEnv(mean_power=game.mean_power), game.equilibrium()[1]
        tables = [
            q_learning(
                env, lambda level: 0, 1, count, seed, rate=0.02, gamma=0.0, exploration=lambda share: 0.1
            )
            for count in rounds
        ]
        return [(np.eye(len(RATES))[table[0].argmax()], jammer) for table in tables]
    payoffs = game.payoffs @ game.mixes.T
    if player == "minimax-Q":
        pairs = minimax_q(payoffs, rounds, seed, exploration=0.2)
    else:
        # The rate of Hedge that suits the number of rounds, as noise (Freund and Schapire 1997)
        noise = float(RATES[0] * np.sqrt(rounds[-1] / (8 * np.log(len(RATES))))) if player == HEDGE else 0.0
        pairs = fictitious_play(payoffs, rounds, seed, noise=noise)
    return [(sender, jammer @ game.mixes) for sender, jammer in pairs]


def play(player: str, condition: str, seed: int, share: float) -> dict[str, float]:
    """Train a player, or take a rule's strategies, and measure both sides against their best responses."""
    game = RateGame(RATES, float(condition.removeprefix(_MEAN)))
    rounds = [max(1, round(ROUNDS * share * part)) for part in PARTS]
    pairs = [RULES[player](game)] * len(rounds) if player in RULES else learned(player, game, rounds, seed)
    value = game.guarantee(game.equilibrium()[0])
    ends = [(game.guarantee(sender), game.ceiling(jammer)) for sender, jammer in pairs]
    gaps = [round((ceiling - guarantee) / value, 9) + 0.0 for guarantee, ceiling in ends]  # no -0
    return dict(zip(MEASURES, (*ends[-1], *gaps), strict=True))


_MEAN = "mean power "
LOW, MIDDLE, HIGH, FULL = CONDITIONS = tuple(f"{_MEAN}{share}" for share in (0.1, 0.2, 0.5, 1.0))
_SAME, _LEARNED = 0.001, 0.05
_SOLVED, _EVEN, _ONE = RULES
_LIMITED = (LOW, MIDDLE, HIGH)


def _threshold(results: PaperResults) -> Mapping[str, np.ndarray]:
    above = results.difference("guarantee", (_SOLVED, HIGH), (_SOLVED, FULL))
    below = results.difference("guarantee", (_SOLVED, MIDDLE), (_SOLVED, FULL))
    return {
        f"{HIGH}: as at full power, within {_SAME}": _SAME - np.abs(above),
        f"{MIDDLE}: the sender keeps more": below - _SAME,
    }


def _near(results: PaperResults) -> Mapping[str, np.ndarray]:
    senders = {f"sender, {name}": ((_EVEN, name), (_ONE, name)) for name in (LOW, MIDDLE)}
    jammers = {f"jammer, {name}": ((_ONE, name), (_EVEN, name)) for name in _LIMITED}
    return {**differences("guarantee", senders)(results), **differences("ceiling", jammers)(results)}


PAPER = Paper(
    facts=read_facts("firouzbakht_2013"),
    players=(*RULES, *SELF_PLAY, Q_LEARNING),
    conditions=CONDITIONS,
    measures=MEASURES,
    claims=(
        PaperClaim(
            "Above a threshold of its mean power, a jammer harms as much as one that always has full power",
            "abstract",
            _threshold,
        ),
        PaperClaim(
            "The value of the game at equilibrium has a closed form: neither side gains by leaving it",
            "abstract",
            lambda results: {
                f"{name}, within {_SAME}": _SAME - results.values(_SOLVED, name, _EXPLOITABILITY[1.0])
                for name in CONDITIONS
            },
        ),
        PaperClaim(
            "Randomisation assists a jammer of limited mean power, against one of constant power",
            "abstract",
            differences("ceiling", {name: ((_ONE, name), (_SOLVED, name)) for name in _LIMITED}),
        ),
        PaperClaim(
            "Simple, semi-uniform strategies approximate the equilibrium: nearer than one rate and one power",
            "abstract of the version of 2012; the comparison is ours",
            _near,
        ),
        PaperClaim(
            f"Self-play learns the equilibrium: exploitability below {100 * _LEARNED:g} % of the value",
            "not asked in the paper",
            lambda results: {
                f"{player}, {name}": _LEARNED - results.values(player, name, _EXPLOITABILITY[1.0])
                for player in SELF_PLAY
                for name in CONDITIONS
            },
        ),
        PaperClaim(
            "Q-learning against the jammer of the equilibrium ends with a rate that guarantees its value",
            "not asked in the paper",
            lambda results: {
                name: results.difference("guarantee", (Q_LEARNING, name), (_SOLVED, name)) + _SAME
                for name in CONDITIONS
            },
        ),
    ),
    play=play,
    curve=_EXPLOITABILITY,
)
