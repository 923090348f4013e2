import json
import math

import pytest

from fpg_bench.cli.leaderboard import build
from fpg_bench.errors import UserError
from fpg_bench.leaderboard.board import make_board
from fpg_bench.leaderboard.crossplay import play_missing
from fpg_bench.leaderboard.site.build import build_site
from fpg_bench.leaderboard.verify import verify
from tests.leaderboard.entering import enter


def quiet(line):
    pass


@pytest.fixture
def entered(board, in_process):
    enter(board, "ally", "wise", script="expert", name="<b>Wise</b>")
    enter(board, "ally", "still", script="idle")
    enter(board, "ally", "linear", seeds=(0, 10, 2))
    enter(board, "ally", "few", seeds=(0,), algorithm="few")
    enter(board, "opponent", "near", script="adaptive")
    enter(board, "opponent", "far", script="tone", path="learned")
    assert all(verdict.good for verdict in verify(board, say=quiet))
    return board


def table(board, key):
    (found,) = (track for track in make_board(board)["tracks"] if track["key"] == key)
    return found


def numbers(value):
    if isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from numbers(item)
    elif isinstance(value, float):
        yield value


def test_the_board_is_strict_json(entered):
    play_missing(entered, say=quiet)
    board = make_board(entered)
    assert json.loads(json.dumps(board, allow_nan=False)) == board
    assert all(map(math.isfinite, numbers(board)))


def test_rows_are_ranked_and_marked(entered):
    ally = table(entered, "ally")
    rows = {row["slug"]: row for row in ally["rows"]}
    assert [row["score"]["value"] for row in ally["rows"]] == sorted(
        (row["score"]["value"] for row in ally["rows"]), reverse=True
    )
    wise = rows["wise"]
    assert wise["name"] == "<b>Wise</b>"
    assert (wise["kind"], wise["training"], wise["training_seeds"]) == ("script", None, 0)
    assert wise["score"]["value"] == pytest.approx(100)
    assert list(wise["entries"]) == ally["entries"]
    assert wise["worst"]["value"] == min(entry["value"] for entry in wise["entries"].values())
    assert wise["measures"]["return"] == wise["measures"]["ally_return"]
    assert sum(wise["histograms"]["jam"]) == pytest.approx(1, abs=1e-4)
    assert not wise["few_seeds"]
    assert rows["few"]["few_seeds"]
    assert (rows["linear"]["kind"], rows["linear"]["few_seeds"]) == ("submitted", False)
    assert sum(row["lead"] for row in ally["rows"]) == pytest.approx(1, abs=1e-4)
    assert all(1 <= row["rank"][0] <= row["rank"][1] <= 4 for row in ally["rows"])


def test_every_seed_has_its_own_score(entered):
    ally = table(entered, "ally")
    rows = {row["slug"]: row for row in ally["rows"]}
    seeds = rows["linear"]["seeds"]
    assert set(seeds) == {"0", "10", "2"}
    assert sum(seeds.values()) / 3 == pytest.approx(rows["linear"]["score"]["value"], rel=1e-4)
    assert seeds["0"] == pytest.approx(rows["few"]["score"]["value"])
    assert rows["wise"]["seeds"] == {}


def test_pairs_and_profiles_speak_of_all_who_are_ranked(entered):
    ally = table(entered, "ally")
    names = ally["improvement"]["names"]
    assert names == [row["slug"] for row in ally["rows"]]
    value = ally["improvement"]["value"]
    assert value[0][0] is None
    assert value[0][1] + value[1][0] == pytest.approx(1)
    assert set(ally["profiles"]["share"]) == set(names)
    assert all(len(s) == len(ally["profiles"]["thresholds"]) for s in ally["profiles"]["share"].values())


def test_the_opponents_tables_are_apart(entered):
    assert [row["slug"] for row in table(entered, "opponent-pursuit")["rows"]] == ["near"]
    assert [row["slug"] for row in table(entered, "opponent-learned")["rows"]] == ["far"]


def test_what_does_not_count_is_shown_last_with_its_reason(entered, in_process):
    path = entered / "results/ally/wise.jsonl"
    path.write_text(path.read_text().replace('"value":100.0', '"value":150.0', 1))
    enter(entered, "ally", "slow", seeds=(7,))
    in_process.fails = True
    verify(entered, ["ally/slow"], say=quiet)
    rows = table(entered, "ally")["rows"]
    assert [row["slug"] for row in rows[-2:]] == ["slow", "wise"]
    assert [row["status"] for row in rows[-2:]] == ["not verified"] * 2
    assert [row["score"] for row in rows[-2:]] == [None, None]
    assert rows[-2]["reason"] == "seed_7: took longer than it may"
    assert "edited by hand" in rows[-1]["reason"]
    assert len(table(entered, "ally")["improvement"]["names"]) == 3


