"""Planners on a board: verified, verified again, and ranked as all other submissions are."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path
from unittest import mock

import pytest

from fpg_bench.evaluation.summary import summary_of
from fpg_bench.players.planner import PLANNERS, asks_language_model
from fpg_bench.products.language_models import comparison as language_models
from fpg_bench.products.leaderboard.board import make_board
from fpg_bench.products.leaderboard.entries import load_entries
from fpg_bench.products.leaderboard.site.views import track_view
from fpg_bench.products.leaderboard.tracks import PUBLIC, UNSEEN
from tests.products.leaderboard.entering import case_of

from . import recording
from .entering import close_season, enter, verdicts_of, write_verified

BOARD = Path(__file__).parents[3] / "leaderboard"
NAMES = ["planner/hold", "planner/pursuit", "planner/toy"]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "planner-v1.yml").write_text(recording.PLANNER_SUITE)
    with mock.patch.object(language_models, "_current_season", return_value=None):  # as on this board
        recording.record(folder, folder / "planner-v1.yml")
    return folder


@pytest.fixture
def entered(board, recorded):
    """A board with two planners of the package and a model."""
    for name in ("hold", "pursuit"):
        enter(board, "planner", name, script=name)
    recording.enter(recorded / "out", enter(board, "planner", "toy", runs=3))
    return board


def test_a_board_of_planners_holds_and_tells_tier_model_and_valid_answers(entered):
    first = verdicts_of(entered)
    assert list(first) == NAMES
    assert all(good and line.startswith("verified: public ") for good, line in first.values())
    kept = {path: path.read_bytes() for path in (entered / "results").rglob("*.jsonl")}
    again = verdicts_of(entered, sample=0.01, seed=1)
    assert all(good and line.startswith("holds: 1 of 1 records") for good, line in again.values())
    assert {path: path.read_bytes() for path in kept} == kept
    track = next(track for track in make_board(load_entries(entered)).tracks if track.key == "planner")
    assert track.suites[0].rivals == ("idle", "expert")
    figures = {entry.slug: of for entry, of in track.verified()}
    *ranked, (reference, bound) = figures.items()  # one that sees the ally's path comes last, without a rank
    ranks = [of.rank[0] for _, of in ranked]
    assert ranks == sorted(ranks)
    assert (reference, bound.rank, bound.is_reference) == ("pursuit", None, True)
    assert bound.score.value > max(of.score.value for _, of in ranked)
    view = track_view(make_board(load_entries(entered)), track)
    assert view["leaders"]
    assert "pursuit" not in view["leaders"]
    assert (figures["pursuit"].planner.tier, figures["pursuit"].planner.valid) == ("ally", None)
    toy = figures["toy"].planner
    assert (toy.model, toy.tier, toy.valid) == ("toy", "history", pytest.approx(2 / 3, rel=1e-5))
    assert (toy.runs, len(toy.curve)) == (3, 3)
    assert figures["toy"].score.over == "matches"
    assert {entry.slug: entry.kind for entry in track.entries}["toy"] == "submitted"


def test_a_model_without_transcripts_is_refused_and_nothing_else_is_touched(entered):
    folder = entered / "submissions" / "planner" / "toy"
    shutil.rmtree(folder / "transcripts")
    verdicts = verdicts_of(entered)
    line = "transcripts: does not exist; it holds what evaluate has recorded"
    assert verdicts["planner/toy"] == (False, f"submission {folder}: {line}")
    assert verdicts["planner/hold"][0]
    assert not (entered / "results" / "planner" / "toy.jsonl").exists()


def test_a_share_of_valid_answers_that_was_edited_is_found(entered):
    verdicts_of(entered, "planner/toy")
    case = case_of(entered, entered / "submissions" / "planner" / "toy")
    lines = [
        dataclasses.replace(line, plans=dataclasses.replace(line.plans, statuses={"ok": 6}))
        for line in case.result.records
    ]
    write_verified(case, lines)
    good, line = verdicts_of(entered, "planner/toy")["planner/toy"]
    assert not good
    assert "the result does not hold: planner-v1, idle: statuses.fallback-invalid 2" in line


def test_a_model_stands_behind_planners_once_a_season_is_closed(entered, small_suites):
    """It has met the first public matches alone, so it has a score of what is known, and no rank."""
    close_season(small_suites, planner={"rivals": [{"ally": "reactive"}]})
    assert verdicts_of(entered)["planner/toy"][1].startswith("verified: public ")
    assert verdicts_of(entered)["planner/hold"][0]
    track = next(track for track in make_board(load_entries(entered)).tracks if track.key == "planner")
    assert track.ranked_by == UNSEEN
    *others, (last, figures), (reference, _) = track.verified()
    assert (last.slug, figures.rank, list(figures.scores)) == ("toy", None, [PUBLIC])
    assert reference.slug == "pursuit"
    assert figures.score == figures.scores[PUBLIC]
    assert all(other.rank and list(other.scores) == [PUBLIC, UNSEEN] for _, other in others)


@pytest.mark.slow
def test_all_planners_that_ask_no_model_stand_on_the_board_as_their_scores_say():
    scores = {}
    for name in (name for name in PLANNERS if not asks_language_model(name)):
        case = case_of(BOARD, BOARD / "submissions" / "planner" / name)
        scores[name] = summary_of(case.result.records, case.suites[PUBLIC]).score.value
    known = [scores[name] for name in ("hold", "random", "hill-climb", "interceptor", "pursuit")]
    assert known == sorted(known)
    assert scores["optimised"] == max(scores.values())
