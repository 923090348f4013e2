"""Scripts of teams: same bits in any batch, seats that share the band, bounds, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import as_scenario
from fpg_bench.products.teams.core import make_team
from fpg_bench.products.teams.match import play_teams
from fpg_bench.products.teams.rules import TEAM_SCRIPTS, TeamRules
from fpg_bench.products.teams.scripts import BOUNDS, as_team_player

SHORT = as_scenario("link", steps_per_round=20)
TEAM = TeamRules()
EVERY = [
    *(("ally", name, "assign") for name in (*TEAM_SCRIPTS["ally"], *BOUNDS)),
    *(("opponent", name, "listen") for name in TEAM_SCRIPTS["opponent"]),
]


def rewards(side, name, rival, matches):
    players = (name, rival) if side == "ally" else (rival, name)
    return play_teams(*([one] for one in players), SHORT, TEAM, matches)


@pytest.mark.parametrize(("side", "name", "rival"), EVERY)
def test_a_script_plays_alike_in_any_batch(side, name, rival):
    few, many = rewards(side, name, rival, 2), rewards(side, name, rival, 5)
    assert np.array_equal(few, many[:2])
    assert len(np.unique(many)) == 5


def opening(side, name, **options):
    """The batch after a step of a script against players that do nothing."""
    other = "opponent" if side == "ally" else "ally"
    team = make_team(4, scenario=SHORT, side=other, against=name, **options)
    team.reset(seeds=0)
    idle = np.zeros((4, team.seats[other], 9))
    team.step(*((None, idle) if side == "ally" else (idle, None)))
    return team.batch


def test_conventions_of_allies_need_no_word():
    assert (opening("ally", "allotment").allies["point"] == [2, 7, 12]).all()
    together = opening("ally", "cdma").allies
    assert together["spreading"].all()
    assert (together["point"] == 7).all()
    own = opening("ally", "greedy-own-points").allies
    assert ((own["point"] % 3 == [0, 1, 2]) | own["spreading"]).all()


def test_jammers_divide_the_band():
    split = opening("opponent", "split-band").opponents
    middle = (SHORT.band_low_mhz + SHORT.band_high_mhz) / 2
    assert (split["jamming_mhz"][:, 0] < middle).all()
    assert (split["jamming_mhz"][:, 1] > middle).all()
    herd = opening("opponent", "herd-pair").opponents["jamming_type"]
    assert (herd == [2, 1]).all()


def test_a_script_of_teams_is_refused_in_a_duel():
    with pytest.raises(UserError, match="greedy: plays a seat of a team, which observes 67 numbers"):
        as_team_player("greedy", "ally", SHORT, TEAM).predict(np.zeros((2, 15), np.float32))
