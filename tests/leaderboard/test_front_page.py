"""The front page: the first three of each track on an axis of their own, and a round that moves."""

import re

import pytest

from fpg_bench.leaderboard.board import Score
from fpg_bench.leaderboard.site.build import build_site
from fpg_bench.leaderboard.site.front_page import ticks, zoomed_axis
from fpg_bench.leaderboard.site.replays import Replay
from fpg_bench.leaderboard.site.views import Axis
from tests.leaderboard.example_board import example_board

ROUND = Replay("replays/ally/player-1/ab.js", "against x", "What happened.", "fpgRound({});\n")


def front(board, folder, replays=None):
    build_site(board, folder, replays)
    return (folder / "index.html").read_text()


def test_the_first_three_of_each_track_stand_there_by_score(tmp_path):
    board = example_board(9)
    text = front(board, tmp_path).split('id="first-opponent-pursuit"')[0]
    first = list(board.tracks[0].verified())[:3]
    assert re.findall(r'href="entries/ally/([\w-]+).html"', text) == [entry.slug for entry, _ in first]
    assert all(f"{figures.score.value:.1f}" in text for _, figures in first)


def test_the_round_of_the_first_entry_that_has_one_moves(tmp_path):
    assert ROUND.file in front(example_board(4), tmp_path, {("ally", "player-1"): [ROUND]})
    text = front(example_board(4), tmp_path)
    assert "<canvas" not in text  # without rounds there is none
    assert "film.js" not in text


def test_an_axis_spans_what_stands_on_it_and_little_more():
    axis = zoomed_axis([Score(58.6, 58.0, 59.2), Score(38.3, 31.6, 45.1)])
    assert 30 < axis.low < 31.6
    assert 59.2 < axis.high < 61
    assert zoomed_axis([]) == Axis(0.0, 100.0)


@pytest.mark.parametrize(
    ("domain", "marks"),
    [((30.2, 60.6), [40, 50, 60]), ((-6, -5), [-6, -5]), ((0, 100), [0, 20, 40, 60, 80, 100])],
)
def test_marks_are_round_numbers_within_the_axis(domain, marks):
    assert ticks(Axis(*domain)) == marks
