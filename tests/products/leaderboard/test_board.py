import dataclasses
import json
import re
import shutil
from itertools import product

import numpy as np
import pytest
from typer.testing import CliRunner

from fpg_bench.cli.main import app
from fpg_bench.common.files import read_yaml
from fpg_bench.evaluation.seeds import PROTOCOL
from fpg_bench.evaluation.summary import summary_of
from fpg_bench.products.leaderboard import result, submission
from fpg_bench.products.leaderboard.board import CROSSPLAY, make_board
from fpg_bench.products.leaderboard.encounters import Verification
from fpg_bench.products.leaderboard.entries import load_entries
from fpg_bench.products.leaderboard.site import replays
from fpg_bench.products.leaderboard.site.build import build_site
from fpg_bench.products.leaderboard.site.page_data import policy_data, submitted_policies
from fpg_bench.products.leaderboard.tracks import PUBLIC, SHIFTED, UNSEEN
from fpg_bench.products.leaderboard.verbs import build
from fpg_bench.products.leaderboard.verification import verify
from tests.logged import logged
from tests.policies import model, node, remembering, weights
from tests.products.leaderboard.entering import SUITE, bad_pairs, close_season, enter, write_suite

pytestmark = pytest.mark.slow


@pytest.fixture
def entered(board, in_process, kept):
    if kept.exists():
        shutil.copytree(kept, board, dirs_exist_ok=True)
        return board
    enter(board, "ally", "wise", script="expert", name="Wise <b>it</b>")
    enter(board, "ally", "still", script="idle")
    enter(board, "ally", "linear", seeds=(0, 10, 2))
    few = enter(board, "ally", "few", seeds=(0,), algorithm="few")
    about = few / "seed_0/agent.json"
    about.write_text(
        json.dumps(json.loads(about.read_text()) | {"offline": {"dataset": "fpg/ally-mixed-v0"}})
    )
    enter(board, "opponent", "near", script="adaptive")
    enter(board, "opponent", "far", script="tone", path="learned")
    assert all(verdict.is_good for verdict in verify(board))
    shutil.copytree(board, kept)
    return board


def track_of(board, key):
    (track,) = (track for track in board.tracks if track.key == key)
    return track


def figures_of(track):
    return {entry.slug: figures for entry, figures in track.verified()}


def test_entries_are_ranked_and_marked(entered):
    board = make_board(load_entries(entered))
    ally = track_of(board, "ally")
    figures = figures_of(ally)
    scores = [of.score.value for of in figures.values()]
    assert scores == sorted(scores, reverse=True)
    entries = {entry.slug: entry for entry in ally.entries}
    wise = figures["wise"]
    assert entries["wise"].name == "Wise <b>it</b>"
    assert (entries["wise"].kind, entries["wise"].about.training, wise.training_seeds) == ("script", None, 0)
    assert (ally.ranked_by, wise.score) == (PUBLIC, wise.scores[PUBLIC])
    assert tuple(wise.by_rival[PUBLIC]) == ally.suites[0].rivals
    assert wise.measures["return"] == pytest.approx(wise.measures["ally_return"] / 300, rel=1e-4)
    assert sum(wise.histograms["jam"]) == pytest.approx(1, abs=1e-4)
    assert [figures[slug].has_few_seeds for slug in ("wise", "few", "linear")] == [False, True, True]
    assert entries["linear"].kind == "submitted"
    assert (entries["linear"].offline, entries["few"].offline) == ((), ("fpg/ally-mixed-v0",))
    assert {slug for slug, of in figures.items() if of.rank is None} == {"few", "linear"}
    assert all(1 <= of.rank[0] <= of.rank[1] <= 2 for of in figures.values() if of.rank)
    for of in figures.values():
        assert of.score.value == pytest.approx(ally.scale.score(of.measures["return"]), rel=1e-4)
    seeds = figures["linear"].by_seed
    assert list(seeds) == [0, 2, 10]
    assert sum(seeds.values()) / 3 == pytest.approx(figures["linear"].score.value, rel=1e-4)
    assert seeds[0] == pytest.approx(figures["few"].score.value)
    assert wise.by_seed == {}
    for key, slug in (("opponent-pursuit", "near"), ("opponent-learned", "far")):
        assert [entry.slug for entry in track_of(board, key).entries] == [slug]


