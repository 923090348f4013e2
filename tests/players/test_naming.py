"""One grammar names every player."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.game.scenario import PAPER, STANDARD
from fpg_bench.players.registry import as_player, player_name
from fpg_bench.players.scripted import OracleAlly, OracleOpponent, Scripted


class Mine:
    """A player of one's own, made for a scenario."""

    def __init__(self, scenario=None):
        self.scenario = scenario

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation), 9), np.float32), None


def made(scenario):
    return Mine(scenario)


READY = Mine("ready")


def test_scripts_and_oracles_are_told_their_side():
    for side, oracle in (("ally", OracleAlly), ("opponent", OracleOpponent)):
        script = as_player("random", side, STANDARD)
        assert isinstance(script, Scripted)
        assert script.side == side
        assert isinstance(as_player("oracle", side, STANDARD), oracle)


def test_an_object_with_predict_is_taken_as_it_is():
    assert as_player(READY, "ally", STANDARD) is READY


@pytest.mark.parametrize(("name", "scenario"), [("READY", "ready"), ("Mine", PAPER), ("made", PAPER)])
def test_an_object_class_or_function_of_a_module(name, scenario):
    assert as_player(f"{__name__}:{name}", "ally", PAPER).scenario == scenario


def test_a_player_is_called_by_its_word_or_its_class():
    assert player_name("expert") == "expert"
    assert player_name(READY) == "Mine"
