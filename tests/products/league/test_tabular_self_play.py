"""Self-play of stochastic tables: the exported ally, and what the learners learn."""

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.game.actions import HOP_GATE, SPREAD_GATE
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.agent import OnnxPlayer, load_agent
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player
from fpg_bench.products.league.champions import load_champions
from fpg_bench.products.league.tabular_self_play import (
    ALLY_EDGES,
    OPPONENT_CHOICES,
    OPPONENT_EDGES,
    SelfPlay,
    TableLearner,
    ally_cells,
    ally_edges,
    count_cells,
    share_games,
    stochastic_table_onnx,
)

CELLS, OTHER_CELLS, WAYS = count_cells(ALLY_EDGES), count_cells(OPPONENT_EDGES), len(OPPONENT_CHOICES)


@pytest.mark.parametrize("rival", ["hunter", "random", "adaptive"])
def test_an_exported_table_is_in_the_cell_that_training_saw_to_the_bit(rival):
    """A table that surely takes one choice in each cell shows by it which cell it is in."""
    choices = np.random.default_rng(0).integers(0, 4, CELLS)
    player = OnnxPlayer(stochastic_table_onnx(np.eye(4)[choices], STANDARD))
    batch = TwoPlayerBatch(STANDARD, 64, threads=1)
    ally = PolicyRunner("ally", [player], batch.batch)
    opponent = PolicyRunner("opponent", [as_player(rival, "opponent", STANDARD)], batch.batch)
    room, cells, visited = np.zeros(6, np.float32), np.zeros(64, np.int64), set()
    for round_seeds in (5, None):
        started, memory = batch.reset(seeds=round_seeds), np.zeros((64, 6), np.float32)
        ally.begin(started)
        opponent.begin(started)
        for _ in range(STANDARD.steps_per_round):
            box_m = np.array(STANDARD.box_m, np.float32)
            ally_cells(batch.batch._ally_observations, memory, room, ally_edges(STANDARD), box_m, cells)
            visited.update(cells.tolist())
            actions = ally.act()
            expected = choices[cells]
            assert ((actions[:, HOP_GATE] > 0) == (expected >= 2)).all()
            assert ((actions[:, SPREAD_GATE] > 0) == (expected % 2 == 1)).all()
            batch.batch.step(actions, opponent.act())
    assert len(visited) > 500


def test_an_exported_table_draws_each_choice_as_often_as_it_should():
    shares = np.array([0.5, 0.3, 0.15, 0.05])
    player = OnnxPlayer(stochastic_table_onnx(np.tile(shares, (CELLS, 1)), STANDARD))
    player.reset(np.ones(20_000, bool), np.arange(20_000, dtype=np.uint64))
    actions, _ = player.predict(np.zeros((20_000, 15), np.float32))
    drawn = 2 * (actions[:, HOP_GATE] > 0) + (actions[:, SPREAD_GATE] > 0)
    assert np.abs(np.bincount(drawn, minlength=4) / 20_000 - shares).max() < 0.012
    points, counts = np.unique(actions[drawn >= 2, 3], return_counts=True)
    assert len(points) == STANDARD.frequency_points
    assert counts.min() > 0.7 * counts.mean()


def test_an_ally_learns_to_stay_where_nothing_jams_it_and_an_opponent_to_jam_what_it_knows():
    """One side learns against a fixed one: hops cost 40, and who always stays is where it is known to be."""
    games, one = SelfPlay(STANDARD, 128, 0), np.zeros(128, int)
    ally, opponent = TableLearner(np.zeros(4), CELLS, 1.0), TableLearner(np.zeros(WAYS), OTHER_CELLS, -1.0)
    stays, comb_elsewhere = np.tile(np.eye(4)[0], (CELLS, 1)), np.tile(np.eye(WAYS)[6], (OTHER_CELLS, 1))
    earned = []
    for _ in range(25):
        cells, _, chosen, _, rewards = games.play(ally.probabilities, comb_elsewhere[None], one)
        ally.learn(cells, chosen, rewards, 0.2, 0.1)
        hops = (chosen >= 2).mean()
        _, cells, _, chosen, rewards = games.play(stays, opponent.probabilities[None], one)
        opponent.learn(cells, chosen, rewards, 0.2, 0.1)
        earned.append(rewards.mean())
    assert hops < 0.2
    assert earned[-1] < earned[0] - 5
    assert np.bincount(chosen.ravel(), minlength=WAYS)[0] > chosen.size / 2  # a tone at the known point


def test_opponents_that_leave_least_are_met_most_and_each_is_met():
    whose = share_games(np.array([3.0, 1.0, 1.0, 9.0]), 1024)
    random, *counts = np.unique(whose, return_counts=True)[1].tolist()
    assert random == 128
    assert sum(counts) == 896
    assert abs(counts[1] - counts[2]) < 2
    assert counts[1] > counts[0] > counts[3] >= 64


def test_a_champion_of_tables_is_trained_and_shipped_and_the_same_seed_makes_the_same(tmp_path):
    file = tmp_path / "champions.yml"
    file.write_text("few: {verb: tabular-self-play, iterations: 3, games: 32, seeds: 1}")
    champion = load_champions(file)["few"]
    agents = [champion.train(5, tmp_path / runs) for runs in ("runs", "again")]
    first, again = [(agent / "policy.onnx").read_bytes() for agent in agents]
    assert first == again
    champion.ship(agents[0], tmp_path / "shipped", 5, "make few")
    card = load_agent(tmp_path / "shipped", "ally").card
    assert card.sample
    assert (card.algorithm, card.training_seed, card.command) == ("tabular", 5, "make few")
    assert card.recipe == {"name": "few", "verb": "tabular-self-play", "iterations": 3, "games": 32}
    assert card.training_steps == 3 * 32 * STANDARD.steps_per_round


def test_a_champion_of_tables_refuses_what_it_does_not_know(tmp_path):
    file = tmp_path / "champions.yml"
    file.write_text("few: {verb: tabular-self-play, iteration: 3}")
    with pytest.raises(UserError, match="iteration"):
        load_champions(file)
    file.write_text("few: {verb: tabular-self-play, iterations: 0}")
    with pytest.raises(UserError, match="few: iterations: expected a whole number above 0"):
        load_champions(file)