def test_what_does_not_count_is_shown_last_or_left_out_with_its_reason(entered, in_process):
    path = entered / "results/ally/still.jsonl"
    path.write_text(path.read_text().replace('"lost":0', '"lost":1', 1))
    enter(entered, "ally", "slow", seeds=(7,))
    in_process.fails = True
    verify(entered, Verification(["ally/slow"]))
    torn = enter(entered, "ally", "torn", script="exprt")
    (entered / "results/ally/torn.jsonl").write_text("")
    new = enter(entered, "ally", "new", script="reactive")
    wise = entered / "submissions/ally/wise/submission.yaml"
    wise.write_text(wise.read_text().replace("nothing else", "much else"))
    (entered / "submissions" / "planers").mkdir()
    with logged() as messages:
        ally = make_board(load_entries(entered)).tracks[0]
    assert {entry.slug: entry.reason for entry in ally.entries[2:]} == {
        "slow": "seed_7: took longer than it may",
        "still": ally.entries[-2].reason,
        "wise": ally.entries[-1].reason,
    }
    assert [entry.figures for entry in ally.entries[2:]] == [None] * 3
    assert "was edited or damaged" in ally.entries[-2].reason
    assert [message for message in messages if "still" not in message] == [
        "submissions/planers: left out: not a track; did you mean 'planner'?",
        f"ally/new: left out: has no result; make it: fpg-bench submit run {new}",
        "ally/slow: not verified: seed_7: took longer than it may",
        f"ally/torn: left out: submission {torn}: submission.yaml: script: unknown 'exprt'; "
        "did you mean 'expert'?",
        "ally/wise: not verified: submission.yaml or a policy changed since this result was made; "
        f"make it again: fpg-bench submit run --update {wise.parent}",
    ]


def test_a_bug_takes_no_entry_off_the_board_but_ends_the_build(board, in_process, monkeypatch):
    enter(board, "ally", "wise", script="expert")
    verify(board)

    def broken(*_, **options):
        raise NameError("a bug")

    for name, load in product(("cases.admit", "cases.make_case"), (load_entries, bad_pairs)):
        with monkeypatch.context() as patched:
            patched.setattr(f"fpg_bench.products.leaderboard.{name}", broken)
            with pytest.raises(NameError, match="a bug"):
                load(board)


def test_crossplay_shows_who_has_played_everybody_and_names_the_others(entered, tmp_path):
    assert make_board(load_entries(entered)).crossplay == {}
    bad_pairs(entered)
    board = make_board(load_entries(entered))
    crossplay = board.crossplay["standard"]
    assert list(board.crossplay) == ["standard"]
    assert crossplay.allies == ("few", "linear", "still", "wise")
    assert crossplay.opponents == ("far", "near")
    for matrix in (crossplay.jamming_success_rate, *crossplay.returns.values()):
        assert [len(row) for row in matrix] == [2] * 4
    assert crossplay.missing == {"ally": (), "opponent": ()}
    assert CROSSPLAY in {figures.exploited.lowest.where for figures in figures_of(board.tracks[0]).values()}
    content = json.loads(board.to_json(), parse_constant=lambda name: 1 / 0)  # NaN or Infinity
    assert [track["key"] for track in content["tracks"]] == [track.key for track in board.tracks]
    assert content["crossplay"]["standard"]["allies"] == ["few", "linear", "still", "wise"]
    assert_mixtures_fit(crossplay)
    enter(entered, "ally", "new", script="reactive", name="Brand New")
    verify(entered, Verification(["ally/new"]))
    board = make_board(load_entries(entered))
    missing = {"ally": ("new",), "opponent": ()}
    assert board.crossplay == {"standard": dataclasses.replace(crossplay, missing=missing)}
    build_site(board, tmp_path / "site")
    page = (tmp_path / "site/crossplay.html").read_text()
    assert "Not in it yet: Brand New." in page
    assert "fpg-bench leaderboard verify" in page


