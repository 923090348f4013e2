"""A suite's members stand in a list of players; each is asked only where it plays, and plays as ever."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import SCRIPTED
from fpg_bench.common.imports import code_fingerprint
from fpg_bench.envs.core import SingleAgentGame, policies_of
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.game.scenario import STANDARD
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import OnnxPlayer, baselines_folder, expand_suites
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player, policy_hash

from .test_agent import model_bytes

GAMES, ENV_ID = 24, "FPG/AllyVsPolicy-v0"
SHIPPED = [
    "ally-scripted/ppo/seed_0",
    "ally-scripted/ppo-stack8/seed_0",
    "ally-scripted/recurrent-ppo/seed_0",
]


class AskedOfAll:
    """A player that can only be asked about every game."""

    def __init__(self, player):
        self.reset = getattr(player, "reset", lambda mask, seeds: None)
        self.predict, self.sees = player.predict, getattr(player, "sees", "")


def allies():
    """One player of every kind, and one of them a second time."""
    named = [as_player(name, "ally", STANDARD) for name in (*SCRIPTED["ally"], *SHIPPED, "oracle")]
    noisy = [OnnxPlayer(model_bytes(state=2, noise=2)), OnnxPlayer(model_bytes(noise=1))]
    return [*named, *noisy, AskedOfAll(as_player("random", "ally", STANDARD)), named[0]]


def played(players, steps=400):
    """Return a population's answers over rounds that end at different times, and when it asked whom."""
    duel = TwoPlayerBatch(STANDARD, GAMES)
    runner, chance = PolicyRunner("ally", players, duel.batch), np.random.default_rng(0)
    runner.begin(duel.reset(seeds=3, horizons=300 - np.arange(GAMES) * 12))
    found = []
    for _ in range(steps):
        found.append(runner.act().copy())
        duel.batch.step(found[-1], chance.uniform(-1, 1, (GAMES, 9)).astype(np.float32))
        over = duel.batch.games["truncated"].copy()
        if over.any():
            runner.begin(duel.reset(over))
    return np.array(found)


@pytest.mark.slow
def test_asking_each_player_only_where_it_plays_changes_no_bit():
    assert np.array_equal(played(allies()), played([AskedOfAll(player) for player in allies()]))


def test_a_player_is_asked_about_its_own_games_and_no_others():
    asked = []

    class Counting(OnnxPlayer):
        def predict(self, observation, *rest):
            asked.append(len(observation))
            return super().predict(observation, *rest)

    players = [Counting(model_bytes(state=1)) for _ in range(3)]
    duel = TwoPlayerBatch(STANDARD, GAMES)
    runner = PolicyRunner("ally", [*players, players[0]], duel.batch)
    runner.begin(duel.reset(seeds=0))
    runner.act()
    counts = np.bincount(runner.choice, minlength=4)
    assert asked == [counts[0] + counts[3], counts[1], counts[2]]


@pytest.fixture
def suite(tmp_path):
    """A suite of two opponents and one ally, agents of others, which are played in the sandbox."""
    pytest.importorskip("fpg_bench.products.sandbox.agent")
    agents = baselines_folder() / "agents"
    for side, member, agent in (
        ("opponent", "b-ppo", "opponent-pursuit/ppo/seed_0"),
        ("opponent", "a-td3", "opponent-pursuit/td3/seed_0"),
        ("ally", "ppo", "ally-scripted/ppo/seed_0"),
    ):
        shutil.copytree(agents / agent, tmp_path / "small" / side / member)
    return f"suite:{tmp_path}/small"


def test_a_suites_name_stands_for_its_members_of_the_side_wherever_it_is_in_a_list(suite):
    found = expand_suites(["tone", suite, "comb"], "opponent")
    assert found == ["tone", f"{suite}/a-td3", f"{suite}/b-ppo", "comb"]
    game = GameSpec(ENV_ID, opponent=["tone", suite])
    core = SingleAgentGame(game, 64)
    core.reset(seeds=0)
    assert set(core._runner.choice) == {0, 1, 2}
    assert set(policies_of(game)) == set(found[1:3])
    loaded = map(policy_hash, core._runner.players)
    assert [policies_of(game).get(spec) for spec in core.other_specs] == list(loaded)
    assert SingleAgentGame(GameSpec("FPG/OpponentVsPolicy-v0", ally=suite)).other_specs == [f"{suite}/ppo"]


def test_code_that_a_training_meets_counts_by_its_content(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for options in ({"opponent": ["tone", "friend:mine"]}, {"planner": "friend:mine"}):
        game = GameSpec(ENV_ID, **options)
        (tmp_path / "friend.py").write_text("mine = 1\n")
        before = policies_of(game)
        assert before.keys() == {"friend:mine"}
        assert policies_of(game) == before
        (tmp_path / "friend.py").write_text("mine = 2\n")
        assert policies_of(game)["friend:mine"] != before["friend:mine"]


def test_what_is_installed_does_not_count_as_the_users_own_code(tmp_path, monkeypatch):
    installed = tmp_path / "site-packages"
    installed.mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(installed))
    (tmp_path / "mate.py").write_text("import lib_of_others\n")
    (installed / "lib_of_others.py").write_text("x = 1\n")
    before = code_fingerprint("mate:mine")
    (installed / "lib_of_others.py").write_text("x = 2\n")
    assert code_fingerprint("mate:mine") == before
    assert code_fingerprint("lib_of_others:x") != code_fingerprint("mate:mine")


def test_a_member_is_a_player_by_its_own_name(suite):
    agent = as_player(f"{suite}/a-td3", "opponent", STANDARD)
    assert agent.card.algorithm == "td3"


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("suite:training-9999", "opponent 'suite:training-9999': no such suite"),
        ("{suite}/c-ppo", r"the suite has no such member.*b-ppo"),
        ("suite:", "no such suite"),
        ("{suite}/ally-only", "has no members that play the opponent"),
        ("{suite}/broken", "sha256"),
        ("{suite}/empty", "the folder holds none"),
    ],
)
def test_a_suite_that_is_not_there_or_is_damaged_is_refused_in_one_line(suite, spec, words):
    root = suite.removeprefix("suite:")
    shutil.copytree(f"{root}/ally", f"{root}/ally-only/ally")
    shutil.copytree(f"{root}/opponent/b-ppo", f"{root}/broken/opponent/m")
    Path(root, "broken/opponent/m/policy.onnx").write_bytes(b"else")
    Path(root, "empty/opponent/m").mkdir(parents=True)
    with pytest.raises(UserError, match=words):
        SingleAgentGame(GameSpec(ENV_ID, opponent=spec.format(suite=suite)))
