import dataclasses
import json
import shutil
from unittest import mock

import numpy as np
import pytest

from fpg_bench.common.rows import SEAL
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.game.scenario import as_scenario
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.players.registry import as_player
from fpg_bench.products.leaderboard import crossplay
from fpg_bench.products.leaderboard.cases import verified_cases
from fpg_bench.products.leaderboard.crossplay import (
    CrossplayEntry,
    Pairs,
    Team,
    fully_played,
    pair_key,
    play_pair,
    players_of,
    read_pairs,
)
from fpg_bench.products.leaderboard.encounters import Verification
from fpg_bench.products.leaderboard.entries import load_entries
from fpg_bench.products.leaderboard.folders import crossplay_file
from fpg_bench.products.leaderboard.playing import Part
from fpg_bench.products.leaderboard.tracks import SCENARIOS
from fpg_bench.products.leaderboard.verification import verify
from fpg_bench.products.sandbox.client import Policy
from tests.logged import logged
from tests.policies import policy
from tests.products.leaderboard.entering import bad_pairs, close_season, enter, resealed

pytestmark = pytest.mark.slow

ROUNDS = 6


def entry(suite, slug, *plays, shipped=True):
    suite, preset = load_suite(suite), "link" if "link" in suite else "standard"
    parts = tuple(
        Part(slug, None, p)
        if isinstance(p, str)
        else Part(slug, p, Policy(p, None, policy(p), str(p)), shipped)
        for p in plays
    )
    scenario = suite.rivals[0].scenario
    return CrossplayEntry(slug, suite.side, preset, parts, scenario, suite.scale, suite.season)


def record_of(player, suite, rival):
    """As an evaluation of so many rounds has it."""
    suite = dataclasses.replace(load_suite(suite), matches=ROUNDS)
    return play(player_entry(player), suite, suite.named(rival))


@pytest.mark.parametrize("spec", ["reactive", 3])
def test_a_pair_plays_as_an_evaluation_does(spec, monkeypatch):
    """Both sides' returns per step, and how much was jammed."""
    monkeypatch.setattr(crossplay, "ROUNDS", ROUNDS)
    pair = play_pair(entry("ally-v2", "a", spec), entry("opponent-v2", "o", "adaptive"))
    player = spec if isinstance(spec, str) else OnnxPlayer(policy(spec))
    tally = record_of(player, "ally-v2", "adaptive/pursuit").tally
    expected = {
        "ally_rewards": pytest.approx((tally["ally_return"] / tally["steps"],), rel=1e-5),
        "opponent_rewards": pytest.approx((tally["opponent_return"] / tally["steps"],), rel=1e-5),
        "jamming_success_rate": pytest.approx(tally["jammed"] / tally["steps"], rel=1e-5),
    }
    assert {name: getattr(pair, name) for name in expected} == expected
    assert (pair.rounds, pair.lost) == (ROUNDS, (0, 0))


def test_a_team_plays_each_game_as_its_member_alone_would():
    members = [as_player("random", "ally", as_scenario(None)), OnnxPlayer(policy(1))]
    runners = np.array([0, 1, 1, 0, 1])
    team = Team(members, runners)
    seeds, seen = np.arange(5, dtype=np.uint64), np.random.default_rng(0).normal(size=(3, 5, 15)).astype("f")
    team.reset(np.ones(5, bool), seeds)
    memory, played = None, []
    for step in seen:
        actions, memory = team.predict(step, memory, np.zeros(5, bool))
        played.append(actions)
    for k, alone in enumerate([as_player("random", "ally", as_scenario(None)), members[1]]):
        games = runners == k
        if hasattr(alone, "reset"):
            alone.reset(np.ones(games.sum(), bool), seeds[games])
        memory = None
        for step, actions in zip(seen, played, strict=True):
            expected, memory = alone.predict(step[games], memory, np.zeros(games.sum(), bool))
            assert (actions[games] == expected).all()


def test_lost_rounds_go_to_the_other_side(in_process, monkeypatch):
    monkeypatch.setattr(crossplay, "ROUNDS", 2)
    in_process.loses = (0,)
    opponent = entry("opponent-v2", "o", "tone")
    lost = play_pair(ally := entry("ally-v2", "a", 0, shipped=False), opponent)
    assert lost.lost == (1, 0)
    assert lost.jamming_success_rate >= 0.5
    scale, (reward,) = ally.scale, lost.ally_rewards
    worst = 2 * scale.zero - scale.top
    assert reward <= (worst + scale.top) / 2
    ally = entry("ally-v2", "a", "idle")
    lost = play_pair(ally, entry("opponent-v2", "o", 0, shipped=False))
    assert lost.lost == (0, 1)
    assert lost.jamming_success_rate <= 0.5


