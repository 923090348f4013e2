"""Double oracle: a side answers responses to it, iteration by iteration.

McMahan, Gordon and Blum, "Planning in the presence of cost functions controlled by an adversary", 2003, with
trained policies as the oracles (PSRO: Lanctot et al., "A unified game-theoretic approach to multiagent
reinforcement learning", 2017). Each side's oracle trains an answer to a mixture of the other side's
population; a meta-solver says to which.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from fpg_bench.products.league.config import DoubleOracleConfig
from fpg_bench.products.league.search import Search, SearchResult, shares
from fpg_bench.training.train import train

PARTS = 100  # into which the shares of an equilibrium's players are rounded


def double_oracle(config: DoubleOracleConfig, out: str | Path, *, progress: bool = True) -> SearchResult:
    """Train a side against responses, and responses against the side.

    An iteration goes on from the weights of the one before; then a fresh response is trained, and both join
    their populations. By the meta-solver ``weights`` the side answers all rivals, each response listed
    ``weight`` times, and the response the side's newest policy alone. By ``nash`` the side answers the other
    side's mixture in the equilibrium of all policies so far, and the response that of the side, the new
    policy included.

    Args:
        config: the search.
        out: its folder; see :class:`fpg_bench.products.league.search.Search` for the files.
        progress: show the progress of each training.

    Returns:
        The result. ``high`` is what a policy earns from the rivals of its training, by their weights, which
        bounds the game's value from above as far as the training found a best answer; ``low`` is, by
        ``nash``, what the side's mixture keeps.

    Raises:
        UserError: something unknown or out of range, or a folder with another search or other files.
        KeyboardInterrupt: stopped by the user.
    """
    return _SOLVED_BY[config.meta_solver](config, out, progress).run()


class _DoubleOracle(Search):
    """A double oracle in which the side answers all rivals by their weights."""

    config: DoubleOracleConfig

    def rivals(self, iteration: int) -> list[str]:
        """Return the rivals that an iteration answers, those with a weight several times."""
        responses = [str(self.response(before).agent) for before in range(iteration)]
        return [*self.game.others, *(name for name in responses for _ in range(self.config.weight))]

    def learn(self, iteration: int) -> int:
        """Train the side's answer; return the number of rivals."""
        rivals = self.rivals(iteration)
        run = self.side_config(iteration, rivals)
        train(run, self.policy(iteration).path, evaluations=0, progress=self.progress, resume=True)
        return len(rivals)

    def high(self, iteration: int) -> float:
        """Return what a policy earns from the rivals of its training, by their weights."""
        met = shares(self.rivals(iteration))
        return (
            self.meta_game(iteration + 1, iteration + 1)
            .interval(str(self.policy(iteration).agent), met)
            .value
        )


class _Nash(_DoubleOracle):
    """A double oracle in which each side answers the other's mixture in the equilibrium."""

    def rivals(self, iteration: int) -> list[str]:
        """Return the rivals in the equilibrium of all policies so far, in parts of all."""
        if not iteration:
            return super().rivals(iteration)
        return _in_parts(self.meta_game(iteration, iteration).equilibrium().rivals)

    def answered(self, iteration: int) -> list[str]:
        """Return the policies of the side in the equilibrium, in parts of all."""
        return _in_parts(self.meta_game(iteration + 1, iteration).equilibrium().players)


_SOLVED_BY = {"weights": _DoubleOracle, "nash": _Nash}


def _in_parts(mixture: Mapping[str, float]) -> list[str]:
    """Return a list that names each player by its share, in parts of all: those with the largest rest first.

    >>> _in_parts({"tone": 0.4951, "comb": 0.5, "sweep": 0.0049}).count("tone")
    50
    """
    parts = {name: int(PARTS * share) for name, share in mixture.items()}
    by_rest = sorted(mixture, key=lambda name: parts[name] - PARTS * mixture[name])
    for name in by_rest[: PARTS - sum(parts.values())]:
        parts[name] += 1
    return [name for name, count in parts.items() for _ in range(count)]
