"""All environments keep one contract, and show the same games."""

from __future__ import annotations

from functools import partial

import gymnasium
import numpy as np
import pettingzoo
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

from fpg_bench import make_duel, make_sb3, supersuit_vec_env
from fpg_bench.common.errors import UserError
from fpg_bench.common.products import offered
from fpg_bench.envs.pettingzoo_env import parallel_env
from fpg_bench.game.batch import check_seeds
from fpg_bench.game.scenario import PRESETS, as_scenario, preset

from .contract import CHECKS, SEED, adapt, play
from .playing import ALLY, ALLY_POLICY, IDS, OPPONENT_POLICY, PLANNED, SHORT, STEPS, Tape, tape

GAMES = 3
BATCHED = {"batch": partial(gymnasium.make_vec, num_envs=GAMES), "sb3": partial(make_sb3, n_envs=GAMES)}
WATERFALL = {"observation": "waterfall", "history": 4}
BOTH_SIDES = {
    "sb3 of both sides": partial(make_sb3, "FPG/duel_v0", GAMES, scenario=SHORT),
    "duel": partial(make_duel, GAMES, scenario=SHORT),
    "pettingzoo": partial(parallel_env, scenario=SHORT),
}
ENVS = {
    **{f"single {name}": partial(gymnasium.make, name, scenario=SHORT) for name in IDS},
    **{f"{kind} {name}": partial(of, name, scenario=SHORT) for kind, of in BATCHED.items() for name in IDS},
    "single waterfall": partial(gymnasium.make, ALLY, scenario=SHORT, **WATERFALL),
    **{f"{kind} waterfall": partial(of, ALLY, scenario=SHORT, **WATERFALL) for kind, of in BATCHED.items()},
    **BOTH_SIDES,
    "duel with a planner": partial(make_duel, GAMES, scenario=SHORT, planner="random"),
}


@pytest.mark.parametrize("check", CHECKS)
@pytest.mark.parametrize("kind", ENVS)
def test_the_contract_holds(kind, check):
    CHECKS[check](ENVS[kind])


def shown_by(make, first=0, rounds=3):
    """Return the observations and rewards of all games, ``(N, ...)`` each, in single precision."""
    shown = play(adapt(make()), int(check_seeds(SEED, GAMES)[first]), rounds, first)
    return [np.asarray(part, np.float32) for part in shown]


def assert_game(batch, alone, game):
    """One game of a batch is the one that is played alone, to the bit."""
    for part, only in zip(batch, alone, strict=True):
        assert np.array_equal(part[game], only[0])


@pytest.mark.parametrize("kind", BATCHED)
@pytest.mark.parametrize("env_id", [*IDS, "waterfall"])
def test_game_i_of_a_batch_is_the_single_game_of_its_seed(env_id, kind):
    batch = shown_by(ENVS[f"{kind} {env_id}"])
    for game in range(GAMES):
        assert_game(batch, shown_by(ENVS[f"single {env_id}"], game), game)


def test_all_environments_of_both_sides_show_the_same_games():
    duel, sb3, pettingzoo = (
        shown_by(BOTH_SIDES[kind]) for kind in ("duel", "sb3 of both sides", "pettingzoo")
    )
    assert all(map(np.array_equal, duel, sb3))
    assert_game(duel, pettingzoo, 0)
    assert_game(duel, shown_by(BOTH_SIDES["pettingzoo"], 2), 2)


def duel_seeds(make, seed):
    """Return the seeds of all games that a seed opens."""
    adapter = adapt(make())
    adapter.reset(seed)
    return adapter.duel().batch.games["seed"].tolist()


def reseeded(seed):
    """Return games that PPO seeds anew, whatever they were made with."""
    env = PPO("MlpPolicy", make_sb3(ALLY, GAMES, seed=9, scenario=SHORT), device="cpu", seed=seed).env
    env.reset()
    return env.unwrapped.core.duel.batch.games["seed"].tolist()


def copied(seed):
    """Return the games of SuperSuit's copies."""
    env = supersuit_vec_env(GAMES, seed=seed, scenario=SHORT)
    env.reset()
    return [int(game.duel.batch.games["seed"][0]) for game in env.venv.games]


def of_teams(seed):
    env = make_sb3(TEAM, GAMES, seed=seed, side="ally", against="tone", scenario="link")
    env.reset()
    return env.core.teams.batch.games["seed"].tolist()


TEAM = "FPG/team_v0"  # a product's, which need not be there
DOORS = {
    **{kind: partial(duel_seeds, partial(of, ALLY, scenario=SHORT)) for kind, of in BATCHED.items()},
    **{kind: partial(duel_seeds, make) for kind, make in BOTH_SIDES.items()},
    "PPO(seed=)": reseeded,
    "SuperSuit": copied,
    **({"teams": of_teams} if TEAM in offered("game") else {}),
}


@pytest.mark.parametrize("kind", DOORS)
def test_neighbouring_seeds_share_no_game(kind):
    seeds = [DOORS[kind](seed) for seed in range(5)]
    assert [first for first, *_ in seeds] == [*range(5)]
    assert len({game for games in seeds for game in games}) == 5 * (1 if kind == "pettingzoo" else GAMES)


def leaves(info):
    """Yield all values within infos, with the names that lead to each."""
    if isinstance(info, dict | list | tuple):
        for name, value in info.items() if isinstance(info, dict) else enumerate(info):
            yield from ((f"{name}/{inner}", leaf) for inner, leaf in leaves(value))
    else:
        yield "", info


