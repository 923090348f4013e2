"""Recipes of candidates, which follow from the seed of a closing, and the selection of members."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from fpg_bench import UserError
from fpg_bench.leaderboard.close_season import (
    ALGORITHMS,
    REWARDS,
    STEPS,
    dealt,
    draw_number,
    draw_recipes,
    hyperparameters,
    select_diverse,
    select_representative,
    shuffled,
)
from fpg_bench.leaderboard.season import SeasonEntry

ALLIES = [
    SeasonEntry(f"ally/{name}", "ally", None, tuple(f"{name}/seed_{k}" for k in range(5))) for name in "abcd"
]
ALLIES += [SeasonEntry(f"ally/{name}", "ally", None, (name,)) for name in ("expert", "idle")]
OPPONENTS = [
    SeasonEntry("opponent/pursuer", "opponent", "pursuit", ("p/seed_0", "p/seed_1")),
    SeasonEntry("opponent/flyer", "opponent", "learned", ("f/seed_0", "f/seed_1")),
    SeasonEntry("opponent/tone", "opponent", "pursuit", ("tone",)),
]

# Three entries against five candidates: 0 is weak, 1 to 3 hurt one entry each, 4 is the strongest.
RETURNS = np.array([[20.0, 0, 9, 9, 1], [20.0, 9, 0, 9, 1], [20.0, 9, 9, 0, 1]])
both_selections = pytest.mark.parametrize("select", [select_diverse, select_representative])


def test_draws_are_the_same_everywhere():
    assert shuffled("abcdef", "seed") == list("edbfca")
    assert [draw_number(100, "seed", i) for i in range(5)] == [79, 20, 87, 63, 35]


def test_levels_are_dealt_evenly():
    assert Counter(dealt("abc", 8, "seed")) == {"a": 3, "b": 3, "c": 2}
    assert dealt("abc", 8, "seed") != dealt("abc", 8, "other")


@pytest.mark.parametrize(("side", "entries"), [("opponent", ALLIES), ("ally", OPPONENTS)])
def test_seeds_change_only_how_properties_are_combined(side, entries):
    a, b = (draw_recipes(seed, side, 24, entries) for seed in ("a", "b"))
    for kind in ("algorithm", "reward", "gamma"):
        counts = Counter(getattr(recipe, kind) for recipe in a)
        assert counts == Counter(getattr(recipe, kind) for recipe in b)
        assert kind == "algorithm" or max(counts.values()) - min(counts.values()) <= 3
    assert {recipe.reward for recipe in a} == set(REWARDS[side])
    assert all(recipe.steps in STEPS[recipe.algorithm] for recipe in a)
    assert [(r.reward, r.targets) for r in a] != [(r.reward, r.targets) for r in b]
    assert not {r.training_seed for r in a} & {r.training_seed for r in b}
    assert draw_recipes("a", side, 24, entries) == a


def test_every_trained_entry_is_the_first_target_equally_often():
    recipes = draw_recipes("a", "opponent", 24, ALLIES)
    firsts = Counter(recipe.targets[0].partition("/")[0] for recipe in recipes)
    assert firsts == dict.fromkeys("abcd", 6)
    assert {len(recipe.targets) for recipe in recipes} == {1, 3, 5}
    assert all(len({t.partition("/")[0] for t in r.targets}) == len(r.targets) for r in recipes)


def test_opponents_with_different_paths_are_never_mixed():
    for recipe in draw_recipes("a", "ally", 24, OPPONENTS):
        paths = {"p": "pursuit", "f": "learned"}
        assert {paths[t[0]] for t in recipe.targets if "/" in t} == {recipe.path}


def test_scripts_are_targets_where_nobody_was_trained():
    recipes = draw_recipes("a", "opponent", 4, ALLIES[-2:])
    assert {recipe.targets[0] for recipe in recipes} == {"expert", "idle"}
    with pytest.raises(UserError, match="no entry that candidates of the ally"):
        draw_recipes("a", "ally", 4, [])


@pytest.mark.parametrize("algorithm", sorted(set(ALGORITHMS)))
def test_hyperparameters_follow_the_recipe(algorithm):
    recipe = next(r for r in draw_recipes("a", "opponent", 24, ALLIES) if r.algorithm == algorithm)
    values = hyperparameters(recipe)
    assert (values["gamma"], values["n_timesteps"]) == (recipe.gamma, recipe.steps)
    assert values["policy_kwargs"].get("log_std_init") == recipe.log_std


@both_selections
def test_the_strongest_candidate_is_selected_first(select):
    assert select(RETURNS, 1) == [4]
    assert sorted(select(RETURNS, 5)) == list(range(5))


def test_a_diverse_selection_has_the_most_different_candidates():
    assert select_diverse(RETURNS, 2) == [4, 0]
    copied = np.concatenate((RETURNS, RETURNS[:, 1:2] + 0.1), axis=1)
    assert select_diverse(copied, 6)[-1] in (1, 5)


def test_a_representative_selection_has_the_mean_of_all_candidates():
    rng = np.random.default_rng(0)
    returns = rng.normal(0, 8, (10, 24))

    def distance(selected):
        return np.linalg.norm(returns[:, selected].mean(axis=1) - returns.mean(axis=1))

    representative = distance(select_representative(returns, 12))
    assert representative < 0.5 * distance(select_diverse(returns, 12))
    random = [distance(rng.choice(24, 12, replace=False)) for _ in range(50)]
    assert representative < 0.5 * np.median(random)


@both_selections
def test_invalid_returns_and_sizes_are_refused(select):
    with pytest.raises(UserError, match="a suite of 6 needs as many candidates, got 5"):
        select(RETURNS, 6)
    invalid = RETURNS.copy()
    invalid[1, 2] = np.nan
    with pytest.raises(UserError, match="season: a return of an entry is not a number"):
        select(invalid, 2)
