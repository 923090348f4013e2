"""Discrete actions: what each choice does in the game, the same games in every environment, bad choices."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.utils import get_action_masks, is_masking_supported
from stable_baselines3.common.env_checker import check_env as check_env_sb3
from stable_baselines3.common.vec_env import DummyVecEnv

from fpg_bench import make_duel, make_sb3
from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import ACTION_MODES, ALLY_MODES, action_modes, find_env, id_with
from fpg_bench.game.batch import ActionError, check_seeds
from fpg_bench.game.choices import Choices
from fpg_bench.game.scenario import STANDARD, as_scenario, preset
from fpg_bench.players.player import SIDES
from fpg_bench.players.registry import as_player
from fpg_bench.players.scripted import Scripted, player_noise

from .playing import ALLY, IDS, OPPONENT, SHORT

MODES = tuple(ACTION_MODES)[1:]
BOTH = action_modes("opponent")[1:]
LEARNED = as_scenario(SHORT, opponent_path="learned")


def played(side, mode, choice, scenario=STANDARD, seed=3):
    """The game after one step in which a side makes a choice; the other side is idle, or jams with a tone."""
    duel = make_duel(1, scenario=scenario, actions={side: mode})
    duel.reset(seeds=seed)
    actions = {"ally": np.full((1, 9), -1, np.float32), "opponent": np.zeros((1, 9), np.float32)}
    duel.step(*(actions | {side: np.array([choice])}).values())
    return duel.batch.games[0]


@pytest.mark.parametrize("mode", MODES)
def test_each_choice_of_the_ally_does_what_its_name_says(mode):
    for choice, name in enumerate(Choices("ally", mode, STANDARD).lists[0].names):
        game = played("ally", mode, [choice, 0, 0] if mode == "multi-discrete" else choice)
        assert game["hopped"] == name.startswith("hop")
        assert (game["spreading_s"] > 0) == name.endswith(", spread")
        if "to point" in name:
            point = int(name.split("point ")[1].split(",")[0])
            assert game["frequency_mhz"] == pytest.approx(150 + point * 100 / 14, abs=1e-4)


def test_spreading_and_speed_are_lists_of_their_own():
    games = [played("ally", "multi-discrete", [0, spread, speed]) for spread in (0, 1) for speed in (0, 1, 2)]
    assert [game["spreading_s"] for game in games] == [0, 0, 0, 1, 1, 1]
    start = games[0]["control_points"][0]
    moved = [np.linalg.norm(game["ally_position"] - start) for game in games[:3]]
    assert moved == pytest.approx([10, 7.5, 5], rel=0.01)  # along a curve


def test_each_choice_of_the_opponent_does_what_its_name_says():
    known = make_duel(1)
    known.reset(seeds=3)
    known_mhz = float(known.batch.games["known_mhz"][0])
    names = Choices("opponent", "discrete", STANDARD).lists[0].names
    assert len(set(names)) == len(names) == 50
    for choice, name in enumerate(names):
        game = played("opponent", "discrete", choice)
        kind, place = name.split(", ")
        assert ("tone", "narrowband", "broadband", "comb")[game["jamming_type"]] == kind
        if place.startswith("point"):
            expected = 150 + int(place.split()[1]) * 100 / 14
        else:
            offset = int(place.split()[2]) if place != "known point" else 0
            expected = np.clip(known_mhz + offset * 100 / 14, 150, 250)
        assert game["jamming_mhz"] == pytest.approx(expected, abs=1e-4)


def test_an_opponent_that_flies_itself_flies_at_the_ally_as_the_scripts_do():
    seen = np.random.default_rng(0).uniform(-1, 1, (200, 15)).astype(np.float32)
    seen[:5, 3:6] *= 0.05  # within ten metres
    script = Scripted("opponent", "tone", LEARNED).predict(seen)[0]
    choices = Choices("opponent", "discrete", LEARNED)
    tone = choices.lists[0].names.index("tone, known point, at the ally")
    assert np.abs(choices.decode(np.full(200, tone), seen) - script)[:, 6:].max() < 1e-6
    hold = choices.lists[0].names.index("tone, known point, hold")
    assert not choices.decode(np.full(200, hold), seen)[:, 6:].any()
    many = Choices("opponent", "multi-discrete", LEARNED)
    rows = np.array([[0, 2, way] for way in range(8)])
    assert many.decode(rows, seen[:8])[2:, 6:].tolist() == [*np.eye(3).tolist(), *(-np.eye(3)).tolist()]


@pytest.mark.parametrize(
    ("side", "mode"), [(side, mode) for side in SIDES for mode in action_modes(side)[1:]]
)
def test_the_choice_nearest_to_an_action_is_the_one_that_stands_for_it(side, mode):
    choices, rng = Choices(side, mode, LEARNED), np.random.default_rng(0)
    seen = rng.uniform(-1, 1, (300, 15)).astype(np.float32)
    columns = [rng.integers(0, size, 300) for size in choices.sizes]
    chosen = np.stack(columns, axis=1) if mode == "multi-discrete" else columns[0]
    noise = np.random.default_rng(1).normal(size=(300, 1)).astype(np.float32)
    actions = choices.decode(chosen, seen, noise=noise)
    found = choices.encode(actions + rng.uniform(-0.02, 0.02, actions.shape), seen)
    assert np.array_equal(choices.decode(found, seen, noise=noise), actions)


def test_a_forbidden_choice_is_nearest_to_nothing():
    choices = Choices("opponent", "discrete", as_scenario(SHORT, jamming_types=("tone",)))
    seen = np.zeros((1, 15), np.float32)
    broadband = np.array([[-1, -1, 1, -1, 0, -1, 0, 0, 0]])
    assert choices.lists[0].names[choices.encode(broadband, seen)[0]] == "tone, known point"


def test_the_ally_has_two_speeds_where_flying_costs():
    names = Choices("ally", "discrete", preset("link")).lists[0].names
    assert len(names) == 38
    assert [name.split(", ")[-1] for name in names] == ["full speed"] * 19 + ["mean speed"] * 19


def test_what_the_scenario_forbids_is_masked_and_refused_by_name():
    scenario = as_scenario(SHORT, knowledge="none", jamming_types=("tone", "comb"))
    ally, opponent = (Choices(side, "discrete", scenario) for side in ("ally", "opponent"))
    forbidden = np.array(ally.lists[0].names)[~ally.mask]
    assert forbidden.tolist() == ["hop by the knowledge base, unspread", "hop by the knowledge base, spread"]
    assert opponent.mask.sum() == 10
    env = gymnasium.make("FPG/OpponentVsScriptedDiscrete-v0", scenario=scenario)
    _, info = env.reset(seed=0)
    assert np.array_equal(info["action_mask"], opponent.mask)
    narrowband = opponent.lists[0].names.index("narrowband, known point")
    with pytest.raises(ActionError, match=r"narrowband, known point\) is forbidden by the scenario"):
        env.step(narrowband)


def test_random_hops_reach_every_point_equally_often():
    choices = Choices("ally", "uniform-hop", STANDARD)
    assert choices.lists[0].names[2] == "hop to a random point, unspread"
    keys, steps = np.arange(30_000, dtype=np.uint64), np.zeros(30_000, np.int64)
    chosen, seen = np.full(30_000, 2), np.zeros((30_000, 15), np.float32)
    actions = choices.decode(chosen, seen, noise=player_noise(keys, steps))
    points, counts = np.unique(actions[:, 3], return_counts=True)
    assert np.array_equal(points, np.linspace(-1, 1, 15).astype(np.float32))
    assert np.square(counts - 2000).sum() / 2000 < 36.1  # chi-squared, 14 degrees of freedom, 0.1 %
    with pytest.raises(ActionError, match="draws points by noise"):
        choices.decode(chosen, seen)


@pytest.mark.parametrize("mode", ALLY_MODES)
def test_random_hops_depend_on_the_round_alone(mode):
    last = len(Choices("ally", mode, SHORT).lists[0]) - 1
    third = int(check_seeds(7, 4)[2])
    alone, batch = (make_sb3(ALLY, count, seed=seed, actions=mode) for count, seed in ((1, third), (4, 7)))
    alone.reset(), batch.reset()
    seen = []
    for _ in range(20):
        one, many = alone.step(np.array([last]))[0], batch.step(np.full(4, last))[0]
        assert np.array_equal(one[0], many[2])
        seen.append(many[:, 6])
    assert len(np.unique(seen)) > 10
    assert not np.array_equal(*np.array(seen).T[:2])


def test_the_named_choices_keep_their_numbers_where_random_hops_are_added():
    for scenario in (STANDARD, preset("link")):
        old, new = (Choices("ally", mode, scenario).lists[0] for mode in ("discrete", "discrete-uniform"))
        assert new.names[: len(old)] == old.names
        assert np.array_equal(new.rows[: len(old)], old.rows)
        assert all("random point" in name for name in new.names[len(old) :])
        assert not any("point " in name for name in Choices("ally", "uniform-hop", scenario).lists[0].names)


def test_a_script_is_imitated_by_the_nearest_choice():
    seen = np.zeros((3, 15), np.float32)
    actions = np.array(
        [[1, -1, 1, 0.3, -1, 0, 0, 0, 0], [1, 1, 1, 0, 1, 0, 0, 0, 0], [-1, 1, 1, 0, -1, 0, 0, 0, 0]]
    )
    for mode, expected in (
        (
            "discrete-uniform",
            ["hop to point 9, unspread", "hop by the knowledge base, spread", "stay, spread"],
        ),
        ("uniform-hop", ["hop to a random point, unspread", "hop to a random point, spread", "stay, spread"]),
    ):
        choices = Choices("ally", mode, STANDARD)
        assert [choices.lists[0].names[k] for k in choices.encode(actions, seen)] == expected


def test_the_opponent_has_no_random_hops():
    with pytest.raises(UserError, match="actions of the opponent"):
        make_sb3(OPPONENT, 2, actions="uniform-hop")
    with pytest.raises(UserError, match="unknown id"):
        find_env("FPG/OpponentVsScriptedUniformHop-v0")


@pytest.mark.parametrize("mode", BOTH)
def test_maskable_ppo_finds_the_masks(mode):
    scenario = as_scenario(SHORT, jamming_types=("tone",))
    games = make_sb3(OPPONENT, 3, seed=0, scenario=scenario, actions=mode)
    single = DummyVecEnv([lambda: gymnasium.make(id_with(OPPONENT, mode), scenario=scenario)])
    for env, count in ((games, 3), (single, 1)):
        assert is_masking_supported(env)
        masks = get_action_masks(env)
        assert masks.shape[0] == count
        assert not masks.all()
    with pytest.raises(UserError, match="actions='discrete'"):
        make_sb3(OPPONENT, 3).env_method("action_masks")


def test_a_model_of_choices_is_a_player_that_keeps_to_what_is_allowed():
    scenario = as_scenario(SHORT, jamming_types=("tone", "comb"))
    games = make_sb3(OPPONENT, 4, seed=0, scenario=scenario, actions="discrete")
    player = as_player(MaskablePPO("MlpPolicy", games, n_steps=8, batch_size=8), "opponent", scenario)
    seen = np.random.default_rng(0).uniform(-1, 1, (300, 15)).astype(np.float32)
    assert set(player.predict(seen)[0][:, :4].argmax(1)) <= {0, 3}
    with pytest.raises(UserError, match="chooses from"):
        as_player(player.model, "ally", scenario)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("env_id", "mode"),
    [
        *((env_id, "continuous") for env_id in IDS),
        *((ALLY, mode) for mode in MODES),
        *((OPPONENT, mode) for mode in BOTH),
    ],
)
def test_the_checkers_find_nothing_to_warn_of(env_id, mode):
    env = gymnasium.make(id_with(env_id, mode)).unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=(env_id, mode) != (ALLY, "continuous"))
        check_env_sb3(env)


@pytest.mark.parametrize(
    ("env_id", "path", "mode"),
    [
        *((ALLY, "pursuit", mode) for mode in MODES),
        *((OPPONENT, path, mode) for path in ("pursuit", "learned") for mode in BOTH),
    ],
)
def test_every_environment_plays_the_same_game_bit_for_bit(env_id, path, mode):
    """A batch, a single game, SB3's environment and the floats that the choices stand for."""
    options = {"scenario": SHORT, "path": path}
    batch = gymnasium.make_vec(id_with(env_id, mode), num_envs=3, **options)
    sb3 = make_sb3(env_id, 3, seed=7, actions=mode, **options)
    floats = make_sb3(env_id, 3, seed=7, **options)
    single = gymnasium.make(env_id, actions=mode, **options)
    assert single.action_space == sb3.action_space == batch.single_action_space
    seen, infos = batch.reset(seed=7)
    assert infos["action_mask"].shape == (3, *sb3.core.choices.mask.shape)
    first, *_ = (sb3.reset(), floats.reset())
    assert np.array_equal(seen, first)
    alone, _ = single.reset(seed=int(check_seeds(7, 3)[2]))
    batch.action_space.seed(0)
    for _ in range(SHORT.steps_per_round - 1):
        actions = batch.action_space.sample()
        rows = floats.core.duel.noise(floats.core.side)
        rows = sb3.core.choices.decode(actions, floats.core.observations, noise=rows)
        assert np.array_equal(alone, seen[2])
        seen, rewards, *_ = batch.step(actions)
        others = [sb3.step(actions), floats.step(rows)]
        alone, reward, *_ = single.step(actions[2])
        assert reward == rewards[2]
        for observations, given, *_ in others:
            assert np.array_equal(observations, seen)
            assert np.array_equal(given, rewards.astype(np.float32))


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        (19, r"ally: choice of game 0: 19 is outside \[0, 18\]"),
        (-1, r"-1 is outside \[0, 18\]"),
        (1.0, "expected a whole number, got float"),
        (None, "expected a whole number, got NoneType"),
        ([1, 2], r"got int64 \(1, 2\)"),
    ],
)
def test_a_choice_that_cannot_be_made_is_refused(choice, message):
    env = gymnasium.make("FPG/AllyVsScriptedDiscrete-v0", disable_env_checker=True)
    env.reset(seed=0)
    with pytest.raises(ActionError, match=message):
        env.unwrapped.step(choice)
