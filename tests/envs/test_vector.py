"""The batched Gymnasium environment: NEXT_STEP autoreset, the same games as single ones, staggering."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from fpg_bench.game.batch import check_seeds

from .playing import ALLY, ALLY_POLICY, REST, SHORT, STEPS, tape

GAMES = 3


def make(env_id=ALLY, games=GAMES, **options):
    return gymnasium.make_vec(env_id, num_envs=games, **{"scenario": SHORT, **options})


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, "SameStep"])
def test_same_step_begins_the_next_round_as_gymnasiums_own_batch_does(mode):
    own = {"autoreset_mode": AutoresetMode.SAME_STEP}
    theirs = gymnasium.make_vec(ALLY, GAMES, vectorization_mode="sync", vector_kwargs=own, scenario=SHORT)
    ours = make(autoreset_mode=mode)
    assert ours.metadata["autoreset_mode"] is ours.autoreset_mode is AutoresetMode.SAME_STEP
    assert make().metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    seeds = check_seeds(3, GAMES).tolist()
    assert np.array_equal(theirs.reset(seed=seeds)[0], ours.reset(seed=3)[0])
    for action in tape(GAMES, 2 * STEPS):
        *there, their_infos = theirs.step(action)
        *here, our_infos = ours.step(action)
        assert all(map(np.array_equal, there, here))
        assert ("final_obs" in our_infos) == here[3].any()
        for game in np.flatnonzero(here[3]):
            assert np.array_equal(our_infos["final_obs"][game], their_infos["final_obs"][game])
            for name, values in our_infos["final_info"]["measures"].items():
                assert np.array_equal(values[game], their_infos["final_info"]["measures"][name][game])


def test_the_step_after_a_rounds_end_ignores_the_action_and_gives_no_reward():
    outcomes = []
    for action in (np.full((GAMES, 9), -1, np.float32), np.full((GAMES, 9), 1, np.float32)):
        env = make()
        env.reset(seed=1)
        for k in range(STEPS):
            _, _, terminated, truncated, infos = env.step(np.tile(REST, (GAMES, 1)))
            assert not terminated.any()
            assert truncated.all() == truncated.any() == ("measures" in infos) == (k + 1 == STEPS)
        assert infos["measures"]["outage"].shape == (GAMES,)
        observations, rewards, _, truncated, infos = env.step(action)
        assert not rewards.any()
        assert not truncated.any()
        assert infos == {}
        outcomes.append(observations)
    assert np.array_equal(*outcomes)


def test_a_staggered_batch_mixes_phases_by_truncations_of_its_first_rounds():
    env = make(games=4, stagger=True)
    env.reset(seed=0)
    ends = np.zeros((3 * STEPS, 4), bool)
    for k in range(len(ends)):
        _, _, terminated, ends[k], _ = env.step(np.zeros((4, 9), np.float32))
        assert not terminated.any()
    first = [int(np.flatnonzero(ends[:, game])[0]) + 1 for game in range(4)]
    assert first == [STEPS, STEPS * 3 // 4, STEPS // 2, STEPS // 4]
    # Later rounds are whole ones, each after one step for the reset
    assert all(
        np.diff(np.flatnonzero(ends[:, game])).tolist() in ([STEPS + 1], [STEPS + 1] * 2) for game in range(4)
    )
    env.reset(seed=0)
    for _ in range(STEPS - 1):
        assert not env.step(np.zeros((4, 9), np.float32))[3].any()


def test_rounds_can_be_begun_in_some_games_alone():
    env = make()
    before = env.reset(seed=2)[0]
    moved = env.step(np.zeros((GAMES, 9), np.float32))[0]
    mask = np.array([False, True, False])
    after = env.reset(options={"reset_mask": mask, "new_match": True})[0]
    assert np.array_equal(after[~mask], moved[~mask])
    assert not np.array_equal(after[1], before[1])


def test_players_and_paths_of_a_list_are_drawn_per_round_from_the_games_own_stream():
    def drawn(games, seed=0):
        """The other side's players and paths that each game's rounds drew, ``(rounds, 2, games)``."""
        env = make(ALLY_POLICY, games, opponent=["tone", "comb"], path=["circle", "pursuit"])
        core, choices = env.unwrapped.core, []
        for number in range(4):
            env.reset(seed=None if number else seed)
            choices.append([core._runner.choice.copy(), core.duel.batch.games["path"].copy()])
        return np.array(choices)

    choices = drawn(16)
    assert all(len(set(choices[:, kind].ravel())) == 2 for kind in (0, 1))
    assert (choices[:, 0] != choices[0, 0]).any(), "rounds of one game never differ"
    assert np.array_equal(choices, drawn(16))
    assert np.array_equal(choices[:, :, 5:6], drawn(1, seed=int(check_seeds(0, 16)[5])))
