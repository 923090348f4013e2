"""The batched Gymnasium environment: NEXT_STEP autoreset, the same games as single ones, staggering."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import NormalizeObservation, RecordEpisodeStatistics

from fpg_bench.common.errors import UserError

from .playing import ALLY, ALLY_POLICY, IDS, REST, SHORT, STEPS, same, single_game, tape

GAMES = 3


def make(env_id=ALLY, games=GAMES, **options):
    return gymnasium.make_vec(env_id, num_envs=games, **{"scenario": SHORT, **options})


def batched_games(env_id, seed, actions, **options):
    """What each game of a batch shows, as ``single_game`` gives it."""
    games = actions.shape[1]
    env = make(env_id, games, **options)
    observations, _ = env.reset(seed=seed)
    shown = [[(observation, None)] for observation in observations]
    for k, action in enumerate(actions):
        observations, rewards, _, truncated, _ = env.step(action)
        for game in range(games):
            shown[game].append((observations[game], rewards[game]))
        if truncated.all():
            observations = env.step(actions[(k + 7) % len(actions)])[0]
            for game in range(games):
                shown[game].append((observations[game], None))
    return shown


@pytest.mark.parametrize("env_id", IDS)
def test_game_i_of_a_batch_seeded_s_is_the_single_game_seeded_s_plus_i(env_id):
    actions = tape(GAMES)
    batch = batched_games(env_id, 20, actions)
    for game in range(GAMES):
        assert same(batch[game], single_game(env_id, 20 + game, actions[:, game]))


def test_the_autoreset_mode_is_stated_and_the_spaces_are_batched():
    env = make()
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert env.observation_space.shape == (GAMES, 15)
    assert env.action_space.shape == (GAMES, 9)
    assert env.reset(seed=0)[0] in env.observation_space


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, "SameStep"])
def test_same_step_begins_the_next_round_as_gymnasiums_own_batch_does(mode):
    own = {"autoreset_mode": AutoresetMode.SAME_STEP}
    theirs = gymnasium.make_vec(ALLY, GAMES, vectorization_mode="sync", vector_kwargs=own, scenario=SHORT)
    ours = make(autoreset_mode=mode)
    assert ours.metadata["autoreset_mode"] is ours.autoreset_mode is AutoresetMode.SAME_STEP
    assert make().metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert np.array_equal(theirs.reset(seed=3)[0], ours.reset(seed=3)[0])
    for action in tape(GAMES, 2 * STEPS):
        *there, their_infos = theirs.step(action)
        *here, our_infos = ours.step(action)
        assert all(map(np.array_equal, there, here))
        assert ("final_obs" in our_infos) == here[3].any()
        for game in np.flatnonzero(here[3]):
            assert np.array_equal(our_infos["final_obs"][game], their_infos["final_obs"][game])
            for name, values in our_infos["final_info"]["measures"].items():
                assert np.array_equal(values[game], their_infos["final_info"]["measures"][name][game])


def test_another_autoreset_mode_is_refused():
    with pytest.raises(UserError, match="expected 'NextStep' or 'SameStep', got 'Disabled'"):
        make(autoreset_mode="Disabled")


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


def drawn(games, seed=0, rounds=1, **options):
    """Which of the other side's players and paths each game's rounds drew, ``(rounds, games)`` each."""
    env = make(ALLY_POLICY, games, **options)
    env.reset(seed=seed)
    players, paths = [], []
    for _ in range(rounds):
        core = env.unwrapped.core
        players.append(core._runner.choice.copy())
        paths.append(core.duel.batch.games["path"].copy())
        env.reset()
    return np.array(players), np.array(paths)


def test_players_and_paths_of_a_list_are_drawn_per_round_from_the_games_own_stream():
    options = {"opponent": ["tone", "comb"], "path": ["circle", "pursuit"]}
    players, paths = drawn(16, rounds=4, **options)
    assert set(players.ravel()) == {0, 1}
    assert len(set(paths.ravel())) == 2
    assert any(len(set(column)) == 2 for column in players.T), "rounds of one game never differ"
    again = drawn(16, rounds=4, **options)
    assert np.array_equal(players, again[0])
    assert np.array_equal(paths, again[1])
    alone = drawn(1, seed=5, rounds=4, **options)
    assert np.array_equal(players[:, 5:6], alone[0])
    assert np.array_equal(paths[:, 5:6], alone[1])


def test_gymnasiums_vector_wrappers_take_it():
    env = RecordEpisodeStatistics(NormalizeObservation(make()))
    env.reset(seed=0)
    for action in tape(GAMES, STEPS):
        infos = env.step(action)[4]
    assert infos["episode"]["l"].tolist() == [STEPS] * GAMES
    assert infos["episode"]["r"] == pytest.approx(infos["measures"]["ally_return"], rel=1e-5)


# Bad input


@pytest.mark.parametrize("seed", [[1, 2], [1, 2, "3"], [1, 2, None], 2**63 - 1])
def test_a_seed_that_cannot_be_is_refused(seed):
    with pytest.raises(UserError, match="seed: expected"):
        make().reset(seed=seed)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_envs": 0}, "expected a whole number above 0, got 0"),
        ({"num_envs": 2.5}, "expected a whole number above 0"),
        ({"render_mode": "rgb_array"}, "a batch is not rendered"),
    ],
)
def test_a_batch_that_cannot_be_is_refused(options, message):
    with pytest.raises(UserError, match=message):
        gymnasium.make_vec(ALLY, **options)
