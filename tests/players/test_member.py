"""Members of a suite fly as they were trained to, whatever the game's path."""

from __future__ import annotations

import pickle

import numpy as np

from fpg_bench.envs.two_player import make_duel
from fpg_bench.players.agent import load_agent, member_from_folder
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player

PURSUER = "opponent-pursuit/ppo/seed_0"
FLYER = "opponent-learned/sac/seed_0"


def rounds(path, *opponents):
    """Two rounds of five games of an agent each, as tallies; and who played."""
    duel = make_duel(5, path=path)
    ally = PolicyRunner("ally", [as_player("expert", "ally", duel.scenario)], duel.batch)
    runner = PolicyRunner("opponent", opponents, duel.batch)
    tallies, choices = [], []
    for seeds in (range(5), None):
        mask = duel.reset(seeds=seeds)
        ally.begin(mask)
        runner.begin(mask)
        while not duel.batch.games["truncated"].all():
            duel.batch.step(ally.act(), runner.act())
        tallies.append(duel.batch.tallies.copy())
        choices.append(runner.choice.copy())
    return np.array(tallies), np.array(choices)


def test_who_learned_in_pursuit_plays_the_same_rounds_under_learned_flight():
    member = member_from_folder(PURSUER)
    assert (rounds("learned", member)[0] == rounds("pursuit", member)[0]).all()
    agent = load_agent(PURSUER)  # which is not told how it flew
    assert (rounds("learned", agent)[0] != rounds("pursuit", agent)[0]).any()


def test_who_learned_to_fly_flies_itself():
    assert (rounds("learned", member_from_folder(FLYER))[0] == rounds("learned", load_agent(FLYER))[0]).all()


def test_both_kinds_are_drawn_in_one_game():
    pursuer, flyer = member_from_folder(PURSUER), member_from_folder(FLYER)
    mixed, choices = rounds("learned", pursuer, flyer)
    assert set(choices.ravel()) == {0, 1}
    assert (mixed[choices == 0] == rounds("pursuit", pursuer)[0][choices == 0]).all()
    assert (mixed[choices == 1] == rounds("learned", flyer)[0][choices == 1]).all()


def test_a_member_that_travels_to_a_worker_flies_as_before():
    assert pickle.loads(pickle.dumps(member_from_folder(PURSUER))).flies == "pursuit"