def assert_mixtures_fit(crossplay):
    """The mixtures are an equilibrium of the ally's returns."""
    returns, value = np.array(crossplay.returns["ally"]), crossplay.nash.value
    ally, opponent = (np.array(list(of.values())) for of in (crossplay.nash.ally, crossplay.nash.opponent))
    assert (ally.sum(), opponent.sum()) == pytest.approx((1, 1), abs=1e-4)
    assert ally @ returns @ opponent == pytest.approx(value, abs=1e-3)
    assert (returns @ opponent).max() == pytest.approx(value, abs=1e-3)
    assert (ally @ returns).min() == pytest.approx(value, abs=1e-3)


def test_the_same_player_is_shown_once(board):
    """One script stands in both tables of opponents; ``random`` flies otherwise where it flies itself."""
    enter(board, "ally", "wise", script="expert")
    for script in ("tone", "random"):
        enter(board, "opponent", f"near-{script}", script=script)
        enter(board, "opponent", f"far-{script}", script=script, path="learned")
    enter(board, "opponent", "other", script="comb")
    verify(board)
    bad_pairs(board)
    crossplay = make_board(load_entries(board)).crossplay["standard"]
    assert crossplay.same_player == {"near-tone": "far-tone"}
    assert crossplay.opponents == ("far-random", "far-tone", "near-random", "other")
    assert tuple(crossplay.nash.opponent) == crossplay.opponents
    assert sum(crossplay.nash.opponent.values()) == pytest.approx(1, abs=1e-4)
    for matrix in (crossplay.jamming_success_rate, *crossplay.returns.values(), *crossplay.half.values()):
        assert [len(row) for row in matrix] == [4]


@pytest.fixture
def season(board, small_suites, in_process):
    """A board whose first season is closed: two opponents are unseen, and some rules shifted."""
    close_season(small_suites, ally={"rivals": [{"opponent": "tone"}, {"opponent": "comb"}]})
    slow = [{"opponent": ["tone", "comb"], "changes": {"ally_speed_m_s": [3, 6]}, "name": "a slower ally"}]
    write_suite(small_suites, "ally-shifted-v2", SUITE | {"matches": 2, "rivals": slow})
    enter(board, "ally", "wise", script="expert")
    enter(board, "ally", "still", script="idle")
    enter(board, "ally", "linear", seeds=(0, 10, 2))
    assert all(verdict.is_good for verdict in verify(board))
    return board


def test_a_closed_season_ranks_by_whom_nobody_had_met(season):
    board = make_board(load_entries(season))
    assert (board.season, board.protocol) == (1, PROTOCOL)
    ally = track_of(board, "ally")
    assert ally.ranked_by == UNSEEN
    roles = [PUBLIC, UNSEEN, SHIFTED]
    assert [suite.role for suite in ally.suites] == roles
    assert ally.suites[1].rivals == ("tone", "comb")
    all_figures = figures_of(ally).values()
    for figures in all_figures:
        assert list(figures.scores) == list(figures.by_rival) == roles
        assert figures.score == figures.scores[UNSEEN]
        assert figures.exploited.lowest.where in (PUBLIC, UNSEEN)
    assert {figures.training_seeds for figures in all_figures if figures.rank is None} == {3}
    unseen = [figures.scores[UNSEEN].value for figures in all_figures if figures.rank]
    assert unseen == sorted(unseen, reverse=True)
    assert unseen != sorted((figures.scores[PUBLIC].value for figures in all_figures), reverse=True)


