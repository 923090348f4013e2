"""Closing a season, from entries to a folder that others can check."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path
from unittest.mock import patch

import pytest
import yaml

from fpg_bench import UserError
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.leaderboard.audit_season import audit_season, check_entries, late_entries
from fpg_bench.leaderboard.close_season import PROFILE, close_season, make_closing, mean_returns
from fpg_bench.leaderboard.season import FILE, load_season, read_entries, season_seed
from fpg_bench.players.agent import load_agent
from tests.leaderboard.making import (
    dividing_by_zero,
    model,
    node,
    through,
    weights,
    write_seed,
    write_submission,
)
from tests.logged import logged

ROOT = Path(__file__).parents[2]
ENTRIES = (
    "ally/ally-scripted-td3",
    "ally/expert",
    "opponent/opponent-pursuit-td3",
    "opponent/tone",
    "planner/circle",
)
TINY = {"candidates": 2, "size": 2, "rounds": 2, "scale": 0.0005}


def run_here(jobs, n_jobs=1, backend=None, address=None):
    """Run jobs one after the other, as workers do."""
    for job in jobs:
        if not job.done():
            logging.getLogger("fpg_bench").info(f"{job.name}: begins")
            job.keep(job.run())
    return {}


def close_tiny(board, work, out, name="1", **options):
    """Close a season of two candidates per side; returns it and the messages."""
    with patch("fpg_bench.leaderboard.close_season.run_jobs", run_here), logged() as messages:
        closing = make_closing(name, board, work, **TINY)
        season = close_season(closing, out, **options)
    return season, messages


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    """A leaderboard of a few shipped entries."""
    folder = tmp_path_factory.mktemp("board")
    for name in ENTRIES:
        shutil.copytree(ROOT / "leaderboard/submissions" / name, folder / "submissions" / name)
    return folder


@pytest.fixture(scope="module")
def closed(board, tmp_path_factory):
    """A closed season and the folder of its candidates."""
    folder = tmp_path_factory.mktemp("closed")
    season, _ = close_tiny(board, folder / "work", folder / "season-1")
    return season, folder / "work"


@pytest.fixture
def season(closed):
    return closed[0]


@pytest.fixture
def copied(closed, tmp_path):
    """A copy of both folders, to be damaged."""
    season, work = closed
    shutil.copytree(season.folder, tmp_path / "season-1")
    shutil.copytree(work, tmp_path / "work")
    return tmp_path


def policies(season):
    return [(side, member.name, member.policy_sha256) for side, member in season.all_members()]


@pytest.mark.slow
def test_a_season_has_members_of_both_sides_with_their_recipes(season):
    loaded = load_season(season.folder)
    assert (loaded, loaded.hash) == (season, season.hash)
    assert {side: len(members) for side, members in loaded.members.items()} == {"ally": 2, "opponent": 2}
    for side, member in loaded.all_members():
        agent = load_agent(loaded.agent(side, member), side)
        assert agent.about["training_seed"] == member.training_seed
        assert agent.about["options"]["reward"] == member.reward


@pytest.mark.slow
def test_finished_candidates_are_not_trained_again(season, board, copied):
    shutil.rmtree(copied / "season-1")
    again, messages = close_tiny(board, copied / "work", copied / "season-1")
    assert policies(again) == policies(season)
    assert messages == [f"season-1, seed {season.seed[:16]}: 4 candidates, 4 of them done"]


@pytest.mark.slow
def test_a_killed_candidate_is_trained_again_with_the_same_result(season, board, copied):
    (copied / "season-1" / FILE).unlink()  # killed while it was published
    run = copied / "work/opponent/o00"
    about = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps(about | {"finished": False}))
    shutil.rmtree(run / "agent")
    (run / PROFILE).unlink()
    rows = copied / "work/ally/a01" / PROFILE
    rows.write_text(rows.read_text()[:-20])  # killed while it was played
    again, messages = close_tiny(board, copied / "work", copied / "season-1")
    assert policies(again) == policies(season)
    assert (again.folder / FILE).read_text() == (season.folder / FILE).read_text()
    assert {line.split(":")[0] for line in messages[1:]} == {"opponent/o00", "ally/a01"}


@pytest.mark.slow
def test_an_entry_that_answers_nan_or_dies_holds_up_no_closing(board, tmp_path):
    shutil.copytree(board, tmp_path / "board")
    ally = tmp_path / "board/submissions/ally/broken"
    write_submission(ally, seeds=(0, 1), name="Broken")
    write_seed(ally / "seed_0", 0, through("Abs", "Neg", "Log"))  # NaN or infinity
    write_seed(ally / "seed_1", 1, dividing_by_zero())
    season, _ = close_tiny(tmp_path / "board", tmp_path / "work", tmp_path / "season-1")
    assert season.entries["ally/broken"]
    profile = RowFile(tmp_path / "work/opponent/o00" / PROFILE).read()
    lost = [row["ally"] for row in profile if row["entry"] == "ally/broken"]
    assert lost == [pytest.approx(load_suite("ally-v1").scale.reward(-100), rel=0.01)] * 2


@pytest.mark.slow
def test_one_side_can_be_trained_first(board, copied):
    (copied / "season-1" / FILE).unlink()
    shutil.rmtree(copied / "work/ally")
    season, messages = close_tiny(board, copied / "work", copied / "season-1", sides=["opponent"])
    assert season is None
    assert messages[-1] == "season-1: candidates of the ally are not there yet; it is not closed"


@pytest.mark.slow
def test_a_season_is_closed_once_and_in_a_folder_of_its_own(closed, board, tmp_path):
    season, work = closed
    with pytest.raises(UserError, match="is closed already; the next one has another number"):
        close_tiny(board, work, season.folder)
    with pytest.raises(UserError, match=r"holds candidates of another closing .seed"):
        close_tiny(board, work, tmp_path / "season-2", name="2")


@pytest.mark.process
def test_two_closings_at_once_in_one_folder_are_told(board, tmp_path):
    code = (
        "import sys; from pathlib import Path; from fpg_bench.leaderboard.close_season import _at_work\n"
        "with _at_work(Path(sys.argv[1]), ['opponent']): print('held', flush=True); sys.stdin.read()"
    )
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", code, str(tmp_path)]
    with subprocess.Popen(
        command, env=env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout.readline() == "held\n"
        with pytest.raises(UserError, match="another process trains candidates of the opponent in"):
            close_tiny(board, tmp_path, tmp_path / "season")
        other.stdin.close()
    assert not (tmp_path / "season").exists()


@pytest.mark.parametrize("name", ["0", "season-1", "Mine", "../x", ""])
def test_invalid_names_of_closings_are_refused(board, tmp_path, name):
    with pytest.raises(UserError, match="expected a number, or a word for a training population"):
        make_closing(name, board, tmp_path)


def test_the_seed_depends_on_all_entries_in_any_order(board):
    entries = read_entries(board)
    seed = season_seed("1", 1, entries)
    assert season_seed("1", 1, entries[::-1]) == seed
    others = [season_seed("1", 2, entries), season_seed("2", 1, entries)]
    others += [season_seed("1", 1, entries[:i] + entries[i + 1 :]) for i in range(len(entries))]
    assert len({seed, *others}) == len(others) + 1


def test_missing_and_invalid_entries_are_refused(board, tmp_path):
    with pytest.raises(UserError, match="holds no submissions"):
        read_entries(tmp_path)
    shutil.copytree(board, tmp_path / "board")
    (tmp_path / "board/submissions/opponent/tone/submission.yaml").write_text("name: x\n")
    with pytest.raises(UserError, match=r"entry opponent/tone: submission.yaml: lacks"):
        read_entries(tmp_path / "board")


@pytest.mark.slow
def test_missing_and_late_entries_are_named(season, board):
    entries = read_entries(board)
    check_entries(season, entries)
    assert late_entries(season, entries) == []
    with pytest.raises(UserError, match="over the entry ally/expert, which is missing"):
        check_entries(season, [entry for entry in entries if entry.name != "ally/expert"])
    others = {name: hashes for name, hashes in season.entries.items() if name != "ally/expert"}
    other = season.model_copy(update={"entries": others})
    assert late_entries(other, entries) == ["ally/expert"]
    with pytest.raises(UserError, match="its seed does not follow from its entries"):
        check_entries(other, entries)


@pytest.mark.slow
def test_changed_and_missing_policies_are_named(copied):
    policy = copied / "season-1/opponent/o00/policy.onnx"
    policy.write_bytes(policy.read_bytes()[:-1])
    with pytest.raises(UserError, match=r"member o00: .*policy.onnx is not the file of season.yml"):
        load_season(copied / "season-1")
    policy.unlink()
    with pytest.raises(UserError, match=r"member o00: .*policy.onnx is missing"):
        load_season(copied / "season-1")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: content.pop("seed"), "season.yml: lacks seed"),
        (lambda c: c["members"].pop("ally"), "members: expected members of ally and opponent, got opponent"),
        (lambda c: c["members"]["ally"][0].update(more=1), r"members.ally\[0\]: unknown key 'more'"),
    ],
)
def test_an_invalid_season_file_is_one_line(copied, change, message):
    file = copied / "season-1" / FILE
    content = yaml.safe_load(file.read_text())
    change(content)
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(UserError, match=message) as error:
        load_season(copied / "season-1")
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_a_member_that_answers_nan_is_named(season, tmp_path):
    shutil.copytree(season.agent("opponent", season.members["opponent"][0]), tmp_path / "agent")
    policy = model([node("MatMul", ["observation", "w"], ["action"])], [weights(scale=float("nan"))])
    (tmp_path / "agent/policy.onnx").write_bytes(policy)
    about = json.loads((tmp_path / "agent/agent.json").read_text())
    about["policy_sha256"] = hashlib.sha256(policy).hexdigest()
    (tmp_path / "agent/agent.json").write_text(json.dumps(about))
    with pytest.raises(UserError, match=r"expert against .*agent: opponent action of game 0: index 0 is nan"):
        mean_returns("expert", "ally", str(tmp_path / "agent"), "pursuit", "seed", 2)


@pytest.mark.slow
def test_an_audit_trains_a_member_again(season, board, tmp_path, monkeypatch):
    monkeypatch.setattr("fpg_bench.leaderboard.audit_season.run_jobs", run_here)
    (audited,) = audit_season(season, read_entries(board), tmp_path, ["o00"], rounds=TINY["rounds"])
    assert (audited.side, audited.name, audited.is_same, audited.difference) == ("opponent", "o00", True, 0.0)
    with pytest.raises(UserError, match="has no member 'o99'"):
        audit_season(season, read_entries(board), tmp_path, ["o99"])
