"""Environments of teams: PettingZoo by its own tests, SuperSuit, Stable-Baselines3, rivals and refusals."""

from __future__ import annotations

import pickle
import warnings
from pathlib import Path

import numpy as np
import pettingzoo
import pytest
import supersuit
from stable_baselines3 import PPO

with warnings.catch_warnings():  # importing PettingZoo's tests warns of PettingZoo's own games
    warnings.simplefilter("ignore")
    from pettingzoo.test import api_test, parallel_api_test, seed_test

from envs.playing import STEPS, tape

import fpg_bench
from fpg_bench import make_duel
from fpg_bench.common.errors import UserError
from fpg_bench.envs.core import as_info
from fpg_bench.envs.pettingzoo_env import aec_env, parallel_env
from fpg_bench.game.scenario import as_scenario
from fpg_bench.game.spec import GameSpec
from fpg_bench.products.teams.core import make_team
from fpg_bench.products.teams.rules import TEAM_ID, TEAM_SCRIPTS
from fpg_bench.products.teams.spec import TeamSpec

SHORT = as_scenario("link", steps_per_round=STEPS, rounds_per_match=2)
MASKED = as_scenario(SHORT, knowledge="none", jamming_types=("tone", "comb"), opponent_path="learned")
ROOT = Path(__file__).parents[3]
MODES = ("continuous", "discrete", "multi-discrete")
# PettingZoo would like no MultiDiscrete
strictly = pytest.mark.filterwarnings("error", "ignore:Action space for each agent probably should be")


def registered(kind, **options):
    options = {"scenario": SHORT, **options}
    if not hasattr(pettingzoo, "make"):  # before 1.27
        return {"parallel": parallel_env, "aec": aec_env}[kind](game=TEAM_ID, **options)
    return pettingzoo.make(kind, "FPG/team_v0", **options)


class Marked:
    """A player of teams that tunes to the seat's first mate, or counts where none is seen."""

    sees = "team"

    def __init__(self):
        self.seen = []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        self.seen.append(observation.copy())
        return np.tanh(observation[:, -9:]), state


@strictly
@pytest.mark.parametrize("actions", MODES)
@pytest.mark.parametrize("sizes", [(1, 1), (3, 2), (5, 3)])
def test_pettingzoo_finds_nothing_amiss(sizes, actions):
    long = as_scenario(SHORT, steps_per_round=1000)  # a round ends PettingZoo's test
    options = {"allies": sizes[0], "jammers": sizes[1], "actions": actions, "scenario": long}
    parallel_api_test(registered("parallel", **options), 1000)
    api_test(registered("aec", **options), 1000)
    seed_test(lambda: aec_env(game=TEAM_ID, **options), 2 * STEPS)


@pytest.mark.filterwarnings("error", "ignore:No agents present but not all")  # as some are absent
@pytest.mark.parametrize(
    "options", [{"allies": (1, 5), "jammers": (1, 3)}, {"side": "ally", "against": "tone"}]
)
def test_pettingzoo_finds_nothing_amiss_with_other_agents(options):
    parallel_api_test(registered("parallel", **options), 6 * STEPS)
    api_test(registered("aec", **options), 6 * STEPS)


@pytest.mark.parametrize("actions", ["discrete", "multi-discrete"])
def test_masks_are_what_the_action_spaces_sample_with(actions):
    env = registered("parallel", actions=actions, scenario=MASKED, allies=(1, 4))
    for seed in range(4):
        _, infos = env.reset(seed=seed)
        for _ in range(STEPS):
            sampled = {
                agent: env.action_space(agent).sample(infos[agent]["action_mask"]) for agent in env.agents
            }
            *_, infos = env.step(sampled)
        assert infos["ally_0"]["measures"]["ally_return"] != 0