def test_the_command_on_an_entry_s_page_plays_it_again(entered, tmp_path, monkeypatch):
    build_site(make_board(load_entries(entered)), tmp_path / "site")
    page = (tmp_path / "site/entries/ally/still.html").read_text()
    program, *words = re.search(r"<code>(fpg-bench leaderboard verify .*?)</code>", page)[1].split()
    assert program == "fpg-bench"
    (tmp_path / "leaderboard").symlink_to(entered, target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(app, words).exit_code == 0
    result = entered / "results/ally/still.jsonl"
    result.write_text(re.sub(r'"returns":\[[-\d.]+', '"returns":[999.0', result.read_text()))
    assert CliRunner().invoke(app, words).exit_code != 0


def test_the_verb_says_who_is_left_out_and_keeps_rounds_that_it_does_not_simulate(
    board, tmp_path, capsys, messages
):
    enter(board, "ally", "wise", script="expert")
    verify(board)
    enter(board, "ally", "still", script="idle")
    site = tmp_path / "site"
    capsys.readouterr()
    messages.clear()
    build(site, board)
    first, played = messages
    assert first.startswith("ally/still: left out: has no result")
    assert played == "ally/wise: playing rounds to watch"
    assert capsys.readouterr().out.startswith("1 entries, 1 rounds to watch")
    rounds = sorted(site.glob("replays/ally/wise/*.js"))
    assert len(rounds) == 1
    verify(board)
    capsys.readouterr()
    build(site, board, replays=False)
    assert capsys.readouterr().out.startswith("2 entries, 1 rounds to watch")
    assert sorted(site.glob("replays/*/*/*.js")) == rounds
    assert rounds[0].name in (site / "entries/ally/wise.html").read_text()


def of_the_page(entries, content):
    """The policy of an entry on the page of games, if this were its file."""
    (linear,) = (entry for entry in entries.verified if entry.slug == "linear")
    policy = dataclasses.replace(linear.submission.policies[0], model=content)
    changed = dataclasses.replace(
        linear, submission=linear.submission.model_copy(update={"policies": (policy,)})
    )
    return submitted_policies(dataclasses.replace(entries, verified=[changed])).get(("ally", "linear"))


def test_the_page_gets_the_first_policy_of_each_verified_entry_that_it_can_play(entered):
    entries = load_entries(entered)
    assert submitted_policies(entries).keys() == {("ally", "linear"), ("ally", "few")}
    for last in ("Tanh", "Erf"):
        layers = [node("Gemm", ["observation", "w"], ["raw"]), node(last, ["raw"], ["action"])]
        policy = model(layers, [weights()])
        assert of_the_page(entries, policy) == policy_data(policy)
    assert of_the_page(entries, remembering()) == policy_data(remembering())


def test_a_policy_that_the_page_cannot_show_is_named_and_left_out(entered, messages):
    entries = load_entries(entered)
    odd = remembering(activations=["Sigmoid", "Tanh", "Tanh"])
    assert of_the_page(entries, b"no policy") is None
    assert of_the_page(entries, odd) is None
    assert messages == [
        "ally/linear: its policy is not on the page of games: is not an ONNX file, or is truncated",
        "ally/linear: its policy is not on the page of games: operator 'LSTM': its attribute 'activations' "
        "is not played; export without it",
    ]


def test_a_build_reads_each_submission_once_and_keeps_all_rounds(entered, tmp_path, monkeypatch, messages):
    read, summed, checked = [], [], []
    monkeypatch.setattr(submission, "read_yaml", lambda *how: read.append(how[0]) or read_yaml(*how))
    monkeypatch.setattr(result, "summary_of", lambda *how: summed.append(how) or summary_of(*how))
    monkeypatch.setattr(replays, "check_policy", lambda policy: checked.append(policy) or [])
    for _ in range(2):
        build(tmp_path / "site", entered)
        assert sorted(read) == sorted(entered.resolve().glob("submissions/*/*/submission.yaml"))
        assert len(summed) == len(read)  # each has played the public suite
        read.clear()
        summed.clear()
    assert len(checked) == 2  # linear's and few's first policy, before the first build plays them
    played = {line.partition(":")[0] for line in messages if "playing rounds to watch" in line}
    shown = json.loads((tmp_path / "site/board.json").read_text())["tracks"]
    watched = {
        f"{track['key']}/{entry['slug']}": entry["replays"] for track in shown for entry in track["entries"]
    }
    files = sorted(
        str(path.relative_to(tmp_path / "site")) for path in tmp_path.glob("site/replays/*/*/*.js")
    )
    assert sorted(file for of_entry in watched.values() for file in of_entry) == files
    assert played == watched.keys()
