"""What is new since a trusted revision is played by who verifies, and nothing of it is believed."""

import dataclasses
import json
import subprocess

import pytest

from fpg_bench.errors import UserError
from fpg_bench.leaderboard.cases import make_case
from fpg_bench.leaderboard.crossplay import crossplay_file, forget_untrusted, play_missing
from fpg_bench.leaderboard.result import read_result, verified_result, write_result
from fpg_bench.leaderboard.since import changed_since, pairs_at
from fpg_bench.leaderboard.verify import verify
from tests.leaderboard.entering import enter


def git(board, *words):
    identity = ("-c", "user.name=x", "-c", "user.email=x@example.org")
    subprocess.run(["git", "-C", str(board), *identity, *words], check=True, capture_output=True)


@pytest.fixture
def trusted(board, in_process):
    """A board with one honest entry of each side, its results and pairs, all committed."""
    enter(board, "ally", "honest", seeds=(0, 1))
    enter(board, "opponent", "script", script="adaptive")
    assert all(verdict.good for verdict in verify(board, say=lambda line: None))
    play_missing(board, rounds=4, say=lambda line: None)
    git(board, "init", "--quiet")
    git(board, "add", "--all")
    git(board, "commit", "--quiet", "--message", "as it was")
    return board


def forged(board, name):
    """The result of an entry with every return a little higher, and all else that follows from it."""
    case = make_case(board, board / "submissions" / name)
    kept = read_result(case.path, case.fields)
    lines = [dataclasses.replace(line, returns=tuple(x + 9.0 for x in line.returns)) for line in kept.lines]
    result = verified_result(kept.slug, case.submission.track, kept.fingerprint, lines, case.fields)
    write_result(case.path, result)
    return kept, case


def test_nothing_has_changed_where_nothing_was_touched(trusted):
    assert changed_since(trusted, "HEAD") == set()


def test_new_and_changed_entries_are_found(trusted):
    enter(trusted, "ally", "newcomer", seeds=(0,))
    forged(trusted, "ally/honest")
    assert changed_since(trusted, "HEAD") == {"ally/honest", "ally/newcomer"}


def test_the_lines_of_who_verifies_take_the_place_of_forged_ones(trusted):
    kept, case = forged(trusted, "ally/honest")
    assert read_result(case.path, case.fields).lines != kept.lines
    (verdict,) = verify(trusted, ["ally/honest"], sample=0.01, since="HEAD", say=lambda line: None)
    assert verdict.good
    assert read_result(case.path, case.fields).lines == kept.lines


def test_a_result_that_can_not_even_be_read_is_replaced(trusted):
    case = make_case(trusted, trusted / "submissions" / "ally/honest")
    whole = case.path.read_text()
    case.path.write_text("[" * 500)
    verify(trusted, ["ally/honest"], since="HEAD", say=lambda line: None)
    assert case.path.read_text() == whole


def test_forged_pairs_are_dropped_and_played_again(trusted):
    file = crossplay_file(trusted)
    row = json.loads(file.read_text())
    file.write_text(json.dumps(row | {"jamming_success_rate": 0.0}) + "\n")
    assert forget_untrusted(trusted, pairs_at(trusted, "HEAD")) == 1
    play_missing(trusted, rounds=4, say=lambda line: None)
    assert json.loads(file.read_text()) == row


def test_trusted_pairs_stay(trusted):
    assert forget_untrusted(trusted, pairs_at(trusted, "HEAD")) == 0


@pytest.mark.parametrize("revision", ["nothing", "--output=x", ""])
def test_what_is_no_revision_is_refused_in_a_line(trusted, revision):
    for read in (changed_since, pairs_at):
        with pytest.raises(UserError, match="since: "):
            read(trusted, revision)


def test_a_board_outside_of_git_is_refused(board):
    with pytest.raises(UserError, match="since: "):
        changed_since(board, "HEAD")
