"""One seed, one game: to the bit, whatever the batch, the threads, the order or the process."""

from __future__ import annotations

import dataclasses
import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fpg_bench.game.batch import GameBatch
from fpg_bench.game.scenario import PAPER, STANDARD

from .playing import begin, wander

STEPS = 60


def actions_of(game_seed: int, steps: int = STEPS) -> tuple[np.ndarray, np.ndarray]:
    """Actions that depend on the game's seed alone, ``(steps, 1, 9)`` each."""
    return wander(game_seed % 17, steps)


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


def play_batch(scenario, seed: int, games: int, threads: int = 1) -> GameBatch:
    game_batch = begin(scenario, seed, games, threads=threads)
    each = [actions_of(seed + i) for i in range(games)] if games < 20 else None
    kinds = [actions_of(i) for i in range(17)]
    for k in range(STEPS):
        if each is not None:
            a, o = (np.concatenate([each[i][side][k] for i in range(games)]) for side in (0, 1))
        else:
            order = (seed + np.arange(games)) % 17
            a, o = (np.concatenate([kinds[i][side][k] for i in range(17)])[order] for side in (0, 1))
        game_batch.step(a, o)
    return game_batch


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("games", [7, 2048])
@pytest.mark.parametrize("scenario", [STANDARD, PAPER], ids=["standard", "paper"])
def test_a_game_of_a_batch_is_the_game_of_its_seed(scenario, games, threads):
    seed = 1000
    batch = play_batch(scenario, seed, games, threads)
    for game in {0, games // 3, games // 2, games - 1}:
        alone = play_batch(scenario, seed + game, 1)
        assert fingerprint(batch, game) == fingerprint(alone, 0)


@pytest.mark.parametrize("threads", [3])
def test_threads_change_nothing(threads):
    one, many = (play_batch(STANDARD, 5, 1500, count) for count in (1, threads))
    for game in range(1500):
        assert fingerprint(one, game) == fingerprint(many, game)


def test_the_order_of_the_games_changes_nothing():
    game_batch = GameBatch(STANDARD, 5)
    game_batch.reset(seeds=[9, 3, 7, 1, 5])
    for k in range(STEPS):
        game_batch.step(
            *(np.concatenate([actions_of(s)[side][k] for s in (9, 3, 7, 1, 5)]) for side in (0, 1))
        )
    for game, seed in enumerate((9, 3, 7, 1, 5)):
        assert fingerprint(game_batch, game) == fingerprint(play_batch(STANDARD, seed, 1), 0)


def summary() -> str:
    """What another process must find too."""
    digest = hashlib.sha256()
    for scenario in (STANDARD, PAPER):
        game_batch = play_batch(scenario, 77, 3)
        for game in range(3):
            digest.update(fingerprint(game_batch, game))
    return digest.hexdigest()


@pytest.mark.process
def test_another_process_plays_the_same_game():
    code = "from game.test_reproducible import summary; print(summary())"
    tests = Path(__file__).parents[1]
    found = subprocess.check_output([sys.executable, "-c", code], cwd=tests, text=True)
    assert found.split()[-1] == summary()


def test_what_was_played_before_leaves_no_trace():
    """A draw that is not used shifts nothing: a round begins alike whatever came before it."""
    scenario = dataclasses.replace(STANDARD, rounds_per_match=3)
    one, other = begin(scenario, 4), begin(scenario, 4)
    for k in range(50):
        one.step(*(x[k] for x in wander(1, 50)))
    for game_batch in (one, other):
        game_batch.reset()
        for k in range(STEPS):
            game_batch.step(*(x[k] for x in actions_of(4)))
    assert fingerprint(one, 0) == fingerprint(other, 0)


def test_chance_does_not_depend_on_the_actions():
    """Fading of each step is the same in a game of hops and in one without."""
    one, other = begin(PAPER, 3), begin(PAPER, 3)
    idle = np.full((1, 9), -1.0)
    for k in range(STEPS):
        one.step(idle, idle)
        a = actions_of(3)[0][k].copy()
        a[0, 1], a[0, 2], a[0, 0] = -1, -1, 1
        other.step(a, actions_of(3)[1][k])
        difference = one.games["clean_snr_db"][0] - other.games["clean_snr_db"][0]
        path_loss = 20 * np.log10(other.games["frequency_mhz"][0] / one.games["frequency_mhz"][0])
        assert difference == pytest.approx(path_loss, abs=1e-9)
