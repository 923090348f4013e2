"""Both sides at once: rounds and matches, chance, plans between rounds; all environments show it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fpg_bench import make_duel
from fpg_bench.common.errors import UserError
from fpg_bench.envs.core import SingleAgentGame
from fpg_bench.envs.pettingzoo_env import parallel_env
from fpg_bench.planning import Plan

from .playing import (
    ALLY_POLICY,
    OPPONENT_POLICY,
    PLANNED,
    SHORT,
    STEPS,
    Tape,
    same,
    single_game,
    tape,
)

GAMES = 3


def played(seed, ally, opponent, **options):
    """What each game of a duel shows of the two sides, two lists of (observation, reward) per game."""
    games = ally.shape[1]
    duel = make_duel(games, scenario=SHORT, **options)
    duel.reset(seeds=seed)
    shown = [([], []) for _ in range(games)]

    def keep(step, begun):
        for game, (of_ally, of_opponent) in enumerate(shown):
            of_ally.append((step.ally_observations[game], None if begun else step.ally_rewards[game]))
            of_opponent.append(
                (step.opponent_observations[game], None if begun else step.opponent_rewards[game])
            )

    keep(duel.present(), True)
    for k in range(len(ally)):
        step = duel.step(ally[k], opponent[k])
        keep(step, False)
        if step.truncated.all():
            duel.reset()
            keep(duel.present(), True)
    return shown


def both_tapes(games=GAMES):
    """Actions of both sides; the opponent's are the same in every round, as ``Tape`` plays them."""
    opponent = tape(games, STEPS, seed=1)
    return tape(games), np.tile(opponent, (3, 1, 1)), opponent


@pytest.mark.parametrize("path", ["pursuit", "learned", ["circle", "learned"]])
def test_the_single_environments_of_both_sides_show_the_duel(path):
    ally, opponent, round_of_opponent = both_tapes(1)
    of_ally, of_opponent = played(7, ally, opponent, path=path)[0]
    environment = single_game(ALLY_POLICY, 7, ally[:, 0], opponent=Tape(round_of_opponent), path=path)
    assert same(of_ally, environment)
    swapped_ally, swapped = np.tile(ally[:STEPS], (3, 1, 1)), opponent
    of_opponent = played(7, swapped_ally, swapped, path=path)[0][1]
    environment = single_game(OPPONENT_POLICY, 7, swapped[:, 0], ally=Tape(ally[:STEPS]), path=path)
    assert same(of_opponent, environment)


def test_the_pettingzoo_environment_shows_the_duel():
    ally, opponent, _ = both_tapes(1)
    of_ally, of_opponent = played(7, ally, opponent)[0]
    env = parallel_env(scenario=SHORT)
    shown = {"ally": [], "opponent": []}

    def keep(observations, rewards):
        for side, shown_to in shown.items():
            shown_to.append((observations[side], rewards and rewards[side]))

    keep(env.reset(seed=7)[0], None)
    for k in range(len(ally)):
        observations, rewards, *_ = env.step({"ally": ally[k, 0], "opponent": opponent[k, 0]})
        keep(observations, rewards)
        if not env.agents:
            keep(env.reset()[0], None)
    assert same(shown["ally"], of_ally)
    assert same(shown["opponent"], of_opponent)


def test_a_round_that_is_over_waits_while_others_go_on():
    duel = make_duel(2, scenario=SHORT)
    duel.reset(seeds=0, horizons=np.array([4, STEPS]))
    rest = np.zeros((2, 9), np.float32)
    for _ in range(4):
        step = duel.step(rest, rest)
    assert step.truncated.tolist() == [True, False]
    later = duel.step(rest, rest)
    assert np.array_equal(later.ally_observations[0], step.ally_observations[0])
    assert not np.array_equal(later.ally_observations[1], step.ally_observations[1])
    mask = duel.reset(step.truncated)
    assert mask.tolist() == [True, False]
    assert duel.batch.games["step"].tolist() == [0, 5]


# Plans between rounds


class Diary:
    """A planner that keeps what it is handed and answers by chance."""

    name, tier = "diary", "history"

    def __init__(self):
        self.histories, self.positions = [], []

    def plan(self, history, current_position, limits, rng):
        self.histories.append(history.copy())
        self.positions.append(current_position.copy())
        return Plan(rng.uniform(0, limits.box_m, (limits.waypoints, 3)), self.name)


def rounds(duel, count, seed=3):
    """Rounds of random actions: the plans, and the opponent's positions ``(rounds, steps, games, 3)``."""
    actions, plans, flown = tape(duel.count, STEPS), [], []
    duel.reset(seeds=seed)
    for _ in range(count):
        plans.append([plan.waypoints for plan in duel.plans])
        track = []
        for action in actions:
            duel.step(action, action)
            track.append(duel.batch.games["opponent_position"].copy())
        flown.append(track)
        duel.reset()
    return np.array(plans), np.array(flown)


