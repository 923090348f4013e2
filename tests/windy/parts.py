"""All that the product offers."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from stable_baselines3 import PPO

from fpg_bench.common.ids import EnvConfig
from fpg_bench.envs.core import SingleAgentGame
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.rounds import MatchBatch, make_match, play_round
from fpg_bench.game.scenario import Scenario, preset
from fpg_bench.game.spec import OtherGame
from fpg_bench.players.registry import as_player

ID = "Windy/loud_v0"


def shout(word: str = "loud") -> None:
    """Print a word in capitals."""
    print(word.upper())


class Shy:
    """An ally that hops and spreads in every step."""

    def __init__(self, side: str, name: str, scenario: Scenario) -> None:
        self.name = name

    def predict(self, observation: Any, state: Any = None, *rest: Any, **more: Any) -> tuple[Any, Any]:
        """Return the same action for each game."""
        return np.ones((len(observation), 9), np.float32), state


class LoudPPO(PPO):
    """PPO by another name."""


@dataclasses.dataclass(frozen=True)
class LoudGame(OtherGame):
    """A duel whose jammer sends with more power.

    Attributes:
        gain_db: how much louder the jammer is. In dB.
    """

    id: str = ID
    gain_db: int = 0

    suite = "windy-loud-v1"

    @property
    def config(self) -> EnvConfig:
        """The ally plays against the adaptive jammer."""
        return EnvConfig(ID, "ally", "adaptive", scripted=False)

    def louder(self, scenario: Scenario) -> Scenario:
        """Return a scenario with the louder jammer."""
        power = scenario.opponent_power_dbm + self.gain_db
        return dataclasses.replace(scenario, opponent_power_dbm=power)

    def resolve(self) -> Scenario:
        """Return the scenario that is played."""
        return self.louder(super().resolve())


class _Loud:
    """Maker of the games."""

    spec = LoudGame

    def make_core(self, game: LoudGame, n_envs: int) -> SingleAgentGame:
        return SingleAgentGame(game, n_envs)

    def make_player(self, spec: Any, side: str, scenario: Scenario, game: LoudGame) -> Any:
        return as_player(spec, side, scenario)

    def make_match(self, player: Any, suite: Any, rival: Any, count: int) -> MatchBatch:
        scenario = suite.game.louder(rival.scenario)
        return make_match(TwoPlayerBatch(scenario, count), player, rival.players)

    def watch(self, ally: Any, opponent: Any, out: Any, *, game: LoudGame, seed: int, **more: Any) -> Any:
        duel = TwoPlayerBatch(game.louder(preset("standard")), 1)
        play_round(make_match(duel, ally, opponent), seeds=seed)
        print("a loud round:", duel.measures(0)["ally_return"])
        return duel.measures(0)


LOUD = _Loud()
