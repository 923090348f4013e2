"""A policy under another name is known by what it does."""

import numpy as np
import pytest

from fpg_bench.leaderboard import likeness
from fpg_bench.leaderboard.check import load_submission
from fpg_bench.leaderboard.likeness import alike, apart, traces
from fpg_bench.leaderboard.verify import verify
from fpg_bench.players.agent import OnnxPlayer, agent_folder, load_agent
from tests.attacks.copies import copies
from tests.leaderboard.entering import enter
from tests.leaderboard.making import as_policy, write_seed, write_submission
from tests.zoo.making import policy

SHIPPED = "ally-scripted/recurrent-ppo/seed_{}"


def shipped(seed):
    return (agent_folder(SHIPPED.format(seed)) / "policy.onnx").read_bytes()


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(("what", "data"), list(copies(shipped(0))))
def test_a_copy_of_somebody_elses_policy_is_named(what, data):
    (other,) = traces([OnnxPlayer(shipped(0), {})], "ally", None, 5)
    (line,) = alike([as_policy(data, 0)], "ally", None, {"theirs": other}, 5)
    assert line.startswith("seed_0 plays as theirs does (0.0")


@pytest.mark.usefixtures("in_process")
def test_one_policy_that_poses_as_several_seeds_is_named():
    padded = [data for _, data in copies(policy(0))][:3]
    found = alike([as_policy(data, seed) for seed, data in enumerate(padded)], "ally", None, {}, 5)
    assert [line.partition(" does")[0] for line in found] == [
        "seed_1 plays as seed_0",
        "seed_2 plays as seed_0",
        "seed_2 plays as seed_1",
    ]


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("side", ["ally", "opponent"])
def test_trainings_of_their_own_are_not(side):
    policies = [as_policy(shipped(seed) if side == "ally" else policy(seed), seed) for seed in (0, 1, 2)]
    assert alike(policies, side, None, {}, 5) == []


@pytest.mark.slow
def test_a_new_entry_is_compared_with_the_whole_board(board, in_process):
    enter(board, "ally", "first", seeds=(0, 1))
    enter(board, "ally", "second", seeds=(1, 7))
    lines = {verdict.name: verdict.line for verdict in verify(board, say=lambda line: None)}
    assert "; seed_1 plays as second/seed_1 does (0.000 apart)" in lines["ally/first"]
    assert "; seed_1 plays as first/seed_1 does (0.000 apart)" in lines["ally/second"]
    again = {verdict.name: verdict.line for verdict in verify(board, say=lambda line: None)}
    assert "plays as" not in again["ally/first"]


def test_a_copy_of_what_the_package_ships_is_named(tmp_path, in_process, monkeypatch):
    monkeypatch.setattr(
        likeness, "_shipped", lambda side: ((name, load_agent(name)) for name in map(SHIPPED.format, (0, 1)))
    )
    folder = write_submission(tmp_path / "mine", seeds=())
    for seed in (0, 1):
        write_seed(folder / f"seed_{seed}", seed, dict(copies(shipped(seed)))["weights 0.01 off"])
    found = likeness.told_apart(load_submission(folder))
    assert [line.partition(" does")[0] for line in found] == [
        f"seed_{seed} plays as {SHIPPED.format(seed)}" for seed in (0, 1)
    ]


def test_the_rounds_are_others_each_time():
    player = OnnxPlayer(policy(0), {})
    (one, same), (other,) = (traces([player] * count, "ally", None, seed) for count, seed in ((2, 1), (1, 2)))
    assert (one.seen == same.seen).all()
    assert (one.seen != other.seen).any()
    assert (apart(player, [one, other]) == 0).all()
    assert np.isfinite(one.done).all()


@pytest.mark.parametrize("side", ["ally", "opponent"])
def test_many_are_traced_and_compared_as_one_would_be(side):
    players = [OnnxPlayer(shipped(seed) if side == "ally" else policy(seed), {}) for seed in range(3)]
    together = traces(players, side, None, 5)
    alone = [traces([player], side, None, 5)[0] for player in players]
    for one, other in zip(together, alone, strict=True):
        assert (one.seen == other.seen).all()
        assert (one.done == other.done).all()
    distances = [apart(player, together).tolist() for player in players]
    assert distances == [[float(apart(player, [other])[0]) for other in alone] for player in players]
    assert [row.index(0) for row in distances] == [0, 1, 2]


def test_more_than_are_asked_at_once_are_compared(monkeypatch):
    player, counts = OnnxPlayer(policy(0), {}), set()
    one, other = traces([player, OnnxPlayer(policy(1), {})], "ally", None, 5)
    real = player.predict
    monkeypatch.setattr(player, "predict", lambda seen, *a: counts.add(len(seen)) or real(seen, *a))
    found = apart(player, [other] * 20 + [one] + [other] * 20)
    assert np.flatnonzero(found == 0).tolist() == [20]
    assert len(set(found.tolist())) == 2
    assert max(counts) == 6 * likeness._BLOCK < 6 * 41
    assert apart(player, []).shape == (0,)
    assert traces([], "ally", None, 5) == []
