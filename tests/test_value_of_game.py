"""The bracket of the game's value: which policies and searches count, and what stands on the page."""

import json
from types import SimpleNamespace

import pytest
import value_of_game

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.products.leaderboard.exploited import RESPONSE, Attack, Exploited
from fpg_bench.products.league.config import META_SOLVERS


def row(iteration, low, high, confirmed=None, seed=0, **changes):
    """An iteration of a search."""
    settings = {"search": "brave", "scenario": "standard", "side": "ally"}
    settings |= {"verb": "double-oracle", "meta_solver": "weights"}
    settings |= {"actions": "uniform-hop", "seed": seed, "steps": 1000, "response_steps": 2000}
    found = {"iteration": iteration, "low": low, "high": high, "meta_value": 0.0, "seconds": 90.0}
    return settings | found | {"confirmed": confirmed} | changes


SEARCH = [row(0, 1.0, 6.0), row(1, 2.0, 5.0, 1.5), row(2, 1.9, 5.5, 1.8)]


def attack(value, **changes):
    """The attack that holds the lowest known return of an ally."""
    return Attack("breaker-1", RESPONSE, Interval(value), 0, "Breaker", ("Me",), 1200.0, **changes)


def track(key, entries):
    """A track as the page reads it: what its entries keep, and whether anybody answered them."""
    verified = [
        (SimpleNamespace(plays=None, slug=slug), SimpleNamespace(exploited=Exploited(of, (of,) * answered)))
        for slug, (of, answered) in entries.items()
    ]
    return SimpleNamespace(key=key, verified=lambda: verified)


BOARD = SimpleNamespace(
    tracks=[
        track("ally", {"brave": (attack(1.5), 1), "still": (attack(-3.0), 2), "unmet": (attack(7.0), 0)}),
        track("opponent-pursuit", {"tone": (attack(20.0), 0)}),
        track("ally-link", {"still": (attack(-3.0), 1)}),
    ]
)


def test_the_bracket_is_the_best_of_either_side_and_tells_who_may_only_hop_evenly():
    kept = value_of_game.kept_by_entries(BOARD)
    assert {scenario: name for scenario, (name, _) in kept.items()} == {"standard": "brave", "link": "still"}
    rows = [*SEARCH, row(0, 0.0, 7.5, search="free", actions="discrete-uniform", meta_solver="nash")]
    _, standard, link = value_of_game.bracket(rows, kept)
    assert [cell.partition(" (")[0] for cell in standard] == ["`standard`", "1.50", "5.00", "7.50"]
    assert standard[1] == "1.50 (`brave`, found by: Breaker, 1,200 CPU s)"
    assert standard[2] == "5.00 (`brave`, seed 0, iteration 1, 2,000 steps)"
    assert [cell.partition(" (")[0] for cell in link] == ["`link`", "-3.00", "-", "-"]


def test_the_figure_has_a_line_for_each_kind_of_search():
    assert tuple(value_of_game.DASHES) == (*META_SOLVERS, "self-play")


def test_the_script_keeps_a_finished_search_and_writes_page_and_picture(tmp_path, monkeypatch):
    page, search = tmp_path / "value.md", tmp_path / "search"
    page.write_text("before\n<!-- value -->\nold\n<!-- end -->\nafter\n")
    search.mkdir()
    about = {
        "game": {"id": "FPG/AllyVsPolicy-v0", "scenario": "link", "actions": "uniform-hop"},
        "verb": "double-oracle",
        "meta_solver": "nash",
        "seed": 4,
        "steps": 10,
        "response_steps": 20,
        "rows": [{"iteration": 0, "low": 3.0, "high": 4.0, "meta_value": 3.0, "rivals": 2, "seconds": 1.0}],
        "confirmed": {"0": 2.5},
    }
    (search / "search.json").write_text(json.dumps(about))
    words = page, [f"bold={search}"], tmp_path / "none"
    monkeypatch.setattr(value_of_game, "load_entries", lambda board: board)
    monkeypatch.setattr(value_of_game, "make_board", lambda board: BOARD)
    value_of_game.main(*words)
    value_of_game.main(*words)
    (kept,) = RowFile(tmp_path / "searches.jsonl").read()
    assert (kept["search"], kept["scenario"], kept["seed"], kept["confirmed"]) == ("bold", "link", 4, 2.5)
    text = page.read_text()
    assert text.startswith("before\n<!-- value -->\n\n| scenario |")
    assert text.endswith("<!-- end -->\nafter\n")
    assert "4.00 (`bold`, seed 4, iteration 0, 10 steps)" in text
    assert "](value.svg)" in text
    assert "prefers-color-scheme:dark" in (tmp_path / "value.svg").read_text()
    (search / "search.json").write_text("{}")
    with pytest.raises(UserError, match="the search is not finished"):
        value_of_game.main(*words)
