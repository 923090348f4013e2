"""All environments keep one contract, and show the same games."""

from __future__ import annotations

from functools import partial

import gymnasium
import numpy as np
import pytest

from fpg_bench import make_duel, make_sb3, supersuit_vec_env
from fpg_bench.common.errors import UserError
from fpg_bench.envs.pettingzoo_env import parallel_env

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
    shown = play(adapt(make()), SEED + first, rounds, first)
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
    (parallel_env, {"render_mode": "ansi"}, "'rgb_array' or 'human', got 'ansi'"),
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
