"""The board as it is committed: who stands on it, and what a small sample of it says when played again."""

import errno
import importlib.util
import re
from pathlib import Path

import pytest
import torch
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole
from fpg_bench.players.agent import load_agent
from fpg_bench.products.leaderboard.about import name_skeleton
from fpg_bench.products.leaderboard.board import make_board
from fpg_bench.products.leaderboard.cases import board_reader
from fpg_bench.products.leaderboard.entries import load_entries
from fpg_bench.products.leaderboard.folders import repository_board, start_board, submission_folders
from fpg_bench.products.leaderboard.site.build import build_site
from fpg_bench.products.leaderboard.site.page_data import zoo_policies
from fpg_bench.products.leaderboard.submission import admit
from fpg_bench.products.leaderboard.tracks import PUBLIC, SCENARIOS
from fpg_bench.products.leaderboard.verbs import build
from fpg_bench.products.sandbox.client import check_policies, check_policy
from fpg_bench.products.zoo.zoo import load_zoo
from tests.products.leaderboard.entering import case_of
from tests.products.leaderboard.making import problems
from tests.programs import python

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
BOARD = ROOT / "leaderboard"
ENTRY = BOARD / "submissions/ally/plain-torch"


@pytest.mark.full
def test_the_script_makes_agents_as_the_submission_s(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("plain", ROOT / "scripts" / "train_plain_torch.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    for name, small in (("TURNS", 2), ("GAMES", 4), ("STEPS", 40)):
        monkeypatch.setattr(script, name, small)
    monkeypatch.setattr(script.learn, "__defaults__", (20,))
    policy = script.train(7)
    script.export(policy, tmp_path / "seed_7", 7)
    agent = load_agent(tmp_path / "seed_7", "ally")
    seen = torch.rand(5, 15) * 2 - 1
    difference = policy(seen).detach().numpy() - agent.predict(seen.numpy())[0]
    assert abs(difference).max() < 1e-6
    assert check_policy(agent.model) == []
    shipped = admit(ENTRY)
    assert {p.card.algorithm for p in shipped.policies} == {agent.card.algorithm}


def test_a_visitor_plays_against_every_agent_of_the_board_and_so_its_leaders():
    texts = [path.read_text() for path in (BOARD / "submissions").glob("*/*/submission.yaml")]
    agents = {name for text in texts if (name := yaml.safe_load(text).get("zoo"))}
    assert len(agents) > 50
    assert all(name.startswith("duel-") for name in agents - zoo_policies().keys())  # of both sides at once


def test_its_submission_is_sound_and_no_path_is_left_in_it():
    assert problems(ENTRY) == []
    for policy in admit(ENTRY).policies:
        assert b"site-packages" not in policy.model
        assert b"train_plain_torch" not in policy.model


@pytest.fixture(scope="module")
def board():
    return make_board(load_entries(BOARD))


@pytest.fixture(scope="module")
def shown(board):
    return {track.key: track for track in board.tracks}


@pytest.mark.full
def test_every_entry_has_a_short_name_that_no_other_of_its_table_has(board):
    for track in board.tracks:
        names = [name_skeleton(entry.name) for entry in track.entries]
        assert len(set(names)) == len(names), track.key
        assert all(len(entry.name) <= 40 for entry in track.entries)


@pytest.mark.full
def test_everybody_on_the_board_is_verified():
    folders = submission_folders(BOARD)
    policies = [policy for folder in folders for policy in admit(folder, inspect_onnx=False).policies]
    check_policies([policy.model for policy in policies])  # in one process: each entry starts its own else
    reader = board_reader(BOARD)
    for folder in folders:
        case = case_of(BOARD, folder, reader)
        assert case.result is not None, f"{case.name}: no result; run fpg-bench leaderboard verify"
        assert case.result.verified, case.name
        assert case.path.stat().st_size < 500_000


@pytest.mark.process
def test_the_script_enters_what_stands_there_and_no_half_of_an_algorithm(tmp_path):
    run = (ROOT / "scripts/enter_zoo.py", "--folder", tmp_path)
    assert python(*run).returncode == 0
    written = {path.relative_to(tmp_path): path.read_text() for path in tmp_path.rglob("*") if path.is_file()}
    assert written == {
        name: (BOARD / name).read_text() if (BOARD / name).exists() else "run scripts/enter_zoo.py"
        for name in written
    }
    for member in load_zoo().members():
        entered = [name for name in written if name.parent.name == f"{member.group.name}-{member.algorithm}"]
        assert member.shipped or not entered, member.name
    again = python(*run)
    assert (again.returncode, again.stdout) == (0, "")


@pytest.mark.full
def test_random_play_stands_at_0_and_nobody_above_100(shown):
    """In every suite that the board plays, held-out and shifted ones and those of responses included."""
    for key, track in shown.items():
        known = {entry.slug: figures.scores for entry, figures in track.verified()}
        (random,) = (known[slug] for slug in ("random", "random-learned", "random-link") if slug in known)
        assert random.keys() >= {suite.role for suite in track.suites}, key
        for role, score in random.items():
            assert score.low < 0 < score.high, (key, role)
            assert abs(score.value) < 0.3, (key, role)
        assert max(scores[PUBLIC].value for scores in known.values()) < 105, key


@pytest.mark.full
def test_crossplay_has_all_pairs(board):
    assert tuple(board.crossplay) == SCENARIOS
    for crossplay in board.crossplay.values():
        assert crossplay.missing == {"ally": (), "opponent": ()}, "run fpg-bench leaderboard verify"


@pytest.mark.full
def test_pages_of_the_board_load_little(board, tmp_path):
    build_site(board, tmp_path)

    def loaded(page):
        files = re.findall(
            r'(?:<script src|<link rel="stylesheet" href)="([^"]+)"', (tmp_path / page).read_text()
        )
        return sum((tmp_path / file).stat().st_size for file in (page, *files))

    def largest(pattern, count):
        return sum(sorted(path.stat().st_size for path in tmp_path.glob(pattern))[-count:])

    assert loaded("index.html") < 100_000
    assert loaded("ranking.html") < 225_000  # with some 140 entries
    chosen = largest("data/compare/*.js", 1) + largest("data/compare/*/*.js", 2)
    assert loaded("compare.html") + chosen < 300_000


def test_the_baselines_are_those_of_the_repository(tmp_path, monkeypatch):
    assert (repository_board() / "submissions" / "ally" / "expert").is_dir()
    folders = "fpg_bench.products.leaderboard.folders"
    monkeypatch.setattr(f"{folders}.baselines_folder", lambda: tmp_path / "baselines")
    with pytest.raises(UserError, match="run this in a clone"):
        repository_board()


def test_a_leaderboard_starts_empty_and_is_built_with_the_game(tmp_path):
    start_board(tmp_path / "own")
    build(tmp_path / "site", tmp_path / "own", replays=False)
    assert (tmp_path / "site" / "play.html").is_file()
    assert "No entries yet" in (tmp_path / "site" / "index.html").read_text()
    assert "has not been played" in (tmp_path / "site" / "crossplay.html").read_text()
    with pytest.raises(UserError, match="holds files already"):
        start_board(tmp_path / "own")


def test_a_board_begins_whole_or_not_at_all(tmp_path, monkeypatch):
    written = []

    def write_eight(path, content):
        written.append(path)
        if len(written) == 9:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        write_whole(path, content)

    monkeypatch.setattr(f"{start_board.__module__}.write_whole", write_eight)
    with pytest.raises(OSError, match="No space left"):
        start_board(tmp_path / "own", repository_board())
    monkeypatch.undo()
    boards = tmp_path / "own", repository_board()
    start_board(*boards)
    own, source = ({path.relative_to(board) for path in board.glob("results/**/*.jsonl")} for board in boards)
    assert own == source
