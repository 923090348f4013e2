"""Recipes: what a closing consists of, and what its seed decides."""

from __future__ import annotations

from collections import Counter

import pytest

from fpg_bench import UserError
from fpg_bench.seasons.candidates import hyperparameters
from fpg_bench.seasons.recipe import ALGORITHMS, REWARDS, STEPS, Target, dealt, draw_recipes, number, shuffled

ALLIES = [Target(f"ally/{name}", tuple(f"{name}/seed_{k}" for k in range(5))) for name in "abcd"]
ALLIES += [Target("ally/expert", ("expert",)), Target("ally/idle", ("idle",))]
OPPONENTS = [
    Target("opponent/pursuer", ("p/seed_0", "p/seed_1"), "pursuit"),
    Target("opponent/flyer", ("f/seed_0", "f/seed_1"), "learned"),
    Target("opponent/tone", ("tone",)),
]


def test_draws_are_the_same_everywhere():
    assert shuffled("abcdef", "seed") == list("edbfca")
    assert [number(100, "seed", i) for i in range(5)] == [79, 20, 87, 63, 35]


def test_levels_are_dealt_evenly():
    assert Counter(dealt("abc", 8, "seed")) == {"a": 3, "b": 3, "c": 2}
    assert dealt("abc", 8, "seed") != dealt("abc", 8, "other")


@pytest.mark.parametrize(("side", "targets"), [("opponent", ALLIES), ("ally", OPPONENTS)])
def test_two_closings_consist_of_the_same_and_combine_it_otherwise(side, targets):
    a, b = (draw_recipes(seed, side, 24, targets) for seed in ("a", "b"))
    for kind in ("algorithm", "reward", "gamma"):
        found = Counter(getattr(recipe, kind) for recipe in a)
        assert found == Counter(getattr(recipe, kind) for recipe in b)
        assert kind == "algorithm" or max(found.values()) - min(found.values()) <= 3
    assert {recipe.reward for recipe in a} == set(REWARDS[side])
    assert all(recipe.steps in STEPS[recipe.algorithm] for recipe in a)
    assert [(r.reward, r.targets) for r in a] != [(r.reward, r.targets) for r in b]
    assert not {r.training_seed for r in a} & {r.training_seed for r in b}
    assert draw_recipes("a", side, 24, targets) == a


def test_every_trained_entry_is_answered_equally_often():
    recipes = draw_recipes("a", "opponent", 24, ALLIES)
    firsts = Counter(recipe.targets[0].partition("/")[0] for recipe in recipes)
    assert firsts == dict.fromkeys("abcd", 6)
    assert {len(recipe.targets) for recipe in recipes} == {1, 3, 5}
    assert all(len({t.partition("/")[0] for t in r.targets}) == len(r.targets) for r in recipes)


def test_opponents_that_fly_in_different_ways_are_not_met_in_one_game():
    for recipe in draw_recipes("a", "ally", 24, OPPONENTS):
        kinds = {"p": "pursuit", "f": "learned"}
        assert {kinds[t[0]] for t in recipe.targets if "/" in t} == {recipe.path}


def test_scripts_are_answered_where_nobody_was_trained():
    recipes = draw_recipes("a", "opponent", 4, ALLIES[-2:])
    assert {recipe.targets[0] for recipe in recipes} == {"expert", "idle"}


def test_without_entries_there_is_nothing_to_train_against():
    with pytest.raises(UserError, match="no entry that candidates of the ally"):
        draw_recipes("a", "ally", 4, [])


@pytest.mark.parametrize("algorithm", sorted(set(ALGORITHMS)))
def test_hyperparameters_say_what_the_recipe_says(algorithm):
    recipe = next(r for r in draw_recipes("a", "opponent", 24, ALLIES) if r.algorithm == algorithm)
    found = hyperparameters(recipe)
    assert (found["gamma"], found["n_timesteps"]) == (recipe.gamma, recipe.steps)
    assert found["policy_kwargs"].get("log_std_init") == recipe.log_std