@pytest.fixture
def entered(board, in_process, kept):
    """A board of verified scripts and one policy."""
    if kept.exists():
        shutil.copytree(kept, board, dirs_exist_ok=True)
        return board
    for slug in ("expert", "idle"):
        enter(board, "ally", slug, script=slug)
    enter(board, "opponent", "adaptive", script="adaptive")
    enter(board, "opponent", "linear", seeds=(0, 1))
    assert all(verdict.is_good for verdict in verify(board))
    shutil.copytree(board, kept)
    return board


@pytest.fixture
def played(entered, tmp_path_factory):
    """The same board with all pairs, which are played once."""
    kept = tmp_path_factory.getbasetemp() / "crossplay.jsonl"
    if not kept.exists():
        assert bad_pairs(entered) == {}
        shutil.copy(crossplay_file(entered), kept)
    shutil.copy(kept, crossplay_file(entered))
    return entered


def rows(board):
    return [json.loads(record) for record in crossplay_file(board).read_text().splitlines()]


def play_all(board):
    """Play the missing pairs of a board and one of the others, and return their number."""
    with mock.patch.object(crossplay, "play_pair", side_effect=play_pair) as play:
        assert bad_pairs(board, sample=1e-9) == {}
    return play.call_count


def test_only_new_pairs_are_played(played):
    entered, first = played, rows(played)
    pairs = [(a, o) for a in ("expert", "idle") for o in ("adaptive", "linear")]
    assert [(row["ally"], row["opponent"]) for row in first] == pairs
    assert play_all(entered) == 1
    enter(entered, "ally", "always-hop", script="always-hop")
    enter(entered, "ally", "unplayed", script="reactive")
    verify(entered, Verification(["ally/always-hop"]))
    assert play_all(entered) == 3
    assert rows(entered)[2:] == first
    assert rows(entered)[0]["ally"] == "always-hop"


def test_those_who_play_one_scenario_meet_each_other_alone(played, small_suites):
    before = rows(played)
    enter(played, "ally", "bold", script="idle", scenario="link")
    enter(played, "opponent", "apt", script="adaptive", scenario="link")
    verify(played, Verification(["ally/bold", "opponent/apt"]))
    assert play_all(played) == 2
    *first, new = rows(played)
    assert first == before
    assert (new["ally"], new["opponent"]) == ("bold", "apt")
    assert bad_pairs(played) == {}
    pairs = read_pairs(played, players_of(verified_cases(played)))
    names = {
        scenario: tuple([entry.slug for entry in side] for side in fully_played(pairs.of(scenario)))
        for scenario in SCENARIOS
    }
    assert names == {"standard": (["expert", "idle"], ["adaptive", "linear"]), "link": (["bold"], ["apt"])}
    close_season(small_suites)  # of the other scenario
    verify(played, Verification(update=True))
    assert play_all(played) == 5
    assert rows(played)[-1] == new


@pytest.mark.parametrize(
    ("played", "left"),
    [
        (["111", "111", "111"], ("012", "012")),
        (["111", "111", "000"], ("01", "012")),  # a new ally
        (["110", "110", "110"], ("012", "01")),  # a new opponent
        (["110", "110", "000"], ("01", "01")),  # both
        (["111", "101", "111"], ("02", "012")),  # a pair that failed
        (["000", "000"], ("", "012")),
        ([], ("", "012")),
    ],
)
def test_who_lacks_pairs_is_taken_out(played, left):
    opponents = [entry("opponent-v2", str(k), *["tone"] * (k + 1)) for k in range(3)]
    allies = [entry("ally-v2", str(k), *["idle"] * (k + 1)) for k in range(len(played))]
    known = {
        pair_key(ally, opponent): None
        for ally, row in zip(allies, played, strict=True)
        for opponent, there in zip(opponents, row, strict=True)
        if there == "1"
    }
    complete = fully_played(Pairs(allies, opponents, known))
    assert tuple("".join(player.slug for player in side) for side in complete) == left


def test_a_policy_that_fails_leaves_a_gap_and_a_line(entered, in_process):
    in_process.fails = True
    assert bad_pairs(entered) == dict.fromkeys(
        ("expert - linear", "idle - linear"), "not verified: took longer than it may"
    )
    assert [row["opponent"] for row in rows(entered)] == ["adaptive"] * 2


