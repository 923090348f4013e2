"""Two at once: every verb that writes a folder or a board has the same lock, and the same sentence for it."""

import subprocess
import sys
from pathlib import Path

import pytest

import fpg_bench.cli.main
from fpg_bench.common.locks import locked
from fpg_bench.products.leaderboard.folders import work_folder
from tests.programs import held_elsewhere
from tests.test_cli import VERBS
from tests.test_golden_verbs import prepare

ALLY = "FPG/AllyVsScripted-v0"
BOARD = "at-work"  # in the board's own folder for work
# The words of each verb, and what another process holds
WRITERS = {
    "train": (f"ppo {ALLY} --hyperparams tiny.yml --out run", "run/run.json"),
    "offline": ("bc datasets/fpg/ally-random-v0 --out run", "run/run.json"),
    "evaluate": ("idle --suite ally-v2 --matches 1 --out results", "results/evaluation.json"),
    "best-response": ("idle --hyperparams tiny.yml --out found", "found/best_responses.json"),
    "double-oracle": ("--hyperparams tiny.yml --out found", "found/search.json"),
    "rule-search": ("--side opponent --against idle --budget 0.01 --out found", "found/rule.json"),
    "tabular-self-play": ("--iterations 1 --games 2 --out tables", "tables/tabular_self_play.json"),
    "export": ("shipped --out mine/seed_0", "mine/seed_0"),
    "reproduce": (
        "yang-2026 fig7 --scenario figures --budget hundredth",
        "reproduced/figures-hundredth.jsonl.gz",
    ),
    "tune export": ("study best.yml", "study/export"),
    "dataset make": ("ally-random-v0 --steps 600 --out made", "made/fpg/ally-random-v0"),
    "hub pull": ("hf://owner/agent --out pulled", "pulled"),
    "submit run": ("board/submissions/ally/idle", BOARD),
    "leaderboard init": ("board", BOARD),
    "leaderboard verify": ("--folder board", BOARD),
    "leaderboard break": ("ally/idle agent --name Me --author Me --folder board", BOARD),
    "leaderboard build": ("--folder board --out site", "site"),
    "leaderboard close-season": ("4 --folder board --work work --out season", "work/at-work-ally"),
}
SHARED = {"tune run"}  # several machines work on one study
SINGLE_FILES = {"play", "table", "curves", "scenario show"}  # each is replaced as a whole
READERS = {
    *("envs", "players", "suites", "zoo", "scenario check", "dataset list"),
    *("dataset check", "hub push", "submit check"),
    "leaderboard season",
}


def test_every_verb_says_whether_two_may_run_at_once():
    known = [*WRITERS, *SHARED, *SINGLE_FILES, *READERS]
    assert sorted(known) == sorted(verb.removeprefix("fpg-bench ") for verb in VERBS)


@pytest.fixture(scope="module")
def laid_out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("laid-out")
    prepare(folder)
    return folder


@pytest.mark.parametrize("verb", WRITERS)
def test_a_second_process_is_refused_with_one_sentence(verb, laid_out, monkeypatch, capsys):
    monkeypatch.chdir(laid_out)
    monkeypatch.setattr("fpg_bench.products.leaderboard.folders.user_cache", lambda: laid_out / "cache")
    monkeypatch.setattr("fpg_bench.products.hub.download.download", lambda name: None)
    words, held = WRITERS[verb]
    if verb == "offline":
        run("dataset make ally-random-v0 --steps 600 --out datasets", monkeypatch)
    before = sorted(laid_out.rglob("*"))
    path = work_folder(Path("board")) / BOARD if held == BOARD else laid_out / held
    with held_elsewhere(path):
        assert run(f"{verb} {words}", monkeypatch) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.endswith(": another process is writing there; wait until it ends")
    left = set(laid_out.rglob("*")) - set(before) - {path, *path.parents}
    assert not left


def run(words, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["fpg-bench", *words.split()])
    with pytest.raises(SystemExit) as end:
        fpg_bench.cli.main.main()
    return end.value.code


@pytest.mark.process
def test_of_two_that_make_one_data_set_at_once_one_makes_it(tmp_path):
    words = "-m", "fpg_bench", "dataset", "make", "ally-random-v0", "--steps", "600", "--out", "made"
    both = [
        subprocess.Popen([sys.executable, *words], cwd=tmp_path, stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    errors = [each.communicate()[1] for each in both]
    assert 0 in [each.returncode for each in both], errors
    for each, error in zip(both, errors, strict=True):
        assert each.returncode == 0 or error.endswith("is writing there; wait until it ends\n"), error
    assert [path.name for path in (tmp_path / "made/fpg").iterdir()] == ["ally-random-v0"]


def test_folders_that_a_lock_has_made_go_with_it(tmp_path):
    with locked(tmp_path / "new" / "er" / "rows.jsonl"):
        assert (tmp_path / "new" / "er").is_dir()
    assert not (tmp_path / "new").exists()
    with locked(tmp_path / "new" / "er" / "rows.jsonl"):
        (tmp_path / "new" / "kept").touch()
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["kept"]