def test_a_planner_learns_from_the_rounds_of_its_match_and_forgets_with_the_next():
    diary = Diary()
    _, flown = rounds(make_duel(1, scenario=dataclasses.replace(SHORT, rounds_per_match=3), planner=diary), 4)
    assert [len(history) for history in diary.histories] == [0, 1, 2, 0, 1]
    assert diary.histories[2].shape == (2, 16, 4)
    # With two steps to a part, its middle is the end of its second step
    assert np.allclose(diary.histories[2][1, :, :3], flown[1, 1::2, 0])
    assert np.array_equal(diary.histories[2][0], diary.histories[1][0])


def test_a_history_holds_the_mean_reward_of_each_part():
    diary = Diary()
    duel = make_duel(1, scenario=SHORT, planner=diary)
    duel.reset(seeds=0)
    rewards = [duel.step(action, action).opponent_rewards[0] for action in tape(1, STEPS)]
    duel.reset()
    assert diary.histories[1][0, :, 3] == pytest.approx(np.reshape(rewards, (16, 2)).mean(axis=1))


def test_rounds_left_early_are_no_part_of_a_history():
    diary = Diary()
    duel = make_duel(1, scenario=dataclasses.replace(SHORT, rounds_per_match=9), planner=diary)
    rest = np.zeros((1, 9), np.float32)
    duel.reset(seeds=0)
    duel.step(rest, rest)
    duel.reset(horizons=np.array([5]))
    for _ in range(5):
        duel.step(rest, rest)
    duel.reset()
    assert [len(history) for history in diary.histories] == [0, 0, 0]


def test_plans_are_the_games_own_chance_whatever_the_batch():
    together, flown = rounds(make_duel(4, scenario=SHORT, planner="random"), 3)
    again, _ = rounds(make_duel(4, scenario=SHORT, planner="random"), 3)
    assert np.array_equal(together, again)
    alone, _ = rounds(make_duel(1, scenario=SHORT, planner="random"), 3, seed=5)
    assert np.array_equal(together[:, 2:3], alone)
    assert len({plan.tobytes() for plan in together.reshape(-1, 16, 3)}) == 12
    assert flown.min() >= 0


def test_the_opponent_flies_the_plan_on_time():
    duel = make_duel(1, planner="circle")
    duel.reset(seeds=0)
    rest = np.zeros((1, 9), np.float32)
    track = []
    for _ in range(300):
        duel.step(rest, rest)
        track.append(duel.batch.games["opponent_position"][0].copy())
    plan = duel.plans[0].waypoints
    due = np.ceil(np.arange(1, 17) * 300 / 16).astype(int) - 1
    missed = np.linalg.norm(np.array(track)[due] - plan, axis=1)
    assert plan.std(axis=0)[0] > 100
    assert missed[8:].max() < 1e-6  # it starts anywhere and catches up with the circle


def test_the_planner_environment_plays_ten_rounds_a_match_and_hands_the_plan_over():
    core = SingleAgentGame(PLANNED)
    core.reset(seeds=0)
    assert core.scenario.rounds_per_match == 10
    assert np.array_equal(core.duel.plans[0].waypoints, core.duel.batch.waypoints[0])


def test_a_bad_plan_says_whose_it_is_and_in_which_game_and_round():
    class Shortening(Diary):
        def plan(self, history, *args):
            plan = super().plan(history, *args)
            return dataclasses.replace(plan, waypoints=plan.waypoints[len(history) :])

    with pytest.raises(
        UserError, match=r"^planner diary: seed 3, match 0, round 1: waypoints: expected .*, got \(15, 3\)$"
    ):
        rounds(make_duel(1, scenario=SHORT, planner=Shortening()), 2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"path": "waypoints"}, "path 'waypoints' needs a planner"),
        ({"path": "circle", "planner": "circle"}, "nothing to plan where the path is 'circle'"),
        ({"planner": "sqare"}, "unknown planner 'sqare'"),
        ({"games": 0}, "above 0, got 0"),
        ({"scenario": "papr"}, "did you mean 'paper'"),
        ({"jamming_types": "combs"}, "did you mean 'comb'"),
    ],
    ids=str,
)
def test_what_cannot_be_is_refused(options, message):
    with pytest.raises(UserError, match=message):
        make_duel(**options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mask": np.array([True])}, r"a mask of shape \(2,\), got \(1,\)"),
        ({"horizons": np.array([5, 301])}, "horizons of 1 to 300 steps"),
        ({"horizons": np.array([0, 300])}, "horizons of 1 to 300 steps"),
        ({"seeds": [1]}, r"a whole number in \[0, 2\^63\) or 2 of them"),
    ],
    ids=str,
)
def test_a_reset_that_cannot_be_is_refused(options, message):
    with pytest.raises(UserError, match=message):
        make_duel(2).reset(**{"seeds": 0, **options})


def test_the_first_reset_needs_seeds():
    with pytest.raises(UserError, match="first reset"):
        make_duel(1).reset()
