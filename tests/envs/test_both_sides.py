"""Both sides as one player: the same game as a duel, in SB3's form."""

import numpy as np
import pytest

from fpg_bench import UserError, make_duel
from fpg_bench.envs.sb3_vec_env import make_sb3_duel


def test_it_is_the_same_game_as_a_duel():
    ours, theirs = make_sb3_duel(3, seed=5), make_duel(3)
    theirs.reset(seeds=5)
    rng = np.random.default_rng(0)
    seen, rounds = ours.reset(), 0
    for step in range(301):
        found = theirs.present()
        assert np.array_equal(seen, np.hstack([found.ally_observations, found.opponent_observations]))
        actions = rng.uniform(-1, 1, (3, 18)).astype(np.float32)
        seen, rewards, dones, infos = ours.step(actions)
        found = theirs.step(actions[:, :9], actions[:, 9:])
        assert rewards.shape == (3, 2)
        assert rewards == pytest.approx(np.stack([found.ally_rewards, found.opponent_rewards], 1), rel=1e-6)
        assert np.array_equal(dones, found.truncated)
        if dones.any():
            assert step == 299
            last = np.hstack([found.ally_observations, found.opponent_observations])
            for game, info in enumerate(infos):
                assert info["TimeLimit.truncated"]
                assert np.array_equal(info["terminal_observation"], last[game])
                assert info["episode"]["r"] == info["episode"]["ally_return"]
            theirs.reset()
            rounds += 1
    assert rounds == 1


def test_it_says_what_it_does_not_know():
    with pytest.raises(UserError, match="unexpected keyword argument 'paht'; did you mean 'path'"):
        make_sb3_duel(1, paht="circle")
