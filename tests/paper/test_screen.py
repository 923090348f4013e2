"""Interpretations of the paper, and the scripted screen: its rows, games and page."""

import dataclasses
import json

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.envs.core import JointGame
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.game.scenario import PAPER
from fpg_bench.paper.claims import ASPECTS
from fpg_bench.players.registry import as_player
from scripts.interpretations import screen as screening
from scripts.interpretations.interpretations import (
    AS_PRINTED,
    POINTS,
    all_interpretations,
    parse_interpretation,
)
from scripts.interpretations.screen import (
    draw_curve,
    effects,
    make_screen,
    play_pair,
    play_round,
    read_screen,
    screen,
)

PRINTED = parse_interpretation(AS_PRINTED)
GAMES = 8


def test_as_printed_is_the_preset_paper_in_matches_of_ten_rounds():
    assert PRINTED.scenario() == dataclasses.replace(PAPER, rounds_per_match=10)


def test_every_setting_changes_the_scenario():
    for point, known in POINTS.items():
        for setting in list(known)[1:]:
            other = parse_interpretation(f"{point}={setting}")
            assert other.scenario() != PRINTED.scenario(), (point, setting)
            assert PRINTED.replace({point: setting}) == other


def test_names_of_interpretations_are_unique_and_can_be_parsed():
    interpretations = list(all_interpretations())
    names = [interpretation.name for interpretation in interpretations]
    assert len(set(names)) == len(names) == 768
    assert list(map(parse_interpretation, names)) == interpretations
    some = [interpretation.name for interpretation in all_interpretations(["k", "speed"])]
    assert some == ["as-printed", "speed=fixed", "k=power", "k=power,speed=fixed"]


@pytest.mark.parametrize("name", ["interferance=once", "interference=thrice"])
def test_unknown_points_and_settings_are_refused(name):
    with pytest.raises(ValueError, match=f"unknown point or setting: {name}"):
        parse_interpretation(name)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with the screen of six interpretations, which share two games."""
    folder = tmp_path_factory.mktemp("screen")
    make_screen(folder, GAMES, ["interference", "hop-cost"], n_jobs=1)
    return folder


@pytest.fixture(scope="module")
def rows(made):
    return read_screen(made)


@pytest.mark.slow
def test_a_row_has_all_parts_of_all_claims(rows):
    for row in rows:
        assert {part["claim"] for part in row["parts"]} == set(ASPECTS)
        assert len(row["parts"]) == 3 + 2 + 9 + 2
        for part in row["parts"]:
            assert part["low"] <= part["mean"] <= part["high"]
            assert 0 <= part["p"] <= 1


@pytest.mark.slow
def test_broadband_is_weakest_as_printed_and_stronger_where_interference_counts_once(rows):
    means = {
        row["interpretation"]: part["mean"]
        for row in rows
        for part in row["parts"]
        if part["statement"] == "opponent's reward: broadband - tone"
    }
    assert means["as-printed"] < 0 < means["interference=once,hop-cost=0"]


@pytest.mark.slow
def test_the_same_interpretation_gives_the_same_row(rows):
    screening._play_free.cache_clear()
    assert json.loads(json.dumps(screen(PRINTED, GAMES))) == rows[0]


@pytest.mark.slow
def test_an_ally_that_always_hops_pays_in_every_step():
    paid = parse_interpretation("interference=once,hops=always")
    gated, always = (
        play_pair(interpretation, "idle", "tone", 4, path="circle") for interpretation in (PRINTED, paid)
    )
    assert (gated["ally"] - always["ally"]).min() > 50  # H = 100
    assert always["hops"].min() == 1
    assert gated["overlap"].mean() > always["overlap"].mean()


def start(scenario, games, ally, opponent, **options):
    """Return new games on evaluation seeds, and their players."""
    core = JointGame(games, scenario=scenario, **options)
    core.reset(seeds=np.array(evaluation_seeds(games)))
    return core, [as_player(ally, "ally", scenario), as_player(opponent, "opponent", scenario)]


@pytest.mark.slow
def test_the_hop_cost_changes_only_the_rewards():
    dear, cheap = (parse_interpretation(f"interference=once,hop-cost={cost}") for cost in ("100", "40"))
    paid, saved = (play_pair(each, "expert", "narrowband", 4, path="circle") for each in (dear, cheap))
    assert saved["ally"] - paid["ally"] == pytest.approx(60 * paid["hops"])
    assert paid["hops"].any()
    core, players = start(cheap.scenario(), 4, "expert", "narrowband", path="circle")
    play_round(core, players)
    assert core.duel.batch.tallies["ally_return"] / 100 == pytest.approx(saved["ally"][0])


@pytest.mark.slow
def test_the_rounds_of_a_match_are_the_first_ones_of_a_longer_match():
    core, players = start(PRINTED.scenario(), 2, "expert", "adaptive", planner="interceptor")
    long = play_pair(PRINTED, "expert", "adaptive", 2, 12, planner="interceptor")
    for number in range(PRINTED.rounds):
        if number:
            core.reset(np.ones(2, bool))
        play_round(core, players)
        assert core.duel.batch.tallies["opponent_return"] / 100 == pytest.approx(long["opponent"][number])


@pytest.mark.slow
def test_only_missing_rows_are_played(monkeypatch, made, rows, tmp_path):
    stored = (made / "screen.jsonl").read_text().splitlines(keepends=True)
    file = tmp_path / "screen.jsonl"
    file.write_text("".join(stored[1:]))
    screened = []
    monkeypatch.setattr(
        screening, "screen", lambda each, games: screened.append(each) or json.loads(stored[0])
    )
    make_screen(tmp_path, GAMES, ["interference", "hop-cost"], n_jobs=1)
    assert [each.name for each in screened] == [json.loads(stored[0])["interpretation"]]
    assert read_screen(tmp_path) == rows
    file.write_text('{"interpretation": "as-printed"}\n')
    with pytest.raises(UserError, match="line 1: games is missing"):
        make_screen(tmp_path, GAMES, ["interference", "hop-cost"])


@pytest.mark.slow
def test_a_claim_holds_if_all_its_parts_do(rows):
    by_name = {row["interpretation"]: row for row in rows}
    for claim, each in effects(rows).items():
        assert [effect.size for effect in each] == sorted(effect.size for effect in each)
        for effect in each:
            row = by_name[effect.interpretation.name]
            parts = [part for part in row["parts"] if part["claim"] == claim]
            assert effect.holds == all(part["mean"] > 0 and part["p"] < 0.05 for part in parts)
            assert effect.is_reversed == any(part["high"] < 0 for part in parts)


@pytest.mark.slow
def test_the_page_and_the_curve_show_each_claim_and_each_point(made, rows):
    page = (made / "screen.md").read_text()
    assert "6 interpretations of the paper were played" in page
    assert "| interference | `once` |" in page
    assert (made / "figures" / "screen.png").stat().st_size > 500
    assert [row["interpretation"] for row in rows] == [
        interpretation.name for interpretation in all_interpretations(["interference", "hop-cost"])
    ]
    figure = draw_curve(effects(rows))
    titles = [axes.get_title() for axes in figure.axes]
    assert [title.split(":")[0] for title in titles if title] == sorted(ASPECTS)
    labels = [label.get_text() for label in figure.axes[len(ASPECTS)].get_yticklabels()]
    assert "interference: once" in labels
    assert len(labels) == 19