def test_agents_are_the_seats_of_the_batch():
    env, team = (
        registered("parallel", reward={"opponent": "own"}),
        make_team(1, scenario=SHORT, reward={"opponent": "own"}),
    )
    observations, _ = env.reset(seed=3)
    team.reset(seeds=3)
    assert list(observations) == ["ally_0", "ally_1", "ally_2", "opponent_0", "opponent_1"]
    for allies, opponents in zip(tape(3, STEPS), tape(2, STEPS, seed=1), strict=True):
        actions = {f"ally_{k}": row for k, row in enumerate(allies)}
        actions |= {f"opponent_{k}": row for k, row in enumerate(opponents)}
        observations, rewards, _, truncations, infos = env.step(actions)
        step = team.step(allies[None], opponents[None])
        for k in range(3):
            assert np.array_equal(observations[f"ally_{k}"], step.ally_observations[0, k])
            assert rewards[f"ally_{k}"] == step.ally_rewards[0, k]
        for k in range(2):
            assert np.array_equal(observations[f"opponent_{k}"], step.opponent_observations[0, k])
            assert rewards[f"opponent_{k}"] == step.opponent_rewards[0, k]
        assert np.array_equal(env.state(), team.state()[0])
    assert all(truncations.values())
    assert not env.agents
    assert infos["ally_1"]["measures"] == as_info(team.measures(0, 1))
    assert infos["opponent_0"]["measures"] == as_info(team.measures(0))


def test_a_team_of_one_against_one_is_the_duel():
    duel, team = (
        make_duel(4, scenario=SHORT, actions="discrete"),
        make_team(4, scenario=SHORT, allies=1, jammers=1, actions="discrete"),
    )
    duel.reset(seeds=0)
    team.reset(seeds=0)
    rng = np.random.default_rng(0)
    for _ in range(STEPS):
        ally, opponent = rng.integers(18, size=4), rng.integers(30, size=4)
        one, other = duel.step(ally, opponent), team.step(ally[:, None], opponent[:, None])
        for name in ("ally_rewards", "opponent_rewards"):
            assert np.array_equal(getattr(one, name), getattr(other, name)[:, 0])
        assert np.array_equal(one.ally_observations, other.ally_observations[:, 0, :15])
    assert duel.measures(2) == team.measures(2)


@pytest.mark.parametrize("rivals", ["watchful", ["sweep", "watchful", "guard"]])
def test_rivals_of_the_duel_play_their_seats_as_they_play_a_duel(rivals):
    """In a team of one against one they play what the duel's rivals play, draws included."""
    options = {"scenario": SHORT, "seed": 5}
    one = fpg_bench.make_sb3("FPG/AllyVsScripted-v0", 6, opponent=rivals, **options)
    other = fpg_bench.make_sb3(TEAM_ID, 6, side="ally", against=rivals, allies=1, jammers=1, **options)
    assert np.array_equal(one.reset(), other.reset()[:, :15])
    for action in tape(6, 2 * STEPS):
        expected, rewards, dones, infos = one.step(action)
        observations, got, over, told = other.step(action)
        assert np.array_equal(observations[:, :15], expected)
        assert np.array_equal(got, rewards)
        assert np.array_equal(over, dones)
        for row in np.flatnonzero(dones):
            assert told[row]["episode"] | {"t": 0} == infos[row]["episode"] | {"t": 0}


def test_seats_of_a_random_rival_act_apart_and_games_draw_one_rival():
    team = make_team(40, scenario=SHORT, side="ally", against=["random", "tone"], jammers=3, allies=1)
    team.reset(seeds=0)
    team.step(np.zeros((40, 1, 9)))
    tones = (team.batch.opponents["jamming_type"] == 0).all(axis=1)
    assert 5 < tones.sum() < 35
    tuned = team.batch.opponents["jamming_mhz"][~tones]
    assert (tuned[:, 0] != tuned[:, 1]).mean() > 0.9
    by_seat = make_team(2, scenario=SHORT, side="ally", against=["comb", "tone"], is_by_seat=True)
    by_seat.reset(seeds=0)
    by_seat.step(np.zeros((2, 3, 9)))
    assert by_seat.batch.opponents["jamming_type"].tolist() == [[3, 0], [3, 0]]


def test_rivals_of_teams_see_all_numbers_of_their_seats():
    rival = Marked()
    team = make_team(3, scenario=SHORT, side="opponent", against=rival)
    team.reset(seeds=0)
    seen = team.batch.ally_observations.copy()
    step = team.step(None, np.zeros((3, 2, 9)))
    assert np.array_equal(rival.seen[0], seen.reshape(9, 67))
    assert step.opponent_rewards.shape == (3, 2)


