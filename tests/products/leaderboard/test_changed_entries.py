"""Entries that are new since a trusted revision are played by who verifies, and not believed."""

import dataclasses
import json
import shutil
import subprocess
from functools import partial

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.products.leaderboard import crossplay, verification
from fpg_bench.products.leaderboard.board import make_board
from fpg_bench.products.leaderboard.changed_entries import Changes, changed_entries, rows_at
from fpg_bench.products.leaderboard.encounters import Verification
from fpg_bench.products.leaderboard.entries import load_entries
from fpg_bench.products.leaderboard.folders import crossplay_file, result_file
from fpg_bench.products.leaderboard.result import read_result
from fpg_bench.products.leaderboard.verification import verify
from tests.logged import logged
from tests.products.leaderboard.entering import (
    bad_pairs,
    case_of,
    enter,
    resealed,
    verdicts_of,
    write_verified,
)


def git(board, *words):
    identity = ("-c", "user.name=x", "-c", "user.email=x@example.org")
    subprocess.run(["git", "-C", str(board), *identity, *words], check=True, capture_output=True)


@pytest.fixture
def trusted(board, in_process, kept, monkeypatch):
    """A board with one honest entry of each side, its results and pairs, all committed."""
    monkeypatch.setattr(crossplay, "ROUNDS", 4)
    if kept.exists():
        shutil.copytree(kept, board, dirs_exist_ok=True)
        return board
    enter(board, "ally", "honest", seeds=(0, 1))
    enter(board, "opponent", "script", script="adaptive")
    assert all(verdict.is_good for verdict in verify(board))
    assert bad_pairs(board) == {}
    git(board, "init", "--quiet")
    git(board, "add", "--all")
    git(board, "commit", "--quiet", "--message", "as it was")
    shutil.copytree(board, kept)
    return board


def forged(board, name):
    """The result of an entry with every return a little higher, and all else that follows from it."""
    case = case_of(board, board / "submissions" / name)
    kept = read_result(case.path, case.suites)
    records = [
        dataclasses.replace(record, returns=tuple(x + 9.0 for x in record.returns)) for record in kept.records
    ]
    write_verified(case, records)
    return kept, case


def test_new_and_changed_entries_are_found(trusted):
    assert changed_entries(trusted, "HEAD") == Changes()
    enter(trusted, "ally", "newcomer", seeds=(0,))
    forged(trusted, "ally/honest")
    assert changed_entries(trusted, "HEAD") == Changes(frozenset({"ally/honest", "ally/newcomer"}))


def test_the_lines_of_who_verifies_take_the_place_of_forged_ones(trusted):
    kept, case = forged(trusted, "ally/honest")
    assert read_result(case.path, case.suites).records != kept.records
    (verdict,) = verify(trusted, Verification(["ally/honest"], sample=0.01, since="HEAD"))
    assert not verdict.is_good
    assert verdict.line.startswith("replaced: the result that came along does not hold: ")
    assert "; commit this one: public " in verdict.line
    assert read_result(case.path, case.suites).records == kept.records
    played = case.path.read_text()
    case.path.write_text("[" * 500)
    (verdict,) = verify(trusted, Verification(["ally/honest"], since="HEAD"))
    assert verdict.line.startswith(
        "replaced: the result that came along does not hold: it is not of this entry, or was edited"
    )
    assert case.path.read_text() == played


def test_an_honest_result_that_came_along_is_good(trusted):
    enter(trusted, "ally", "newcomer", script="expert")
    (first,) = verify(trusted, Verification(["ally/newcomer"]))
    before = result_file(trusted, "ally", "newcomer").read_bytes()
    (verdict,) = verify(trusted, Verification(["ally/newcomer"], since="HEAD"))
    assert (verdict.is_good, verdict.line) == (True, first.line)
    assert result_file(trusted, "ally", "newcomer").read_bytes() == before


