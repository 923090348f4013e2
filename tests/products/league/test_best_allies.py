"""Worth of hopping: players that hop against players that do not."""

from dataclasses import replace

import numpy as np
import pytest

from fpg_bench.game.scenario import preset
from fpg_bench.products.league import best_allies as module
from fpg_bench.products.league.best_allies import Best, best_allies, show_worth_of_hopping, worth_of_hopping


@pytest.mark.slow
@pytest.mark.parametrize(("lost_s", "looks", "pays"), [(0.02, (3, 5), True), (0.5, (1, 1), False)])
def test_hopping_pays_where_it_is_quick_and_the_jammer_looks_seldom(monkeypatch, lost_s, looks, pays):
    for name, few in {"GENERATIONS": 3, "TRIED": 4, "MEASURED": 12}.items():
        monkeypatch.setattr(module, name, few)
    radio = replace(preset("link"), hop_airtime_s=lost_s, first_check_s=(1, looks[1]), check_interval_s=looks)
    best = best_allies(radio, ["narrowband", "hunter"])
    more = worth_of_hopping(best)
    assert {each.does for each in best} == {"hops", "hops and spreads", "spreads", "stays"}
    assert (more.low > 0) == pays
    assert (more.high < 0) != pays


@pytest.mark.parametrize(
    ("hops", "answer"),
    [
        (1, "Hopping pays: +1.00 [+1.00, +1.00]"),
        (-1, "Hopping does not pay: -1.00 [-1.00, -1.00]"),
        (np.array([1, -1, 2, -2]), "Hopping makes no difference: +0.00 [-2.91, +2.91]"),
    ],
)
def test_the_answer_is_a_sentence_with_an_interval_paired_round_by_round(monkeypatch, capsys, hops, answer):
    luck = np.array([0.0, 5.0, -5.0, 9.0])
    best = [Best("hops and spreads", "a", luck + hops), Best("stays", "b", luck), Best("hops", "c", luck - 9)]
    monkeypatch.setattr(module, "best_allies", lambda scenario: best)
    show_worth_of_hopping(preset("link"), as_json=False)
    assert answer in capsys.readouterr().out
