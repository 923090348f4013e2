"""The offers of the players of theory, each made of side, name and scenario."""

from __future__ import annotations

from fpg_bench.game.scenario import Scenario
from fpg_bench.players.player import Player
from fpg_bench.products.theory.bayes import BayesJammer, OracleLinkAlly
from fpg_bench.products.theory.belief import BeliefAlly
from fpg_bench.products.theory.learners import Learner


def bayes(side: str, name: str, scenario: Scenario) -> Player:
    """Make the Bayes jammer."""
    return BayesJammer(scenario)


def belief(side: str, name: str, scenario: Scenario) -> Player:
    """Make the ally that plans by a belief."""
    return BeliefAlly(scenario)


def learner(side: str, name: str, scenario: Scenario) -> Player:
    """Make an ally that learns within a round."""
    return Learner(name, scenario)


def oracle(side: str, name: str, scenario: Scenario) -> Player:
    """Make the oracle of a side in the model ``link``."""
    return OracleLinkAlly(scenario) if side == "ally" else BayesJammer(scenario, is_oracle=True)
