"""A policy under another name is known by what it does."""

import numpy as np
import pytest

from fpg_bench.leaderboard.likeness import alike, apart, trace
from fpg_bench.players.agent import OnnxPlayer, agent_folder
from tests.attacks.copies import copies
from tests.evaluation.zoo_making import policy
from tests.leaderboard.making import as_policy

SHIPPED = "ally-scripted/recurrent-ppo/seed_{}"


def shipped(seed):
    return (agent_folder(SHIPPED.format(seed)) / "policy.onnx").read_bytes()


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(("what", "data"), list(copies(shipped(0))))
def test_a_copy_of_somebody_elses_policy_is_named(what, data):
    other = trace(OnnxPlayer(shipped(0), {}), "ally", None, 5)
    (line,) = alike([as_policy(data, 0)], "ally", None, {"theirs": other})
    assert line.startswith("seed_0 plays as theirs does (0.0")


@pytest.mark.usefixtures("in_process")
def test_one_policy_that_poses_as_several_seeds_is_named():
    padded = [data for _, data in copies(policy(0))][:3]
    found = alike([as_policy(data, seed) for seed, data in enumerate(padded)], "ally", None, {})
    assert [line.partition(" does")[0] for line in found] == [
        "seed_1 plays as seed_0",
        "seed_2 plays as seed_0",
        "seed_2 plays as seed_1",
    ]


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("side", ["ally", "opponent"])
def test_trainings_of_their_own_are_not(side):
    policies = [as_policy(shipped(seed) if side == "ally" else policy(seed), seed) for seed in (0, 1, 2)]
    assert alike(policies, side, None, {}) == []


def test_the_rounds_are_others_each_time():
    player = OnnxPlayer(policy(0), {})
    one, same, other = (trace(player, "ally", None, seed) for seed in (1, 1, 2))
    assert (one.seen == same.seen).all()
    assert (one.seen != other.seen).any()
    assert apart(player, other) == 0
    assert np.isfinite(one.done).all()
