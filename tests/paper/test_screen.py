"""The scripted screen: its rows, games and page."""

import json

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.envs.core import JointGame
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.paper.claims import ASPECTS
from fpg_bench.players.registry import as_player
from scripts.interpretations import screen as screening
from scripts.interpretations.interpretations import all_interpretations, parse_interpretation
from scripts.interpretations.screen import (
    claims_of,
    draw_curve,
    effects,
    make_screen,
    play_pair,
    read_screen,
    screen,
    screen_all,
    shares,
    write_screen,
)

pytestmark = pytest.mark.slow

AS_PRINTED, FREE_HOPS = (
    parse_interpretation("as-printed"),
    parse_interpretation("interference=once,hops=always,hop-cost=0"),
)


@pytest.fixture(scope="module")
def rows():
    return [screen(interpretation, 8) for interpretation in (AS_PRINTED, FREE_HOPS)]


def mean_of(row, statement):
    (mean,) = [part["mean"] for part in row["parts"] if part["statement"] == statement]
    return mean


def test_a_row_has_all_parts_of_all_claims(rows):
    for row in rows:
        assert {part["claim"] for part in row["parts"]} == set(ASPECTS)
        assert len(row["parts"]) == 3 + 2 + 9 + 2
        for part in row["parts"]:
            assert part["low"] <= part["mean"] <= part["high"]
            assert 0 <= part["p"] <= 1


def test_broadband_is_weakest_as_printed_and_strongest_where_interference_counts_once(rows):
    printed, free = (mean_of(row, "opponent's reward: broadband - tone") for row in rows)
    assert printed < 0 < free


def test_the_same_interpretation_gives_the_same_row(rows):
    assert screen(AS_PRINTED, 8) == rows[0]


def test_an_ally_that_always_hops_pays_in_every_step():
    paid = parse_interpretation("interference=once,hops=always")
    gated, always = (
        play_pair(interpretation, "idle", "tone", 4, path="circle") for interpretation in (AS_PRINTED, paid)
    )
    assert (gated.ally - always.ally).min() > 50  # H = 100
    assert always.hops.min() == 1
    assert gated.overlap.mean() > always.overlap.mean()


def test_the_hop_cost_changes_only_the_rewards():
    dear, cheap = (parse_interpretation(f"interference=once,hop-cost={cost}") for cost in ("100", "40"))
    paid, saved = (
        play_pair(interpretation, "expert", "narrowband", 4, path="circle")
        for interpretation in (dear, cheap)
    )
    assert saved.ally - paid.ally == pytest.approx(60 * paid.hops)
    assert paid.hops.any()
    core = JointGame(4, scenario=cheap.scenario(), path="circle")
    players = [
        as_player(*pair, cheap.scenario()) for pair in (("expert", "ally"), ("narrowband", "opponent"))
    ]
    core.reset(seeds=np.array(evaluation_seeds(4)))
    screening._play_round(core, players, 4)
    assert core.duel.batch.tallies["ally_return"] / 100 == pytest.approx(saved.ally[0])


def test_the_rounds_of_a_match_are_the_first_ones_of_a_longer_match():
    core = JointGame(3, scenario=AS_PRINTED.scenario(), planner="interceptor")
    players = [
        as_player(*pair, AS_PRINTED.scenario()) for pair in (("expert", "ally"), ("adaptive", "opponent"))
    ]
    core.reset(seeds=np.array(evaluation_seeds(3)))
    long = play_pair(AS_PRINTED, "expert", "adaptive", 3, 40, planner="interceptor").first(AS_PRINTED.rounds)
    assert len(long.opponent) == AS_PRINTED.rounds == 10
    for number in range(AS_PRINTED.rounds):
        if number:
            core.reset(np.ones(3, bool))
        screening._play_round(core, players, 3)
        assert core.duel.batch.tallies["opponent_return"] / 100 == pytest.approx(long.opponent[number])


def test_only_missing_rows_are_played(monkeypatch, tmp_path):
    file, interpretations = tmp_path / "screen.jsonl", list(all_interpretations(["interference"]))
    first = screen_all(interpretations[:1], file, 4)
    both = screen_all(interpretations, file, 4)
    assert both[0] == json.loads(json.dumps(first[0]))
    monkeypatch.setattr(screening, "screen", None)
    assert screen_all(reversed(interpretations), file, 4) == both[::-1]
    file.write_text('{"interpretation": "as-printed"}\n')
    with pytest.raises(UserError, match="line 1: games is missing"):
        screen_all(interpretations, file, 4)


def test_a_claim_holds_if_all_its_parts_do(rows):
    for claim in claims_of(rows):
        for effect in effects(rows, claim):
            (row,) = [row for row in rows if row["interpretation"] == effect.interpretation.name]
            parts = [part for part in row["parts"] if part["claim"] == claim]
            assert effect.holds == all(part["mean"] > 0 and part["p"] < 0.05 for part in parts)
            assert effect.n_reversed == sum(part["high"] < 0 for part in parts)
    assert shares(effects(rows, "D3 order"))["interference", "twice"] == 0


def test_the_curve_has_a_panel_per_claim_and_a_row_per_setting(rows):
    figure = draw_curve(rows)
    titles = [axes.get_title() for axes in figure.axes]
    assert [title.split(":")[0] for title in titles if title] == claims_of(rows)
    labels = [label.get_text() for label in figure.axes[len(claims_of(rows))].get_yticklabels()]
    assert "interference: once" in labels
    assert len(labels) == 19


def test_the_page_shows_the_effect_of_each_point(monkeypatch, tmp_path):
    written = make_screen(tmp_path, 12, ["interference", "hop-cost"])
    assert all(path.stat().st_size > 500 for path in written)
    page = (tmp_path / "screen.md").read_text()
    assert "6 interpretations of the paper were played" in page
    assert "| interference | `once` |" in page
    assert (tmp_path / "figures" / "screen.png").is_file()
    rows = read_screen(tmp_path)
    assert [row["interpretation"] for row in rows] == [
        interpretation.name for interpretation in all_interpretations(["interference", "hop-cost"])
    ]
    monkeypatch.setattr(screening, "save_figure", lambda *_: [])  # drawn once
    write_screen(rows, tmp_path / "again")
    assert (tmp_path / "again" / "screen.md").read_text() == page
