"""The measured pay-offs of teams: rows that are kept, bounds that stay out, and marks of pages."""

from __future__ import annotations

import measure_team_payoffs
import numpy as np
import pytest
from measure_team_payoffs import Results, payoff_table, without_bounds
from train_teams import Teams

from fpg_bench.game.actions import SPREAD_GATE
from fpg_bench.products.league.payoffs import Payoffs

JAMMERS = {"tone": "tone"}


def test_pairs_are_played_once_and_kept(tmp_path, monkeypatch):
    results = Results(tmp_path / "rows.jsonl", 2)
    first = results.payoffs("3 v 1", {"all spread": "cdma"}, JAMMERS)
    assert first.samples[0].shape == (1, 2, 1)
    monkeypatch.delattr(measure_team_payoffs, "play_teams")
    again = Results(tmp_path / "rows.jsonl", 2)
    assert np.array_equal(again.payoffs("3 v 1", {"all spread": "cdma"}, JAMMERS).values, first.values)
    text = again.csv({"cdma": "all spread", "tone": "tone"})
    assert text.startswith("game,ally,opponent,reward,half,clashes,spreading,heard\n3 v 1,all spread,tone,")
    with pytest.raises(NameError):  # other matches are others
        Results(tmp_path / "rows.jsonl", 3).of("3 v 1", "cdma", "tone")


def test_bounds_are_shown_and_stay_out_of_the_equilibrium():
    samples = tuple(np.array([[[reward, 1.0], [reward, 3.0]]]) for reward in (4.0, 6.0, 9.0))
    payoffs = Payoffs(("greedy", "cdma", "genie"), ("tone", "combs"), samples)
    assert "| genie (full state) | 9.00 | 2.00 | 2.00 | 5.50 |" in payoff_table(payoffs)
    assert without_bounds(payoffs).players == ("greedy", "cdma")


def test_a_team_plays_with_one_of_its_choices_frozen(tmp_path):
    teams = Teams(tmp_path, 1, 2)
    free = teams.rewards("cdma", "tone")
    frozen = teams.rewards("cdma", "tone", "spreading: never", {SPREAD_GATE: -1.0})
    assert free.shape == (2,)
    assert (frozen < free - 1).all()  # all unspread on one point
