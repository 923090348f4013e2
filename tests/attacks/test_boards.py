"""One hostile pull request never stops the board for the others."""

import json
import shutil

import pytest
from typer.testing import CliRunner

from fpg_bench.cli import app
from fpg_bench.leaderboard import verification
from fpg_bench.leaderboard.board import make_board
from fpg_bench.leaderboard.crossplay import play_missing
from fpg_bench.leaderboard.folders import crossplay_file, result_file
from fpg_bench.leaderboard.site.build import build_site
from fpg_bench.leaderboard.submission import problems
from fpg_bench.leaderboard.verification import verify
from tests.attacks import SCALE, SEED
from tests.attacks.json_texts import hostile_texts
from tests.attacks.pull_requests import spoil
from tests.leaderboard.entering import enter
from tests.logged import logged

pytestmark = pytest.mark.slow

COUNT = 40 * SCALE


@pytest.fixture
def entered(board, in_process):
    """A board of honest entries, verified."""
    enter(board, "ally", "wise", script="expert")
    enter(board, "ally", "linear", seeds=(0, 2))
    enter(board, "opponent", "near", script="adaptive")
    assert all(verdict.is_good for verdict in verify(board))
    return board


@pytest.fixture
def stormed(entered):
    """The same board with copies of an honest entry, each spoilt in another way."""
    for seed in range(COUNT):
        slug = f"hostile-{seed}"
        folder = shutil.copytree(entered / "submissions/ally/linear", entered / "submissions/ally" / slug)
        about = (folder / "submission.yaml").read_text()
        (folder / "submission.yaml").write_text(about.replace("Linear", slug))
        result = result_file(entered, "ally", slug)
        head, *lines = result_file(entered, "ally", "linear").read_text().splitlines(keepends=True)
        result.write_text("".join([json.dumps(json.loads(head) | {"slug": slug}) + "\n", *lines]))
        spoil(folder, result, SEED + seed)
    return entered


def test_hostile_entries_stop_nobody_else(stormed, tmp_path, messages):
    folders = [stormed / f"submissions/ally/hostile-{seed}" for seed in range(COUNT)]
    for line in (line for folder in folders for line in problems(folder)):
        assert "a bug" not in line
        line.encode()
    for folder in (folders[3], folders[12]):
        checked = CliRunner().invoke(app, ["submit", "check", str(folder)])
        assert checked.exit_code == 1 or "nothing is wrong" in checked.stdout
    verdicts = {verdict.name: verdict.is_good for verdict in verify(stormed)}
    assert len(verdicts) == COUNT + 3
    assert {name for name, good in verdicts.items() if good} == {"ally/wise", "ally/linear", "opponent/near"}
    assert play_missing(stormed, rounds=2) == []
    board = make_board(stormed)
    ranked = [entry.slug for entry, figures in board.tracks[0].verified() if figures.rank]
    assert sorted(ranked) == ["linear", "wise"]
    build_site(board, tmp_path / "site", {})
    assert not [line for line in messages if "a bug" in line]
    assert all(line.isprintable() for line in messages)


def test_a_hostile_line_of_cross_play_is_left_out_alone(entered, tmp_path):
    play_missing(entered, rounds=100)
    file = crossplay_file(entered)
    (sound,) = (json.loads(line) for line in file.read_text().splitlines() if '"wise"' in line)
    forged = [sound | {"ally_rewards": [99.0, 99.0]}, sound | {"lost": "x"}, sound | {"ally": "linear"}]
    texts = [text.replace(b"\n", b" ") for _, text in hostile_texts(40, base=sound)]
    texts += [json.dumps(row).encode() for row in forged]
    file.write_bytes(file.read_bytes() + b"\n".join(texts) + b"\n")
    with logged() as messages:
        board = make_board(entered)
    assert any("crossplay.jsonl" in line and "left out" in line for line in messages)
    assert repr(board.crossplay).count("99.0") == 0
    build_site(board, tmp_path / "site", {})
    assert play_missing(entered, rounds=100) == []
    assert len(file.read_bytes().splitlines()) == 2


def test_even_a_bug_of_ours_stops_nobody_else(entered, monkeypatch):
    load_submission = verification.load_submission

    def fails(folder, *how):
        if folder.name == "wise":
            raise KeyError("nobody thought of this")
        return load_submission(folder, *how)

    monkeypatch.setattr(verification, "load_submission", fails)
    lines = {verdict.name: verdict.line for verdict in verify(entered) if not verdict.is_good}
    assert lines.keys() == {"ally/wise"}
    assert lines["ally/wise"].startswith("KeyError: 'nobody thought of this', in ")
