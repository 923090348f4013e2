"""One seed, one game: to the bit, whatever the batch, the threads, the order or the process."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fpg_bench.game.batch import GameBatch
from fpg_bench.game.scenario import PAPER, STANDARD, preset

from .playing import begin, wander

STEPS = 60


def fingerprint(game_batch, game: int) -> bytes:
    """Every bit of a game's state, tally and observations (records field by field: padding is nobody's)."""
    records = [
        record[game][name] for record in (game_batch.games, game_batch.tallies) for name in record.dtype.names
    ]
    arrays = (
        game_batch.histograms,
        game_batch.segments,
        game_batch.ally_observations,
        game_batch.opponent_observations,
    )
    return b"".join(part.tobytes() for part in [*records, *(array[game] for array in arrays)])


def play_batch(scenario, seeds, threads: int = 1) -> GameBatch:
    """Play a batch; its actions depend on each game's seed alone."""
    game_batch = GameBatch(scenario, len(seeds), threads=threads)
    game_batch.reset(seeds=seeds)
    kinds = np.concatenate([wander(kind, STEPS) for kind in range(17)], axis=2)
    for actions in zip(*kinds[:, :, np.asarray(seeds) % 17], strict=True):
        game_batch.step(*actions)
    return game_batch


@pytest.mark.parametrize(("games", "threads"), [(7, 1), (2048, 1), (2048, 2), (1500, 3)])
@pytest.mark.parametrize("name", ["standard", "paper", "link"])
def test_a_game_of_a_batch_is_the_game_of_its_seed(name, games, threads):
    scenario = preset(name)
    seeds = np.random.default_rng(0).permutation(games) + 1000
    batch = play_batch(scenario, seeds, threads)
    for game in (0, games // 3, games // 2, games - 1):
        assert fingerprint(batch, game) == fingerprint(play_batch(scenario, seeds[game : game + 1]), 0)


def test_what_was_played_before_leaves_no_trace():
    """A draw that is not used shifts nothing: a round begins alike whatever came before it."""
    scenario = dataclasses.replace(STANDARD, rounds_per_match=3)
    one, other = begin(scenario, 4), begin(scenario, 4)
    for k in range(50):
        one.step(*(x[k] for x in wander(1, 50)))
    for game_batch in (one, other):
        game_batch.reset()
        for k in range(STEPS):
            game_batch.step(*(x[k] for x in wander(4, STEPS)))
    assert fingerprint(one, 0) == fingerprint(other, 0)


def test_chance_does_not_depend_on_the_actions():
    """Fading of each step is the same in a game of hops and in one without."""
    one, other = begin(PAPER, 3), begin(PAPER, 3)
    idle = np.full((1, 9), -1.0)
    for k in range(STEPS):
        one.step(idle, idle)
        a, o = (x[k].copy() for x in wander(3, STEPS))
        a[0, 1], a[0, 2], a[0, 0] = -1, -1, 1
        other.step(a, o)
        difference = one.games["clean_snr_db"][0] - other.games["clean_snr_db"][0]
        path_loss = 20 * np.log10(other.games["frequency_mhz"][0] / one.games["frequency_mhz"][0])
        assert difference == pytest.approx(path_loss, abs=1e-9)
