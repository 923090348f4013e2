"""Bad actions are refused whole; good ones are clipped and left as they were."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from fpg_bench.game.batch import ActionError
from fpg_bench.game.scenario import STANDARD

from .playing import begin, wander


def everything(batch) -> list[np.ndarray]:
    names = ("games", "tallies", "histograms", "segments", "ally_observations", "opponent_observations")
    return [getattr(batch, name).copy() for name in names]


def assert_untouched(batch, before):
    for was, now in zip(before, everything(batch), strict=True):
        assert (was == now).all()


@pytest.mark.parametrize("side", ["ally", "opponent"])
@pytest.mark.parametrize(("value", "word"), [(np.nan, "nan"), (np.inf, "inf"), (-np.inf, "-inf")])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_an_unusable_number_names_side_game_and_index(side, value, word, dtype):
    batch = begin(STANDARD, games=5)
    actions = {"ally": np.zeros((5, 9), dtype), "opponent": np.zeros((5, 9), dtype)}
    batch.step(*actions.values())
    before = everything(batch)
    actions[side][3, 6:8] = value, -value  # infinities that cancel
    with pytest.raises(ActionError, match=rf"^{side} action of game 3: index 6 is {word}$"):
        batch.step(*actions.values())
    assert_untouched(batch, before)
    actions[side][3, 6:8] = 0
    batch.step(*actions.values())


@pytest.mark.parametrize("side", ["ally", "opponent"])
@pytest.mark.parametrize(
    ("bad", "found"),
    [
        (np.zeros((2, 8)), r"float64 \(2, 8\)"),
        (np.zeros((2, 9), int), r"int64 \(2, 9\)"),
        ([[0.0] * 9] * 2, "list"),
        (None, "NoneType"),
    ],
)
def test_another_shape_or_kind_is_refused(side, bad, found):
    batch = begin(STANDARD, games=2)
    actions = {"ally": np.zeros((2, 9)), "opponent": np.zeros((2, 9))}
    before = everything(batch)
    actions[side] = bad
    with pytest.raises(
        ActionError, match=rf"{side} actions: expected a float array of shape \(2, 9\), got {found}"
    ):
        batch.step(*actions.values())
    assert_untouched(batch, before)


def test_actions_are_clipped_and_the_callers_arrays_left_alone():
    one, other = begin(STANDARD, games=3), begin(STANDARD, games=3)
    rng = np.random.default_rng(0)
    for _ in range(50):
        actions = rng.normal(0, 3, (2, 3, 9)).astype(np.float32)
        kept = actions.copy()
        one.step(*actions)
        assert (actions == kept).all()
        other.step(*np.clip(actions, -1, 1))
    assert_untouched(one, everything(other))


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64, ">f4"])
def test_how_an_array_lies_in_memory_does_not_matter(order, dtype):
    plain, other = begin(STANDARD, games=4), begin(STANDARD, games=4)
    for a, o in zip(*(x.astype(np.float32) for x in wander(2, 30, 4)), strict=True):
        plain.step(a, o)
        other.step(np.asarray(a, dtype, order=order), np.asarray(o, dtype, order=order))
    assert_untouched(plain, everything(other))


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda batch: pickle.loads(pickle.dumps(batch))])
def test_a_copy_of_a_batch_plays_on_by_itself(copied):
    batch = begin(STANDARD, games=1200, threads=2)
    first, *rest = zip(*wander(1, 20, 1200), strict=True)
    batch.step(*first)
    twin, before = copied(batch), everything(batch)
    for actions in rest:
        twin.step(*actions)
    assert_untouched(batch, before)
    for actions in rest:
        batch.step(*actions)
    assert_untouched(batch, everything(twin))
