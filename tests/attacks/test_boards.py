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


def quiet(line):
    pass


@pytest.fixture
def entered(board, in_process):
    """A board of honest entries, verified."""
    enter(board, "ally", "wise", script="expert")
    enter(board, "ally", "linear", seeds=(0, 2))
    enter(board, "opponent", "near", script="adaptive")
    assert all(verdict.good for verdict in verify(board))
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


def test_verify_gives_each_its_own_verdict_and_the_honest_ones_hold(stormed, messages):
    verdicts = {verdict.name: verdict for verdict in verify(stormed)}
    assert len(verdicts) == COUNT + 3
    good = {name for name, verdict in verdicts.items() if verdict.good}
    assert good == {"ally/wise", "ally/linear", "opponent/near"}
    assert not [line for line in messages if "a bug" in line]
    assert all(line.isprintable() for line in messages)


def test_build_and_crossplay_go_on_without_them(stormed, tmp_path, messages):
    assert play_missing(stormed, rounds=2) == []
    board = make_board(stormed)
    assert not [line for line in messages if "a bug" in line]
    ranked = [entry.slug for entry, figures in board.tracks[0].verified() if figures.rank]
    assert sorted(ranked) == ["linear", "wise"]
    build_site(board, tmp_path / "site", {})


def test_check_says_what_is_wrong_with_each(stormed):
    for seed in range(COUNT):
        folder = stormed / f"submissions/ally/hostile-{seed}"
        for line in problems(folder):
            assert "a bug" not in line
            line.encode()


@pytest.mark.parametrize("seed", [3, 12])
def test_the_command_line_says_it_in_lines(stormed, seed):
    found = CliRunner().invoke(app, ["submit", "check", f"{stormed}/submissions/ally/hostile-{seed}"])
    assert found.exit_code == 1 or "nothing is wrong" in found.stdout


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
    known = verification.load_submission

    def fails(folder, *how):
        if folder.name == "wise":
            raise KeyError("nobody thought of this")
        return known(folder, *how)

    monkeypatch.setattr(verification, "load_submission", fails)
    verdicts = {verdict.name: verdict for verdict in verify(entered)}
    assert {name: verdict.good for name, verdict in verdicts.items()} == {
        "ally/wise": False,
        "ally/linear": True,
        "opponent/near": True,
    }
    assert verdicts["ally/wise"].line.startswith("KeyError: 'nobody thought of this', in ")