def test_a_shipped_agent_plays_any_seat():
    agent = min((ROOT / "baselines/agents").glob("opponent-*/*/seed_0"))
    team = make_team(4, side="ally", against=str(agent))
    team.reset(seeds=0)
    for _ in range(20):
        team.step(np.zeros((4, 3, 9)))
    assert len(np.unique(team.batch.opponents["jamming_mhz"])) > 1


def test_rows_of_a_vec_env_are_seats():
    env, team = (
        fpg_bench.make_sb3(
            TEAM_ID, 3, seed=7, scenario=SHORT, side="opponent", against="expert", reward="own"
        ),
        make_team(3, scenario=SHORT, side="opponent", against="expert", reward="own"),
    )
    assert env.num_envs == 6
    observations = env.reset()
    team.reset(seeds=7)
    for k, action in enumerate(tape(6, 2 * STEPS)):
        assert np.array_equal(observations, team.batch.opponent_observations.reshape(6, 67))
        observations, rewards, dones, infos = env.step(action)
        step = team.step(None, action.reshape(3, 2, 9))
        assert np.array_equal(rewards, step.opponent_rewards.reshape(6).astype(np.float32))
        assert dones.all() == dones.any() == ((k + 1) % STEPS == 0)
        if dones.all():
            assert infos[3]["episode"]["l"] == STEPS
            assert np.array_equal(infos[3]["terminal_observation"], step.opponent_observations[1, 1])
            team.reset()


def test_staggered_rounds_end_apart_and_seats_of_a_game_together():
    env = fpg_bench.make_sb3(TEAM_ID, 4, seed=0, stagger=True, scenario=SHORT, side="ally", against="tone")
    env.reset()
    ends = []
    for action in tape(12, STEPS):
        *_, dones, _ = env.step(action)
        rows = dones.reshape(4, 3)
        assert (rows == rows[:, :1]).all()
        ends.append(rows[:, 0])
    assert np.argmax(ends, axis=0).tolist() == [31, 23, 15, 7]


@pytest.mark.parametrize("actions", ["continuous", "discrete"])
def test_supersuit_shares_parameters_as_its_documentation_does(actions):
    env = parallel_env(game=TEAM_ID, scenario=SHORT, side="ally", against="tone", actions=actions)
    env = supersuit.pettingzoo_env_to_vec_env_v1(env)
    env = supersuit.concat_vec_envs_v1(env, 2, num_cpus=1, base_class="stable_baselines3")
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=32, n_epochs=1, device="cpu")
    model.learn(2 * 3 * 32)
    assert env.num_envs == 6
    assert model.num_timesteps == 2 * 3 * 32


@pytest.mark.parametrize("options", [{}, {"side": "opponent", "against": ["random", "expert"]}])
def test_a_game_that_was_pickled_goes_on_alike(options):
    env = parallel_env(game=TEAM_ID, scenario=SHORT, **options)
    env.reset(seed=1)
    other = pickle.loads(pickle.dumps(env))
    action = dict.fromkeys(env.agents, np.zeros(9, np.float32))
    for _ in range(5):
        one, two = env.step(action), other.step(action)
    assert all(np.array_equal(one[0][agent], two[0][agent]) for agent in one[0])
    assert one[1] == two[1]


def test_a_specification_is_written_down_and_opens_the_same_game():
    spec = TeamSpec.of(
        scenario=SHORT, allies=[2, 4], spacing_m=10, path="learned", against=["tone", "comb"], side="ally",
        actions="discrete", mates={"ally": "none"}, reward="team",
    )  # fmt: skip
    again = GameSpec.from_dict(spec.to_dict())
    assert again.to_dict() == spec.to_dict()
    assert again.hash == spec.hash != TeamSpec.of(spec, spacing_m=11).hash
    team = make_team(2, game=again)
    assert team.game_spec == again
    assert team.choices["opponent"] is None
    assert team.game_spec.of_side("reward", "opponent") == "team"
    assert team.batch.mates == {"ally": "none", "opponent": "full"}
    assert TeamSpec().to_dict() == {"id": "FPG/team_v0"}
    with pytest.raises(UserError, match="opponent: Marked is an object of this program, which cannot be"):
        TeamSpec.of(side="ally", against=Marked()).to_dict()
    with pytest.raises(UserError, match=r"agent\.json: unknown key 'mate'.*mates"):
        GameSpec.from_dict({"id": "FPG/team_v0", "mate": "none"}, "agent.json")
    assert GameSpec.of("FPG/team_v0", side="ally", against="tone") == TeamSpec.of(side="ally", against="tone")


