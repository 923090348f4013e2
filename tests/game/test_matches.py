"""Rounds, matches and seeds."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.seeds import dataset_seed
from fpg_bench.game.batch import GameBatch, check_seeds
from fpg_bench.game.scenario import STANDARD

from .playing import ally, begin, opponent, play, wander

TEN = dataclasses.replace(STANDARD, rounds_per_match=10, steps_per_round=20)
MATCH = ("control_points", "opponent_start")


def test_a_match_keeps_its_path_and_start_and_draws_the_rest_anew():
    batch = begin(TEN)
    first = {name: batch.games[name].copy() for name in MATCH}
    fading, points, checks = [], set(), set()
    for number in range(10):
        game = batch.games[0]
        assert (game["match"], game["round"], game["step"]) == (0, number, 0)
        for name in MATCH:
            assert (game[name] == first[name][0]).all()
        assert (game["opponent_position"] == game["opponent_start"]).all()
        np.testing.assert_allclose(game["ally_position"], game["control_points"][0])
        points.add(int(game["point"]))
        checks.add(int(game["next_check"]))
        batch.step(ally(), opponent(tuning=1, in_band=True))
        fading.append(float(batch.games["clean_snr_db"][0]))
        batch.reset()
    assert len(set(fading)) == 10
    assert len(points) > 3
    assert len(checks) > 2


def test_after_the_last_round_comes_the_seeds_next_match():
    batch = begin(TEN)
    path = batch.games["control_points"][0].copy()
    for _ in range(10):
        batch.reset()
    assert (batch.games["seed"][0], batch.games["match"][0], batch.games["round"][0]) == (0, 1, 0)
    assert (batch.games["control_points"][0] != path).all()


def test_a_mask_begins_some_games_and_leaves_the_others():
    batch = begin(TEN, games=4)
    play(batch, *wander(1, 5, 4))
    before = batch.games.copy(), batch.tallies.copy(), batch.ally_observations.copy()
    mask = np.array([True, False, True, False])
    batch.reset(mask)
    for was, now in zip(before, (batch.games, batch.tallies, batch.ally_observations), strict=True):
        assert (was[~mask] == now[~mask]).all()
    assert batch.games["step"].tolist() == [0, 5, 0, 5]
    assert batch.games["round"].tolist() == [1, 0, 1, 0]
    assert batch.tallies["steps"].tolist() == [0, 5, 0, 5]
    assert batch.histograms.sum(axis=(1, 2)).tolist() == [0, 10, 0, 10]
    batch.reset(mask, seeds=[70, 71, 72, 73])
    assert batch.games["seed"].tolist() == [70, 1, 72, 3]


def test_a_round_lasts_its_steps_and_is_not_played_on():
    batch = begin(TEN, games=2)
    ends = []
    for actions in zip(*wander(0, 20, 2), strict=True):
        batch.step(*actions)
        ends.append(batch.games["truncated"].copy())
    assert not np.any(ends[:-1])
    assert ends[-1].all()
    batch.reset(np.array([False, True]))
    before = batch.games[0].copy(), batch.tallies[0].copy(), batch.ally_observations[0].copy()
    batch.step(ally().repeat(2, 0), opponent().repeat(2, 0))
    assert batch.games[0] == before[0]
    assert batch.tallies[0] == before[1]
    assert (batch.ally_observations[0] == before[2]).all()
    assert batch.games["step"].tolist() == [20, 1]


@pytest.mark.parametrize(
    "seeds", [-1, 2**63, 1.5, "7", True, None, [1, 2], [1, 2, -3], np.array([1.0, 2.0, 3.0]), [[1, 2, 3]]]
)
def test_bad_seeds_are_refused(seeds):
    with pytest.raises(UserError, match="seed"):
        GameBatch(TEN, 3).reset(seeds=seeds)


def test_a_thousand_batches_of_other_seeds_share_no_game():
    """Of 1,000 pairs of a seed and a number of games, a third with neighbouring seeds."""
    rng = np.random.default_rng(0)
    seeds = [*range(300), *(10**6 * k + part for k in range(1, 101) for part in range(2))]
    seeds += rng.integers(2**63, size=500).tolist()
    pairs = list(zip(seeds, rng.integers(1, 100, len(seeds)).tolist(), strict=True))
    assert len(pairs) == 1000
    streams = {(seed, i): each for seed, games in pairs for i, each in enumerate(check_seeds(seed, games))}
    assert len(set(streams.values())) == sum(games for _, games in pairs)
    assert [streams[seed, 0] for seed in seeds] == seeds
    further = [each for (_, i), each in streams.items() if i]
    assert min(further) >= 3 * 2**61 > dataset_seed(2**30 - 1) + 2**32
    assert max(further) < 2**63
    for seed, games in pairs[::100]:  # whatever the number of games
        assert check_seeds(seed, 200)[:games].tolist() == [streams[seed, i] for i in range(games)]


def test_a_seed_in_the_place_of_the_mask_is_told_how_seeds_are_given():
    with pytest.raises(UserError, match=r"seeds are named: reset\(seeds=0\)"):
        GameBatch(TEN).reset(0)
