"""Agents of equal layer sizes as one stack: as onnxruntime plays them, to 1e-5."""

from __future__ import annotations

import numpy as np
import onnx
from onnx import numpy_helper

import fpg_bench
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.game.batch import GameBatch
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.agent import OnnxPlayer, agent_folder
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player
from fpg_bench.players.stack import TOLERANCE, network_of, stacks

GAMES = 24
ALIKE = [f"duel-ally/maddpg/seed_{seed}" for seed in range(3)]
FRAMES = [f"ally-scripted/ppo-stack8/seed_{seed}" for seed in range(2)]
OTHERS = [FRAMES[0], "ally-scripted/recurrent-ppo/seed_0", "expert"]


def named(names):
    return [as_player(name, "ally", STANDARD) for name in names]


def changed(name, value):
    """An agent of which the last weights are replaced."""
    model = onnx.load(agent_folder(name) / "policy.onnx")
    last = next(each for each in model.graph.initializer if tuple(each.dims) == (9,))
    last.CopyFrom(numpy_helper.from_array(np.full(9, value, np.float32), last.name))
    return OnnxPlayer(model.SerializeToString())


def answers(players, stacked, games=GAMES, steps=60, rounds=1):
    """Actions of a population in games that another one plays; the drawn players beside them."""
    duel = TwoPlayerBatch(STANDARD, games)
    runner = PolicyRunner("ally", players, duel.batch, stacked=stacked)
    runner.begin(duel.reset(seeds=3))
    chance, found = np.random.default_rng(0), []
    for step in range(steps * rounds):
        if step and step % steps == 0:
            some = np.arange(games) % 2 == 0
            duel.batch.reset(some)
            runner.begin(some)
        found.append(runner.act())
        duel.batch.step(*np.tile(chance.uniform(-1, 1, (2, 1, 9)).astype(np.float32), (1, games, 1)))
    return np.array(found), runner


def test_a_stack_among_other_players_acts_as_onnxruntime_does():
    players = [*named([ALIKE[0], *OTHERS, *ALIKE[1:]])]
    players.append(players[0])
    exact, runner = answers(players, stacked=False)
    close, stacked = answers(players, stacked=True)
    assert not runner._stacks
    assert [members for _, members in stacked._stacks] == [[0, 4, 5]]
    assert np.array_equal(runner.choice, stacked.choice)
    assert 0 < np.abs(close - exact).max() <= 2 * TOLERANCE
    outside = np.isin(runner.choice, [1, 2, 3])
    assert np.array_equal(close[:, outside], exact[:, outside])


def test_no_game_depends_on_the_number_of_games():
    players = named(ALIKE)
    assert np.array_equal(answers(players, True)[0][:, :5], answers(players, True, games=5)[0])


def test_stacked_frames_are_kept_per_game_and_forgotten_where_a_round_starts():
    players = named([FRAMES[0], "expert", FRAMES[1], *ALIKE])
    exact, runner = answers(players, stacked=False, steps=15, rounds=3)
    close, stacked = answers(players, stacked=True, steps=15, rounds=3)
    assert [members for _, members in stacked._stacks] == [[0, 2], [3, 4, 5]]
    assert np.array_equal(runner.choice, stacked.choice)
    assert 0 < np.abs(close - exact).max() <= 2 * TOLERANCE
    assert np.array_equal(close[:15, :5], answers(players, True, games=5, steps=15)[0])


def test_an_agent_whose_memory_is_no_frames_forms_no_stack(caplog):
    players = named(FRAMES)
    model = onnx.load(agent_folder(FRAMES[0]) / "policy.onnx")
    joined = next(each for each in model.graph.node if "observation" in each.input)
    joined.input[:] = reversed(joined.input)  # the newest first
    mixed = [OnnxPlayer(model.SerializeToString()), *players]
    ((_, members),) = stacks(mixed, "ally", GameBatch(STANDARD, GAMES))
    assert members == [1, 2]
    assert "onnxruntime" in caplog.text


def test_agents_of_memory_noise_and_other_layers_form_no_stack():
    assert [network_of(player) for player in named(OTHERS[1:])] == [None] * 2
    assert stacks(named([ALIKE[0], *OTHERS]), "ally", GameBatch(STANDARD, GAMES)) == []


def test_an_agent_without_finite_actions_is_named_once_and_costs_the_others_nothing(caplog):
    broken = changed(ALIKE[0], np.nan)
    players = [*named(ALIKE), broken]
    found, runner = answers(players, stacked=True, steps=3)
    assert [members for _, members in runner._stacks] == [[0, 1, 2]]
    assert len(caplog.records) == 1
    assert "onnxruntime" in caplog.text
    assert np.isnan(found[:, runner.choice == 3]).any()
    assert np.isfinite(found[:, runner.choice != 3]).all()


def test_an_agent_that_onnxruntime_plays_otherwise_is_played_by_it(caplog, monkeypatch):
    players = named(ALIKE)
    run = players[1].run
    monkeypatch.setattr(players[1], "run", lambda feeds: [run(feeds)[0] + np.float32(1e-5)])
    (_, members), *_ = stacks(players, "ally", GameBatch(STANDARD, GAMES))
    assert members == [0, 2]
    assert "1e-05" in caplog.text


def test_games_are_stacked_on_demand_alone():
    options = {"n_envs": 4, "seed": 0, "ally": ALIKE}
    for stacked in (False, True):
        games = fpg_bench.make_sb3("FPG/OpponentVsPolicy-v0", stacked=stacked, **options)
        assert bool(games.core._runner._stacks) == stacked
    assert not fpg_bench.make_sb3("FPG/OpponentVsPolicy-v0", **options).core._runner._stacks