def test_without_a_name_the_rivals_are_the_scripts_of_teams():
    game = TeamSpec.of(side="opponent")
    assert game.others == TEAM_SCRIPTS["ally"]
    assert game.to_dict() == {"id": "FPG/team_v0", "side": "opponent"}
    assert TeamSpec().others == ()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"scenario": "standard"},
            "teams: snr_model 'sinr': powers of several senders add in mW, and it has none",
        ),
        ({"allies": 6}, "allies: expected a whole number from 1 to 5"),
        ({"jammers": (0, 2)}, "jammers: expected a whole number from 1 to 3"),
        ({"path": "circle"}, "teams: opponent_path 'circle': jammers of a team fly pursuit"),
        ({"against": "tone"}, "against: say which side you play"),
        ({"opponent": "tone"}, "against: say which side you play"),
        ({"side": "ally", "ally": "greedy"}, "ally: you play this side; name the opponent"),
        ({"side": "ally", "against": "tone", "opponent": "comb"}, "against: names the opponent, and so does"),
        ({"planner": "interceptor"}, "unexpected keyword argument 'planner': teams do not have it"),
        ({"side": "planner", "against": "tone"}, "side: expected one of ally, opponent"),
        ({"side": "ally", "against": "expert"}, "expert"),
        ({"side": "ally", "against": "oracle"}, "opponent: BayesJammer sees the state of a duel"),
        (
            {"side": "ally", "against": ["tone"], "is_by_seat": True},
            "opponent: expected 2 players, one per seat",
        ),
        ({"mates": "all"}, "mates of the ally: expected one of none, place, full"),
        ({"reward": "difference"}, "reward of the ally: expected one of own, team"),
        ({"actions": "continued"}, "actions of the ally: expected one of continuous"),
        ({"opponents": 2}, "unexpected keyword argument 'opponents'"),
        ({"game": "FPG/duel_v0"}, "game: expected one of FPG/team_v0"),
    ],
)
def test_options_out_of_range_are_refused_in_one_line(options, message):
    with pytest.raises(UserError, match=message):
        make_team(**options)


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        ({"ally_7": np.zeros(9)}, "step: no agent 'ally_7'.*did you mean"),
        ({"opponent_2": np.zeros(9)}, "step: opponent_2 is absent in this round; it has ally_0"),
        ({}, "^ally_0: expected a float array"),
        ({"ally_0": np.zeros(8)}, "^ally_0: expected a float array"),
        (5, "step: actions by agent: expected a mapping"),
    ],
)
def test_actions_of_other_agents_are_refused_in_one_line(actions, message):
    env = parallel_env(game=TEAM_ID, scenario=SHORT, jammers=(1, 3))
    env.reset(
        seed=next(seed for seed in range(50) if env.reset(seed=seed) and "opponent_2" not in env.agents)
    )
    with pytest.raises(UserError, match=message):
        env.step(actions)


def test_a_vec_env_has_as_many_seats_in_each_game():
    with pytest.raises(UserError, match=r"allies: .* give one number, not 1 to 3"):
        fpg_bench.make_sb3(TEAM_ID, 2, side="ally", against="tone", allies=(1, 3))


def test_actions_of_the_rivals_are_refused():
    team = make_team(1, side="ally", against="tone")
    team.reset(seeds=0)
    with pytest.raises(UserError, match="opponent actions: rivals play this side"):
        team.step(np.zeros((1, 3, 9)), np.zeros((1, 2, 9)))
    with pytest.raises(UserError, match=r"ally actions: expected a float array of shape \(1, 3, 9\)"):
        team.step()


def test_games_of_teams_draw_no_rules():
    scenario = {"preset": "link", "hop_airtime_s": [0.1, 0.5]}
    with pytest.raises(UserError, match="variants: games of teams are played by one scenario"):
        fpg_bench.make_sb3("FPG/team_v0", side="ally", scenario=scenario)
