"""The board's recipe of responses to entries: two to each, on seeds that follow from its policies."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from fpg_bench.common.ids import other_side, policy_env
from fpg_bench.evaluation.seeds import PROTOCOL, TRAINING_STRIDE, TUNING_START
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.card import AgentCard
from fpg_bench.products.leaderboard.targets import Target

OWN = "recipe-"  # begins the names of the recipe's responses


@dataclass(frozen=True)
class ResponseRecipe:
    """The board's way of making responses to each entry.

    Attributes:
        n_responses: number of responses; each meets the entry's next training seed, and the first again after
            the last.
        algorithm, actions, steps, reward: of each training; ``zero_sum`` pays it for what the entry loses.
    """

    n_responses: int = 2
    algorithm: str = "ppo-stack8"
    actions: str = "discrete"
    steps: int = 1_500_000
    reward: str = "zero_sum"

    def seed(self, fingerprint: str, number: int) -> int:
        """Return the training seed of a response, which nobody knows before the policy is entered.

        Args:
            fingerprint: hash of the policy, or the script's name.
            number: of the response.
        """
        text = f"fpg-bench/{PROTOCOL}/response/{number}/{fingerprint}"
        digest = hashlib.sha256(text.encode()).digest()
        return int.from_bytes(digest[:8], "big") % (TUNING_START // TRAINING_STRIDE)

    def game(self, target: Target, number: int) -> GameSpec:
        """Return the game of a response's training, whatever the entry says of its own."""
        return GameSpec.of(
            policy_env(other_side(target.side)).id,
            against=target.players[number % len(target.players)],
            scenario=target.submission.scenario,
            path=target.entry.scenario.opponent_path,
            actions=self.actions,
            reward=self.reward,
        )

    def difference(self, card: AgentCard, target: Target, number: int) -> str | None:
        """Return the first thing in which a response differs from the recipe's; None if nothing does."""
        expected = {
            "algorithm": self.algorithm,
            "training_steps": self.steps,
            "training_seed": self.seed(target.parts[number % len(target.parts)].fingerprint, number),
        }
        for name, value in expected.items():
            if getattr(card, name) != value:
                return f"{name}: expected {value}, got {getattr(card, name)}"
        for name in ("actions", "reward"):
            if getattr(card.game, name) != getattr(self, name):
                return f"game: {name}: expected {getattr(self, name)}, got {getattr(card.game, name)}"
        return None


RECIPE = ResponseRecipe()