INFOS = {
    **{f"{kind} {name}": partial(of, name) for kind, of in BATCHED.items() for name in IDS},
    **{f"single {name}": partial(gymnasium.make, name) for name in IDS},
    "same step": partial(gymnasium.make_vec, ALLY, num_envs=GAMES, autoreset_mode="SameStep"),
    "choices": partial(gymnasium.make_vec, ALLY, num_envs=GAMES, actions="discrete"),
    "sb3 of both sides": partial(make_sb3, "FPG/duel_v0", GAMES),
    "pettingzoo": parallel_env,
    "pettingzoo by choices": partial(parallel_env, actions="multi-discrete"),
    "supersuit": partial(supersuit_vec_env, GAMES),
}
if TEAM in offered("game"):
    INFOS |= {
        "pettingzoo of teams": partial(parallel_env, game=TEAM),
        "sb3 of teams": partial(make_sb3, TEAM, GAMES, side="ally", against="tone"),
        "sb3 of jammers": partial(make_sb3, TEAM, GAMES, side="opponent", against="idle"),
    }


@pytest.mark.parametrize("kind", INFOS)
@pytest.mark.parametrize("scenario", PRESETS)
def test_infos_hold_numbers_arrays_of_numbers_and_texts_alone(scenario, kind):
    """Over the ends of two rounds, of which one hears no check and covers nothing."""
    if kind.endswith(("teams", "jammers")) and preset(scenario).snr_model != "link":
        pytest.skip("teams do not play it")
    played = as_scenario(scenario, steps_per_round=4, rounds_per_match=2, waypoints=4)
    env = INFOS[kind](scenario=played)
    ends = 0
    for _ in range(2):
        first = env.reset()
        told = [env.reset_infos if isinstance(env, VecEnv) else first[1]]
        for _ in range(4):
            *_, infos = env.step(resting(env))
            told.append(infos)
        for name, leaf in leaves(told):
            assert isinstance(leaf, str | int | float | np.ndarray | np.number), (name, leaf)
            if isinstance(leaf, np.ndarray) and not name.endswith("/final_obs/"):  # Gymnasium's own format
                assert leaf.dtype.kind in "bifu", (name, leaf)
            ends += "_return" in name
    assert ends


def resting(env):
    """Return actions of zeros, as an environment takes them."""
    if isinstance(env, pettingzoo.ParallelEnv):
        spaces = {agent: env.action_space(agent) for agent in env.agents}
        return {agent: np.zeros(space.shape, space.dtype) for agent, space in spaces.items()}
    space = env.action_space
    batch = (env.num_envs,) if isinstance(env, VecEnv) else ()
    return np.zeros((*batch, *space.shape), space.dtype)


@pytest.mark.parametrize("path", ["pursuit", "learned", ["circle", "learned"]])
@pytest.mark.parametrize("side", [0, 1])
def test_a_single_environment_shows_its_side_of_the_duel(side, path):
    """The other side is played by a player that acts alike in every round."""
    actions = [tape(1, STEPS, seed=number) for number in (0, 1)]
    name, other = ((ALLY_POLICY, "opponent"), (OPPONENT_POLICY, "ally"))[side]
    options = {"scenario": SHORT, "path": path}
    single = gymnasium.make(name, **options, **{other: Tape(actions[1 - side])})
    duel = make_duel(1, **options)
    seen, _ = single.reset(seed=7)
    duel.reset(seeds=7)
    for _ in range(3):
        assert np.array_equal(seen, duel.present()[side][0])
        for both in zip(*actions, strict=True):
            seen, reward, *_ = single.step(both[side][0])
            step = duel.step(*both)
            assert np.array_equal(seen, step[side][0])
            assert reward == step[2 + side][0]
        seen, _ = single.reset()
        duel.reset()


MISTAKES = [
    (make_duel, {"path": "waypoints"}, "path 'waypoints' needs a planner"),
    (make_duel, {"path": "circle", "planner": "circle"}, "nothing to plan where the path is 'circle'"),
    (make_duel, {"games": 0}, "above 0, got 0"),
    (make_duel, {"games": 1, "actions": {"opponet": "discrete"}}, "did you mean 'opponent'"),
    (parallel_env, {"render_mode": "ansi"}, "expected None or 'rgb_array', got 'ansi'"),
    (supersuit_vec_env, {"n_envs": 1.5}, "n_envs: expected a whole number above 0"),
    (supersuit_vec_env, {"n_envs": 2, "seed": -1}, "seed: expected"),
    (make_sb3, {"game": "FPG/duel_v0", "n_envs": 1, "paht": "circle"}, "'paht'; did you mean 'path'"),
    (make_sb3, {"game": PLANNED, "n_envs": 0}, "above 0, got 0"),
    (make_sb3, {"game": PLANNED, "seed": "3"}, "seed: expected"),
    (make_sb3, {"game": ALLY, "render_mode": "human"}, "rgb_array"),
    (gymnasium.make_vec, {"id": ALLY, "num_envs": 2.5}, "expected a whole number above 0"),
    (gymnasium.make_vec, {"id": ALLY, "render_mode": "rgb_array"}, "a batch is not rendered"),
    (gymnasium.make_vec, {"id": ALLY, "autoreset_mode": "Disabled"}, "expected 'NextStep' or 'SameStep'"),
]


@pytest.mark.parametrize(
    ("make", "options", "message"), MISTAKES, ids=lambda x: getattr(x, "__name__", str(x))
)
def test_what_cannot_be_made_is_refused(make, options, message):
    with pytest.raises(UserError, match=message):
        make(**options)
