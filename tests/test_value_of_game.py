"""The bracket of the game's value: which policies and searches count, and what stands on the page."""

import json

import pytest
import value_of_game
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile
from fpg_bench.products.league.config import META_SOLVERS, SelfPlayConfig
from tests.programs import ROOT


def row(iteration, low, high, confirmed=None, seed=0, **changes):
    """An iteration of a search."""
    settings = {"search": "brave", "scenario": "standard", "side": "ally"}
    settings |= {"verb": "double-oracle", "meta_solver": "weights"}
    settings |= {"actions": "uniform-hop", "seed": seed, "steps": 1000, "response_steps": 2000}
    found = {"iteration": iteration, "low": low, "high": high, "meta_value": 0.0, "seconds": 90.0}
    return settings | found | {"confirmed": confirmed} | changes


SEARCH = [row(0, 1.0, 6.0), row(1, 2.0, 5.0, 1.5), row(2, 1.9, 5.5, 1.8)]


@pytest.fixture
def board(tmp_path):
    """A board with two allies and responses to them."""

    def enter(slug, rewards, **about):
        folder = tmp_path / "board/submissions/ally" / slug
        folder.mkdir(parents=True)
        (folder / "submission.yaml").write_text(yaml.safe_dump({"track": "ally", **about}))
        return [
            {"track": "ally", "slug": slug, "response": name, "key": f"{slug}{name}", "rewards": returns}
            | {"half": [0.1] * len(returns), "lost": [0, 0]}
            for name, returns in rewards.items()
        ]

    rows = enter("brave", {"recipe-0": [1.2, 9.0]}, training={"seeds": [0, 1]})
    rows += enter("still", {"recipe-0": [-2.0], "recipe-1": [-3.0], "mine": [-1.0]}, scenario="link")
    file = tmp_path / "board/results/exploited.jsonl"
    file.parent.mkdir()
    file.write_text("".join(json.dumps(each) + "\n" for each in rows))
    return tmp_path / "board"


def test_a_policy_keeps_its_lowest_return_and_counts_only_with_a_response_of_its_own(board):
    kept = list(value_of_game.kept_by_policies(SEARCH, board))
    assert [(each.scenario, str(each)) for each in kept] == [
        ("standard", "1.50 (`brave`, seed 0, iteration 1, 2 responses of 2,000 steps)"),
        ("standard", "1.20 (`brave`, seed 0, iteration 2, 3 responses of 2,000 steps)"),
        ("link", "-3.00 (`still`, 3 responses of 1,500,000 steps)"),
    ]


def test_the_bracket_is_the_best_of_either_side_and_tells_who_may_only_hop_evenly(board):
    rows = [*SEARCH, row(0, 0.0, 7.5, search="free", actions="discrete-uniform", meta_solver="nash")]
    _, standard, link = value_of_game.bracket(rows, [*value_of_game.kept_by_policies(rows, board)])
    assert [cell.partition(" (")[0] for cell in standard] == ["`standard`", "1.50", "5.00", "7.50"]
    assert standard[2] == "5.00 (`brave`, seed 0, iteration 1, 2,000 steps)"
    assert [cell.partition(" (")[0] for cell in link] == ["`link`", "-3.00", "-", "-"]


def test_the_figure_has_a_line_for_each_kind_of_search():
    assert tuple(value_of_game.DASHES) == (*META_SOLVERS, SelfPlayConfig.verb)


def test_the_script_keeps_a_finished_search_and_writes_page_and_picture(board, tmp_path, monkeypatch):
    page, search = tmp_path / "value.md", tmp_path / "search"
    page.write_text("before\n<!-- value -->\nold\n<!-- end -->\nafter\n")
    search.mkdir()
    about = {
        "game": {"id": "FPG/AllyVsPolicy-v0", "scenario": "link", "actions": "uniform-hop"},
        "verb": "self-play",
        "seed": 4,
        "steps": 10,
        "response_steps": 20,
        "rows": [{"iteration": 0, "low": 3.0, "high": 4.0, "meta_value": 3.0, "rivals": 2, "seconds": 1.0}],
        "confirmed": {"0": 2.5},
    }
    (search / "search.json").write_text(json.dumps(about))
    words = [page, "--board", board, "--agents", tmp_path / "none", "--search", f"bold={search}"]
    monkeypatch.setattr("sys.argv", ["value_of_game", *map(str, words)])
    value_of_game.main()
    value_of_game.main()
    (kept,) = RowFile(tmp_path / "searches.jsonl").read()
    assert (kept["search"], kept["scenario"], kept["seed"], kept["confirmed"]) == ("bold", "link", 4, 2.5)
    text = page.read_text()
    assert text.startswith("before\n<!-- value -->\n\n| scenario |")
    assert text.endswith("<!-- end -->\nafter\n")
    assert "2.50 (`bold`, seed 4, iteration 0, 2 responses of 20 steps)" in text
    assert "](value.svg)" in text
    assert "prefers-color-scheme: dark" in (tmp_path / "value.svg").read_text()
    (search / "search.json").write_text("{}")
    with pytest.raises(UserError, match="the search is not finished"):
        value_of_game.main()


def test_the_committed_page_is_what_the_committed_rows_give(tmp_path):
    page = ROOT / "docs/results/value.md"
    rows = value_of_game.read_searches(ROOT / "baselines/agents", page)
    lines = value_of_game.bracket(rows, [*value_of_game.kept_by_policies(rows, ROOT / "leaderboard")])
    assert value_of_game.markdown_table(lines) in page.read_text()