def test_what_was_claimed_is_not_forgotten_when_playing_is_broken_off(trusted, monkeypatch):
    forged(trusted, "ally/honest")
    with monkeypatch.context() as broken:
        broken.setattr("fpg_bench.products.leaderboard.verification.run_jobs", lambda *how, **more: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            verify(trusted, Verification(since="HEAD"))
    verdicts = verdicts_of(trusted, since="HEAD")
    assert verdicts["ally/honest"][1].startswith("replaced: ")
    assert verdicts["opponent/script"][0]


def test_entries_that_did_not_change_are_not_played_again(trusted, monkeypatch):
    enter(trusted, "ally", "newcomer", script="expert")
    played = []
    jobs = verification._Verification.jobs
    monkeypatch.setattr(
        verification._Verification, "jobs", lambda of, case: played.append(case.name) or jobs(of, case)
    )
    verdicts = verdicts_of(trusted, since="HEAD")
    assert played == ["ally/newcomer"]
    assert verdicts["ally/honest"] == (True, "unchanged since HEAD, not played again")
    verify(trusted, Verification(since="HEAD", sample=1.0))
    assert played[1:] == ["ally/honest", "ally/newcomer", "opponent/script"]


def test_the_result_of_an_entry_that_breaks_the_contract_goes(trusted):
    result = result_file(trusted, "ally", "honest")
    (trusted / "submissions/ally/honest/seed_0/policy.onnx").write_bytes(b"nothing")
    verdicts = verdicts_of(trusted, since="HEAD")
    assert [good for good, _ in verdicts.values()] == [False, True]
    assert not result.exists()
    with logged():
        assert [entry.slug for entry in make_board(load_entries(trusted)).tracks[0].entries] == []


def test_a_rival_that_is_gone_is_told(trusted):
    shutil.rmtree(trusted / "submissions/ally/honest")
    result_file(trusted, "ally", "honest").unlink()
    (is_good, line), (other_is_good, _) = verdicts_of(trusted, since="HEAD").values()
    assert (is_good, other_is_good) == (False, True)
    assert line == "has no submission: it was removed, or only a result was added"


@pytest.mark.parametrize("slug", ["aaa", "zzz"])
def test_who_comes_later_has_not_the_name_of_who_was_there(trusted, slug):
    enter(trusted, "ally", slug, seeds=(2,), name="H0nest")
    verdicts = verdicts_of(trusted, since="HEAD")
    assert "is the name of 'honest', too" in verdicts[f"ally/{slug}"][1]
    assert verdicts["ally/honest"][0]
    assert [entry.slug for entry in make_board(load_entries(trusted)).tracks[0].entries] == ["honest"]
    with pytest.raises(UserError, match="is the name of 'honest', too"):
        case_of(trusted, trusted / "submissions/ally" / slug)


def test_bytes_count_and_not_what_git_is_told_of_them(trusted):
    """Neither the index, nor attributes, nor a list of files to overlook hides a change."""
    file = trusted / "submissions/ally/honest/submission.yaml"
    git(trusted, "update-index", "--assume-unchanged", str(file))
    file.write_text(file.read_text() + "description: other\n")
    (trusted / ".gitattributes").write_text("*.yaml text eol=crlf\n* -diff\n")
    (trusted / ".gitignore").write_text("*\n")
    enter(trusted, "ally", "newcomer", script="expert")
    assert changed_entries(trusted, "HEAD").entries == {"ally/honest", "ally/newcomer"}


@pytest.mark.parametrize("name", ["submissions", "results/ally"])
def test_a_link_on_the_way_to_entries_is_refused(trusted, name, tmp_path):
    (trusted / name).rename(tmp_path / "elsewhere")
    (trusted / name).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UserError, match="is a link; put the folder itself there"):
        changed_entries(trusted, "HEAD")


def test_a_board_that_is_a_link_or_a_submodule_is_refused(trusted, tmp_path):
    outer = tmp_path / "whole"
    git(tmp_path, "init", "--quiet", str(outer))
    git(outer, "-c", "protocol.file.allow=always", "submodule", "--quiet", "add", str(trusted), "inner")
    with pytest.raises(UserError, match="is in a submodule"):
        changed_entries(outer / "inner", "HEAD")
    (outer / "real").mkdir()
    (outer / "other").symlink_to("real")
    with pytest.raises(UserError, match="is a link"):
        changed_entries(outer / "other", "HEAD")


def test_an_entry_that_is_a_link_has_changed(trusted, tmp_path):
    (trusted / "submissions/ally/honest").rename(tmp_path / "elsewhere")
    (trusted / "submissions/ally/honest").symlink_to(tmp_path / "elsewhere")
    assert changed_entries(trusted, "HEAD").entries == {"ally/honest"}
    assert [good for good, _ in verdicts_of(trusted, since="HEAD").values()] == [False, True]


def test_changes_of_other_files_are_named_and_refused_until_they_are_known(trusted):
    (trusted / "season.yml").write_text("entries: {}")
    (trusted / "results/best_responses.jsonl").write_text("")
    message = "2 files outside of entries have changed: results/best_responses.jsonl, season.yml; review them"
    with pytest.raises(UserError, match=message):
        verify(trusted, Verification(since="HEAD"))
    assert all(v.is_good for v in verify(trusted, Verification(since="HEAD"), changes_known=True))


def test_a_link_or_a_repository_that_came_is_named_wherever_it_lies(trusted):
    """Each could bring a module or a season along, whose files lie in an entry or in no commit at all."""
    (trusted / "numpy.py").symlink_to("submissions/ally/honest/submission.yaml")
    (trusted / "lost.py").symlink_to("nowhere")
    (trusted / "other").mkdir()
    git(trusted / "other", "init", "--quiet")
    (trusted / "other" / "numpy.py").write_text("")
    assert changed_entries(trusted, "HEAD").others == ("lost.py", "numpy.py", "other/")
    (trusted / "module").mkdir()
    commit = f"160000,{'1' * 40},module"
    git(trusted, "update-index", "--add", "--cacheinfo", commit)
    assert "module" in changed_entries(trusted, "HEAD").others


def test_forged_pairs_are_dropped_and_played_again_and_others_stay(trusted):
    file = crossplay_file(trusted)
    row = json.loads(before := file.read_text())
    assert bad_pairs(trusted, since="HEAD") == {}
    assert file.read_text() == before
    file.write_text(resealed(row | {"jamming_success_rate": 0.0}))
    assert changed_entries(trusted, "HEAD") == Changes()
    (line,) = bad_pairs(trusted, since="HEAD").values()
    assert line.startswith("replaced: the result that came along does not hold: jamming_success_rate ")
    assert json.loads(file.read_text()) == row


@pytest.mark.parametrize("revision", ["nothing", "--output=x", "", "HEAD"])
def test_what_is_no_revision_is_refused_in_a_line(trusted, revision):
    if revision == "HEAD":
        shutil.rmtree(trusted / ".git")  # outside of git
    for read in (changed_entries, partial(rows_at, file=crossplay_file)):
        with pytest.raises(UserError, match="since: "):
            read(trusted, revision)