def change(board, row, **values):
    kept = rows(board)
    kept[row] |= values
    crossplay_file(board).write_text(resealed(*kept))


def test_figures_that_were_edited_are_found(played, messages):
    entered = played
    assert bad_pairs(entered) == {}
    first = rows(entered)[0]
    change(entered, 0, jamming_success_rate=first["jamming_success_rate"] + 0.01)
    assert bad_pairs(entered) == {
        "expert - adaptive": "the result does not hold: jamming_success_rate "
        f"{first['jamming_success_rate']:g}, the result says {first['jamming_success_rate'] + 0.01:g}"
    }
    assert sum(bool(bad_pairs(entered, sample=0.01, seed=seed)) for seed in range(6)) in range(1, 6)
    change(entered, 0, **first)
    last = rows(entered)[-1]
    mean = float(np.mean(last["opponent_rewards"]))
    for forged, name in (
        ({"ally_rewards": [x + 0.13 for x in last["ally_rewards"]]}, "ally_rewards "),
        ({"opponent_rewards": [x - 0.13 for x in last["opponent_rewards"]]}, "opponent_rewards "),
        # The mean is the same, but not its interval
        ({"opponent_rewards": [mean - 2, mean + 2]}, "opponent_rewards of training seed "),
        ({"lost": [50, 0]}, "lost by side 1 0, the result says 50"),
        ({"lost": [0, 100]}, "lost by side 2 0, the result says 100"),
    ):
        change(entered, -1, **last | forged)
        (line,) = bad_pairs(entered).values()
        assert line.startswith(f"the result does not hold: {name}")


def test_a_return_that_lost_rounds_cannot_give_is_named_and_not_shown(played):
    first = rows(played)[0]
    for lost in ([first["rounds"]] * 2, [0, first["rounds"]], [first["rounds"] + 1, 0]):
        change(played, 0, **first | {"lost": lost})
        with logged() as messages:
            pairs = load_entries(played).pairs
        name = f"{first['ally']} - {first['opponent']}"
        assert any(f"1 left out, of others or impossible: {name}" in message for message in messages)
        assert first["key"] not in pairs.results
        assert list(bad_pairs(played)) == [name]


def test_no_field_of_a_pair_can_be_edited(played):
    """Whatever is edited is refused, or the line is no pair of the board any more."""
    first = rows(played)[0]
    for name, value in first.items():
        for forged in _edited(value):
            change(played, 0, **first | {name: forged})
            is_told = name not in (SEAL, "key")  # rows get their hash anew; those of another key are dropped
            assert bool(bad_pairs(played)) == is_told, (name, forged)
            assert is_told or rows(played)[0] == first
    change(played, 0, **first)
    assert bad_pairs(played) == {}


def _edited(value):
    """Other values of a field: of a hair's breadth, of a sign, and of another size."""
    if isinstance(value, str):
        return [f"{value}0"]
    if isinstance(value, list):
        return [[other, *value[1:]] for other in _edited(value[0])] + [value * 2]
    return [value + 1, -value - 1, *([value + 0.002] if isinstance(value, float) else [])]


def test_a_new_season_wants_new_pairs(played, small_suites):
    """Its rounds are others, so that figures of two seasons never stand in one matrix."""
    entered, before = played, rows(played)
    close_season(small_suites)
    assert bad_pairs(entered) == {}
    assert rows(entered) == []
    verify(entered, Verification(update=True))
    assert play_all(entered) == 4
    assert not {row["key"] for row in before} & {row["key"] for row in rows(entered)}


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (lambda text: text + '{"ally": "x"}\n', "row 5: was edited or damaged: it does not fit its hash"),
        (lambda text: text.replace('"lost": [0, 0]', '"lost": [0, 1]', 1), "row 1: was edited or damaged"),
        (lambda text: text[:-1], "line 4 is cut off"),
    ],
)
def test_a_row_that_does_not_fit_is_named_left_out_and_played_again(played, spoil, line):
    before = rows(played)
    file = crossplay_file(played)
    file.write_text(spoil(resealed(*before)))
    with logged() as messages:
        load_entries(played)
    assert any(line in message for message in messages)
    bad = bad_pairs(played)
    assert list(bad) == ["crossplay.jsonl"]
    assert line in bad["crossplay.jsonl"]
    assert rows(played) == before
    assert bad_pairs(played) == {}
