"""Training of teams: one policy for all seats, its exported agent that draws actions, and who refuses it."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch

import fpg_bench
from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.policy_evaluator import PolicyEvaluator
from fpg_bench.evaluation.suite import Scale
from fpg_bench.game.scenario import preset
from fpg_bench.players.agent import load_agent, read_card, write_agent
from fpg_bench.products.teams.match import play_teams
from fpg_bench.products.teams.rules import TeamRules
from fpg_bench.products.teams.scripts import as_team_player
from fpg_bench.products.teams.spec import TeamSpec
from fpg_bench.training.actor import ActorPlayer, draw_choices
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import make_model
from fpg_bench.training.run import Run
from tests.training.tiny import settings, train_tiny

TEAM = "FPG/team_v0"
SHORT = {"scenario": "link", "side": "ally", "opponent": "tone"}
LINK = preset("link")


@pytest.fixture(scope="module")
def blind(tmp_path_factory):
    """A run of allies that are told nothing of their mates."""
    out = tmp_path_factory.mktemp("runs") / "blind"
    options = {"actions": "discrete", "mates": "none", "opponent": ["tone", "assign"]}
    train_tiny("ppo-stack2", out, env_id=TEAM, **(SHORT | options), evaluations=1)
    return out


@pytest.mark.slow
def test_one_policy_is_trained_for_all_seats_and_its_card_says_where_it_plays(blind):
    card = read_card(blind / "agent")
    assert card.skills == {"seats": {"allies": [3, 3], "jammers": [2, 2]}, "mates": "none"}
    assert card.sample
    assert card.game == TeamSpec.of(rivals=["tone", "assign"], actions="discrete", mates="none", side="ally")
    assert "--opponent tone,assign --actions discrete --mates none --side ally" in card.command
    assert Run(blind).config.spec == card.game
    rows = [json.loads(line) for line in (blind / "evaluations.jsonl").read_text().splitlines()]
    assert [row["side"] for row in rows] == ["ally"] * len(rows)
    assert len(rows[0]["rivals"]) == 6
    player = load_agent(blind / "agent")
    assert (player.size, player.noise_size, player.state_size) == (67, 1, 67)


@pytest.mark.slow
def test_a_team_agent_plays_by_its_name_alone_with_mates_and_as_rivals(blind):
    agent = str(blind / "agent")
    once, again = (play_teams([agent], ["tone"], LINK, TeamRules(), 2) for _ in range(2))
    assert np.array_equal(once.rewards, again.rewards)
    mixed = play_teams([agent, "cdma", agent], ["tone"], LINK, TeamRules(), 2)
    assert not np.array_equal(once.rewards, mixed.rewards)
    team = fpg_bench.make_team(2, side="opponent", rivals=[agent, "listen"])
    team.reset(seeds=0)
    assert np.isfinite(team.step(opponent_actions=np.zeros((2, 2, 9))).opponent_rewards).all()


@pytest.mark.slow
def test_equal_policies_in_three_seats_draw_their_own_choices(blind):
    player = load_agent(blind / "agent")
    player.reset(np.ones(300, bool), np.arange(300, dtype=np.uint64))
    actions, _ = player.predict(np.zeros((300, 67), np.float32))
    assert len(np.unique(actions, axis=0)) > 5
    few, _ = _seated(player, np.arange(7)).predict(np.zeros((7, 67), np.float32))
    assert np.array_equal(few, actions[:7])


def _seated(player, keys):
    player.reset(np.ones(len(keys), bool), keys.astype(np.uint64))
    return player


@pytest.mark.slow
def test_an_agent_sees_no_more_of_its_mates_than_in_its_training(blind):
    """In a game whose mates tell all it plays as in one whose mates tell nothing."""
    scores = []
    for mates in ("none", "full"):
        team = fpg_bench.make_team(2, side="opponent", rivals=str(blind / "agent"), mates={"ally": mates})
        team.reset(seeds=0)
        scores.append([team.step(opponent_actions=np.zeros((2, 2, 9))).ally_rewards for _ in range(20)])
    assert np.array_equal(*scores)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"allies": 2}, "ally OnnxPlayer.*: was trained with 3 allies, here are 2"),
        ({"jammers": (1, 2)}, "ally OnnxPlayer.*: was trained with 2 jammers, here are 1 to 2"),
    ],
)
def test_an_agent_of_other_sizes_of_teams_is_refused_in_one_line(blind, options, message):
    with pytest.raises(UserError, match=message) as refused:
        fpg_bench.make_team(1, side="opponent", rivals=str(blind / "agent"), **options)
    assert "\n" not in str(refused.value)


@pytest.mark.slow
def test_an_agent_whose_mates_told_it_more_is_refused_in_one_line(blind, tmp_path):
    card = read_card(blind / "agent").to_dict() | {"mates": "full"}
    write_agent(tmp_path / "told", blind / "agent" / "policy.onnx", **card)
    with pytest.raises(UserError, match="trained with mates='full', here they tell 'place'"):
        fpg_bench.make_team(1, side="opponent", rivals=str(tmp_path / "told"), mates={"ally": "place"})


@pytest.mark.slow
def test_a_team_agent_is_refused_in_a_duel_and_by_the_other_side(blind):
    agent = str(blind / "agent")
    with pytest.raises(UserError, match="plays a seat of a team, not a duel"):
        fpg_bench.make_sb3("FPG/OpponentVsPolicy-v0", ally=agent, scenario="link")
    with pytest.raises(UserError, match="plays the ally"):
        as_team_player(agent, "opponent", LINK, TeamRules())


@pytest.mark.slow
def test_a_team_agent_of_others_is_refused_in_one_line(blind):
    with pytest.raises(UserError, match="plays a seat of a team, and agents of others play the duel alone"):
        load_agent(blind / "agent", trusted=False)


def test_a_live_model_of_a_team_is_exported_before_it_plays():
    games = fpg_bench.make_sb3_team(2, seed=0, **SHORT)
    model = make_model("ppo", games, load_hyperparameters("ppo", games.game_spec, settings("ppo")), 0)
    with pytest.raises(UserError, match="ally PPO: plays a seat of a team, which draws its actions"):
        fpg_bench.make_team(1, side="opponent", rivals=model)


@pytest.mark.parametrize("actions", ["continuous", "discrete", "multi-discrete", "discrete-uniform"])
def test_an_exported_agent_draws_what_the_model_draws(actions, tmp_path):
    game = TeamSpec.of(**{**SHORT, "actions": actions})
    parameters = load_hyperparameters("ppo-stack2", game, settings("ppo"))
    model = make_model("ppo-stack2", fpg_bench.make_sb3(game, 4, 0), parameters, 0)
    assert fpg_bench.export_agent(model, tmp_path, training_seed=0) < 1e-4
    players = ActorPlayer(model), load_agent(tmp_path)
    seen = np.random.default_rng(0).uniform(-1, 1, (200, 67)).astype(np.float32)
    keys = np.arange(200)
    (torch_actions, _), (actions, _) = (_seated(each, keys).predict(seen) for each in players)
    alike = np.isclose(torch_actions, actions, atol=1e-5).all(axis=1)
    assert alike.mean() > 0.98  # rounding decides where a draw lies between two choices
    assert len(np.unique(np.round(actions, 3), axis=0)) > 5


def test_choices_are_drawn_by_their_probabilities_and_forbidden_ones_never():
    values = torch.tensor([[-1e30, 0.0, 1.0, -1e30, 2.0, -1e30]])
    noise = torch.randn(20_000, 1, generator=torch.Generator().manual_seed(0))
    counts = torch.bincount(draw_choices(values.expand(20_000, 6), noise), minlength=6) / 20_000
    assert torch.allclose(counts, torch.softmax(values[0], 0), atol=0.015)
    extreme = torch.tensor([[-9.0], [9.0]])
    assert draw_choices(values.expand(2, 6), extreme).tolist() == [1, 4]


@pytest.mark.parametrize(
    ("algorithm", "options", "message"),
    [
        ("dqn", {"actions": "discrete"}, "draw their actions from a distribution, which DQNPolicy lacks"),
        ("sac", {}, "draw their actions from a distribution, which SACPolicy lacks"),
        ("ppo", {"scenario": "standard"}, "teams: snr_model 'sinr': powers of several senders add in mW"),
        ("ppo", {"allies": 6}, "allies: expected a whole number from 1 to 5"),
        ("ppo", {"allies": (1, 3)}, "give one number, not 1 to 3"),
        ("ppo", {"mates": "all"}, "mates of the ally: expected one of none, place, full"),
        ("ppo", {"opponent": "split-bnd"}, "unknown opponent 'split-bnd'"),
        ("ppo", {"opponent": "greedy"}, "'greedy' plays the ally; name a player of the opponent"),
        ("ppo", {"side": None, "opponent": None}, "got FPG/team_v0 without a side"),
    ],
)
def test_what_cannot_be_trained_is_refused_in_one_line(algorithm, options, message, tmp_path):
    with pytest.raises(UserError, match=message) as refused:
        train_tiny(algorithm, tmp_path / "run", {"normalize": None}, env_id=TEAM, **(SHORT | options))
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "run" / "run.json").exists()


def test_the_suite_of_a_training_has_the_sizes_of_its_teams():
    game = TeamSpec.of(side="opponent", allies=2, jammers=1)
    suite = PolicyEvaluator("team-opponent-link-v1", 1, LINK, "opponent", game=game).suite
    assert (suite.game.allies, suite.game.jammers) == (2, 1)
    assert suite.scale == Scale()
    assert PolicyEvaluator("team-opponent-link-v1", game=TeamSpec.of(side="opponent")).suite.scale != Scale()