def test_what_has_no_result_is_left_out(entered):
    enter(entered, "ally", "new", script="reactive")
    assert "new" not in [row["slug"] for row in table(entered, "ally")["rows"]]


def test_who_is_left_out_or_not_verified_is_said_with_the_reason(entered, in_process):
    torn, new = (
        enter(entered, "ally", "torn", script="exprt"),
        enter(entered, "ally", "new", script="reactive"),
    )
    (entered / "results/ally/torn.jsonl").write_text("")
    enter(entered, "ally", "slow", seeds=(7,))
    in_process.fails = True
    verify(entered, ["ally/slow"], say=quiet)
    wise = entered / "submissions/ally/wise/submission.yaml"
    wise.write_text(wise.read_text().replace("much", "little"))
    (entered / "submissions" / "planers").mkdir()
    said = []
    make_board(entered, said.append)
    assert said == [
        "submissions/planers: left out: is no track; did you mean 'planner'?",
        f"ally/new: left out: has no result; make it: fpg-bench submit run {new}",
        "ally/slow: not verified: seed_7: took longer than it may",
        f"ally/torn: left out: submission {torn}: submission.yaml: script: unknown 'exprt'; "
        "did you mean 'expert'?",
        "ally/wise: not verified: submission.yaml or a policy changed since this result was made; "
        f"make it again: fpg-bench submit run --update {wise.parent}",
    ]


def test_crossplay_shows_who_has_played_everybody_and_names_the_others(entered, tmp_path):
    assert make_board(entered)["crossplay"] is None
    play_missing(entered, say=quiet)
    found = make_board(entered)["crossplay"]
    assert found["allies"] == ["few", "linear", "still", "wise"]
    assert found["opponents"] == ["far", "near"]
    assert [len(row) for row in found["jamming_success_rate"]] == [2] * 4
    assert sum(found["nash"]["ally"].values()) == pytest.approx(1, abs=1e-4)
    assert 0 <= found["nash"]["value"] <= 1
    assert found["missing"] == {"ally": [], "opponent": []}
    enter(entered, "ally", "new", script="reactive", name="Brand New")
    verify(entered, ["ally/new"], say=quiet)
    board = make_board(entered)
    assert board["crossplay"] == found | {"missing": {"ally": ["new"], "opponent": []}}
    build_site(board, tmp_path / "site")
    page = (tmp_path / "site/crossplay.html").read_text()
    assert "Not in it yet: Brand New." in page
    assert "fpg-bench submit crossplay" in page


def test_best_response_is_shown_where_it_was_measured(entered):
    rows = [
        {"track": "ally", "slug": "wise", "scores": [1]},
        {"track": "ally", "slug": "wise", "scores": [3, 2.5, 4]},
        {"track": "opponent", "slug": "still", "scores": [9]},
    ]
    file = entered / "results/exploit.jsonl"
    file.write_text("".join(json.dumps(row) + "\n" for row in rows))
    found = {row["slug"]: row["best_response"] for row in table(entered, "ally")["rows"]}
    assert found == {
        "wise": {"value": 2.5, "low": 2.5, "high": 4},
        "still": None,
        "linear": None,
        "few": None,
    }
    file.write_text('{"track": "ally"}\n')
    with pytest.raises(UserError, match=r"exploit.jsonl: line 1 lacks"):
        make_board(entered)


def test_an_empty_board_is_a_board(board):
    found = make_board(board)
    assert not [row for track in found["tracks"] for row in track["rows"]]
    assert found["crossplay"] is None


def test_the_verb_says_who_is_left_out_and_keeps_rounds_that_it_does_not_simulate(board, tmp_path, capsys):
    enter(board, "ally", "wise", script="expert")
    verify(board, say=quiet)
    enter(board, "ally", "still", script="idle")
    site = tmp_path / "site"
    build(site, board)
    first, told = capsys.readouterr().out.splitlines()
    assert first.startswith("ally/still: left out: has no result")
    assert told.startswith("1 entries, 1 rounds to watch")
    rounds = sorted(site.glob("replays/ally/wise/*.js"))
    assert len(rounds) == 1
    verify(board, say=quiet)
    build(site, board, replays=False)
    assert capsys.readouterr().out.startswith("2 entries, 1 rounds to watch")
    assert sorted(site.glob("replays/*/*/*.js")) == rounds
    assert rounds[0].name in (site / "entries/ally/wise.html").read_text()
