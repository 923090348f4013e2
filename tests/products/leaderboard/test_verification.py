"""Verification: submissions are played, results written, and results that do not hold are found."""

import dataclasses
import json
import shutil
from pathlib import Path

import onnx
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.products.leaderboard.board import make_board
from fpg_bench.products.leaderboard.encounters import Verification
from fpg_bench.products.leaderboard.entries import load_entries
from fpg_bench.products.leaderboard.result import summaries_of
from fpg_bench.products.leaderboard.tracks import PUBLIC
from fpg_bench.products.leaderboard.verification import draw_sample, run_one, verify
from tests.logged import logged
from tests.policies import policy, write_seed
from tests.products.leaderboard.entering import (
    SUITE,
    case_of,
    close_season,
    enter,
    verdicts_of,
    write_suite,
    write_verified,
)

pytestmark = pytest.mark.slow

BOARD = Path(__file__).parents[3] / "leaderboard"
RIVALS = ("adaptive/pursuit", "sweep/circle")


def result(board, name):
    return board / "results" / f"{name}.jsonl"


def edit(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.fixture
def two(board):
    """A board with the results of two scripts."""
    enter(board, "ally", "still", script="idle")
    enter(board, "ally", "wise", script="expert")
    verdicts_of(board)
    return board


# Verdicts


def test_a_result_is_written_and_holds(board, in_process):
    enter(board, "ally", "wise", script="expert")
    enter(board, "ally", "linear", seeds=(0, 2))
    first = verdicts_of(board)
    assert [good for good, _ in first.values()] == [True, True]
    assert first["ally/wise"][1].startswith("verified: public ")
    before = result(board, "ally/linear").read_bytes()
    assert verdicts_of(board)["ally/linear"] == (
        True,
        "holds: 4 of 4 records played again are the same to the bit",
    )
    assert result(board, "ally/linear").read_bytes() == before
    head, *lines = map(json.loads, before.splitlines())
    assert (head["status"], [line["lost"] for line in lines]) == ("verified", [0] * 4)
    assert [(line["training_seed"], line["rival"]) for line in lines] == [
        (seed, name) for seed in (0, 2) for name in RIVALS
    ]


def test_a_verdict_says_what_an_evaluation_says_to_the_digit(board, in_process, tmp_path):
    """The same policies, once in processes of their own and once as agents' folders."""
    folder = enter(board, "ally", "linear", seeds=(0, 2))
    verdicts_of(board)
    agents = [str(folder / f"seed_{seed}") for seed in (0, 2)]
    (evaluated,) = evaluate({"linear": agents}, "ally-v2", tmp_path / "results")
    case = case_of(board, folder)
    summary = summaries_of(case.result.records, case.suites)[PUBLIC]
    assert (summary.records, summary.score) == (evaluated.records, evaluated.score)


def test_all_suites_of_the_track_are_played(board, small_suites):
    write_suite(small_suites, "ally-shifted-v2", SUITE | {"matches": 2})
    write_suite(small_suites, "ally-responses-v2", SUITE | {"matches": 3})
    folder = enter(board, "ally", "wise", script="expert")
    verdicts_of(board)
    head, *lines = map(json.loads, result(board, "ally/wise").read_text().splitlines())
    assert list(head["fingerprint"]["suites"]) == ["public", "shifted", "responses"]
    assert [len(line["returns"]) for line in lines] == [4, 4, 2, 2, 3, 3]
    close_season(small_suites, ally={"matches": 5})
    assert verdicts_of(board)["ally/wise"] == (
        False,
        f"result {result(board, 'ally/wise')}: of other suites; make it again: "
        f"fpg-bench submit run --update {folder}",
    )
    assert verdicts_of(board, update=True)["ally/wise"][1].startswith("verified: unseen ")
    head, *lines = map(json.loads, result(board, "ally/wise").read_text().splitlines())
    roles = ["public", "unseen", "shifted", "responses"]
    assert list(head["fingerprint"]["suites"]) == roles
    assert [len(line["returns"]) for line in lines] == [4, 4, 5, 5, 2, 2, 3, 3]
    assert verdicts_of(board)["ally/wise"][0]


def test_lost_rounds_count_as_the_lowest_return(board, in_process):
    in_process.loses = (1, 3)
    folder = enter(board, "ally", "linear", seeds=(0,))
    assert verdicts_of(board)["ally/linear"][1].endswith(", 4 of 8 rounds lost by rule")
    case = case_of(board, folder)
    scale = case.suites[PUBLIC].scale
    worst = (2 * scale.zero - scale.top) * 300
    for line in case.result.records:
        lowest = min(worst, line.returns[0], line.returns[2])
        assert [line.returns[k] for k in (1, 3)] == pytest.approx([lowest] * 2, abs=1e-3)
        assert line.lost == 2

    in_process.loses = (0, 1, 2, 3)
    result(board, "ally/linear").unlink()
    why = "all of its rounds are lost by rule: its answers are not valid actions"
    assert verdicts_of(board)["ally/linear"] == (False, f"not verified: {why}")
    assert verdicts_of(board)["ally/linear"] == (True, f"not verified, as before: {why}")


def test_a_policy_that_fails_is_not_verified_and_stops_nobody(board, in_process):
    enter(board, "ally", "linear", seeds=(0, 1))
    enter(board, "ally", "wise", script="expert")
    in_process.fails = True
    verdicts, why = verdicts_of(board), "seed_0: took longer than it may"
    assert verdicts["ally/linear"] == (False, f"not verified: {why}")
    assert verdicts["ally/wise"][0]
    head = json.loads(result(board, "ally/linear").read_text())
    assert (head["status"], head["reason"]) == ("not verified", why)
    assert verdicts_of(board)["ally/linear"] == (True, f"not verified, as before: {why}")
    assert verdicts_of(board, sample=0.1)["ally/linear"] == (True, "not verified; not part of a sample")
    in_process.fails = False
    good, line = verdicts_of(board)["ally/linear"]
    assert not good
    assert line.startswith("the result is not verified, but it plays")
    verdicts_of(board, update=True)
    result(board, "ally/linear").unlink()
    assert verdicts_of(board)["ally/linear"][0]
    in_process.fails, before = True, result(board, "ally/linear").read_bytes()
    assert verdicts_of(board)["ally/linear"] == (False, f"the result is verified, but now: {why}")
    assert result(board, "ally/linear").read_bytes() == before


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"returns":[', '"returns":[9'),
        ('"suites":{"public":["ally-v2","', '"suites":{"public":["ally-v2","0'),
    ],
    ids=["returns", "suites"],  # tests of results try all others
)
def test_a_result_that_was_edited_is_told_in_a_line(two, old, new):
    edit(result(two, "ally/wise"), old, new)
    verdicts = verdicts_of(two)
    assert not verdicts["ally/wise"][0]
    assert verdicts["ally/wise"][1].endswith("was edited or damaged: it does not fit its hash")
    assert "\n" not in verdicts["ally/wise"][1]
    assert verdicts["ally/still"][0]
    assert verdicts_of(two, update=True)["ally/wise"][1].startswith("verified: public ")
    assert verdicts_of(two)["ally/wise"][0]


def test_a_forged_result_is_found_by_playing_again(two):
    """Records and hash fit each other; only the rounds were never played."""
    board = two
    still, wise = (case_of(board, board / "submissions/ally" / slug) for slug in ("still", "wise"))
    write_verified(still, [dataclasses.replace(record, entry="still") for record in wise.result.records])
    good, line = verdicts_of(board, sample=0.5)["ally/still"]
    assert not good
    assert line.startswith("the result does not hold: 100.0 % of ")


def test_a_submission_that_has_changed_wants_a_new_result(board, in_process, monkeypatch):
    folder = enter(board, "ally", "linear", seeds=(0,))
    verdicts_of(board)
    edit(folder / "submission.yaml", "nothing else", "much else")
    message = "submission.yaml or a policy changed since this result was made; make it again: "
    message += "fpg-bench submit run --update {}"
    assert verdicts_of(board)["ally/linear"] == (False, message.format(folder))
    monkeypatch.chdir(board)
    for given in ("submissions/ally/linear", folder):
        verdict = run_one(given)
        assert verdict.line == message.format("submissions/ally/linear")
    assert verdicts_of(board, update=True)["ally/linear"][0]
    shutil.rmtree(folder)
    enter(board, "ally", "linear", seeds=(1,))
    assert verdicts_of(board)["ally/linear"][1].startswith("submission.yaml or a policy changed since")


def test_entries_that_share_a_policy_are_told(board, in_process):
    enter(board, "ally", "first", seeds=(0, 1))
    enter(board, "ally", "second", seeds=(1, 2))
    enter(board, "ally", "other", seeds=(3,))
    again = onnx.load_from_string(policy(3))
    again.doc_string = "Mine."
    write_seed(enter(board, "ally", "renamed", seeds=(4,)) / "seed_4", 4, again.SerializeToString())
    verdicts = verdicts_of(board)
    assert all(good for good, _ in verdicts.values())
    assert verdicts["ally/first"][1].endswith("; it plays the same as ally/second: ask whose it is")
    assert "plays the same" not in verdicts["ally/renamed"][1]  # by its file alone, before a result
    assert verdicts_of(board)["ally/renamed"][1].endswith("plays the same as ally/other: ask whose it is")
    (track, *_) = make_board(load_entries(board)).tracks
    shared = {entry.slug: figures.same_policies for entry, figures in track.verified()}
    assert shared == {
        "first": ("ally/second",),
        "second": ("ally/first",),
        "other": ("ally/renamed",),
        "renamed": ("ally/other",),
    }


@pytest.mark.parametrize(("authors", "is_flagged"), [(["A. Student"], False), (["Somebody Else"], True)])
def test_authors_may_enter_a_policy_in_two_tables(board, in_process, authors, is_flagged):
    enter(board, "opponent", "one", seeds=(0,), authors=["A. Student"])
    enter(board, "opponent", "two", seeds=(0,), authors=authors, path="learned")
    lines = [line for _, line in verdicts_of(board).values()]
    assert ["plays the same" in line for line in lines] == [is_flagged] * 2


@pytest.mark.parametrize(("track", "script"), [("ally", "idle"), ("opponent", "tone"), ("planner", "hold")])
def test_a_script_by_another_name_is_told(board, track, script):
    enter(board, track, "its-own", script=script)
    enter(board, track, "renamed", script=script, authors=["Somebody Else"])
    lines = [line for _, line in verdicts_of(board).values()]
    assert [line.rpartition("; ")[2] for line in lines] == [
        f"it plays the same as {track}/{other}: ask whose it is" for other in ("renamed", "its-own")
    ]


def test_a_result_with_a_record_of_another_policy_is_refused(board, in_process):
    folder = enter(board, "ally", "linear", seeds=(0, 1))
    verdicts_of(board)
    case = case_of(board, folder)
    first, *others = case.result.records
    write_verified(case, [dataclasses.replace(first, fingerprint="0" * 16), *others])
    assert "holds a record of another policy than the result's" in verdicts_of(board)["ally/linear"][1]


def test_a_bad_submission_and_a_stray_result_stop_nobody(two):
    (enter(two, "ally", "torn", script="expert") / "submission.yaml").write_text("{")
    (two / "submissions/ally/still").rename(two / "submissions/ally/stiller")
    verdicts = verdicts_of(two)
    assert {name for name, (good, _) in verdicts.items() if not good} == {"ally/torn", "ally/still"}
    assert "not valid YAML" in verdicts["ally/torn"][1]
    assert verdicts["ally/still"][1].endswith("no such submission")
    assert not result(two, "ally/torn").exists()


# Samples and names


def test_a_sample_holds_a_line_of_each_and_can_be_drawn_again(board, in_process):
    for slug in ("idle", "expert", "random"):
        enter(board, "ally", f"the-{slug}", script=slug)
    enter(board, "ally", "linear", seeds=(0, 1, 2, 3))
    verdicts_of(board)
    cases = [case_of(board, folder) for folder in sorted((board / "submissions/ally").iterdir())]

    def drawn(share, seed):
        return [
            [(part.name, matchup[1].name) for part, matchups in case.wanted for matchup in matchups]
            for case in draw_sample(cases, share, seed)
        ]

    assert [len(lines) for lines in drawn(0.01, 5)] == [1, 1, 1, 1]
    assert sum(map(len, drawn(0.75, 5))) >= 11
    assert sum(map(len, drawn(1, 5))) == 14
    assert drawn(0.3, 5) == drawn(0.3, 5)
    assert len({str(drawn(0.3, seed)) for seed in range(5)}) > 1
    with logged() as lines:
        verify(board, Verification(sample=0.05))
    assert lines[0].startswith("sample: 5 % of all records, --sample-seed ")
    assert all("holds: 1 of 1 records" in line for line in lines[1:])


def test_names_and_shares_are_checked(board, tmp_path):
    enter(board, "ally", "wise", script="expert")
    assert list(verdicts_of(board, "ally/wise")) == ["ally/wise"]
    for name, rest in (
        ("ally/wide", "did you mean 'ally/wise'"),
        ("opponent/wise", "did you mean 'ally/wise'"),
        ("opponent/tone", "; known: ally/wise$"),
    ):
        with pytest.raises(UserError, match=f"no submission '{name}'.*{rest}"):
            verdicts_of(board, name)
    for share in (0, -0.1, 1.5):
        with pytest.raises(UserError, match=f"sample: expected .*, got {100 * share:g} %"):
            verdicts_of(board, sample=share)


def test_one_folder_is_run_where_it_lies(board, tmp_path):
    folder = enter(board, "opponent", "near", script="adaptive")
    verdict = run_one(folder)
    assert (verdict.name, verdict.is_good) == ("opponent/near", True)
    assert result(board, "opponent/near").exists()
    with pytest.raises(UserError, match="expected a folder <leaderboard>/submissions/"):
        run_one(tmp_path)
    with pytest.raises(UserError, match="did you mean 'opponent'"):
        run_one(board / "submissions/oponent/near")


# Several at once, and interrupted ones


def test_several_at_once_give_the_same_results(two):
    alone = {path: path.read_bytes() for path in (two / "results/ally").iterdir()}
    for path in alone:
        path.unlink()
    assert all(good for good, _ in verdicts_of(two, workers=2).values())
    assert {path: path.read_bytes() for path in alone} == alone
