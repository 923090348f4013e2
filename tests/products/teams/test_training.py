"""Training of teams: one policy for all seats, its exported agent that draws actions, and who refuses it."""

from __future__ import annotations

import json
import re

import numpy as np
import onnxruntime
import pytest
import torch
from stable_baselines3 import PPO

import fpg_bench
from fpg_bench.common.errors import UserError
from fpg_bench.envs.sb3_vec_env import VecMemory
from fpg_bench.evaluation.policy_evaluator import PolicyEvaluator
from fpg_bench.evaluation.suite import Scale
from fpg_bench.game.scenario import as_scenario, preset
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import load_agent, read_card, write_agent
from fpg_bench.players.scripted import player_noise
from fpg_bench.products.checkers import check_player
from fpg_bench.products.rendering.watching import watch
from fpg_bench.products.teams.core import make_team
from fpg_bench.products.teams.match import play_teams
from fpg_bench.products.teams.pettingzoo_env import TeamParallelEnv
from fpg_bench.products.teams.rules import TEAM_ID, TEAM_SCRIPTS, TeamRules
from fpg_bench.products.teams.scripts import as_team_player
from fpg_bench.products.teams.spec import TeamSpec
from fpg_bench.training.export import Graph, draw_choices, rows_of
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import make_model
from fpg_bench.training.run import Run
from tests.policies import model, node, value, weights
from tests.programs import fpg
from tests.training.tiny import settings, train_tiny

TEAM = "FPG/team_v0"
SHORT = {"scenario": "link", "side": "ally", "opponent": "tone"}
LINK = preset("link")
SHORT_ROUND = as_scenario("link", steps_per_round=20)
ABOUT = {"algorithm": "mine", "training_seed": 0, "training_steps": 10}


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
    assert card.game == TeamSpec.of(against=["tone", "assign"], actions="discrete", mates="none", side="ally")
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
    assert np.array_equal(once, again)
    mixed = play_teams([agent, "cdma", agent], ["tone"], LINK, TeamRules(), 2)
    assert not np.array_equal(once, mixed)
    team = make_team(2, side="opponent", against=[agent, "listen"])
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
        team = make_team(2, side="opponent", against=str(blind / "agent"), mates={"ally": mates})
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
    with pytest.raises(UserError, match=message):
        make_team(1, side="opponent", against=str(blind / "agent"), **options)


@pytest.mark.slow
def test_an_agent_whose_mates_told_it_more_is_refused_in_one_line(blind, tmp_path):
    card = read_card(blind / "agent").to_dict()
    card["skills"]["mates"] = "full"
    write_agent(tmp_path / "told", blind / "agent" / "policy.onnx", **card)
    with pytest.raises(UserError, match="trained with mates='full', here they tell 'place'"):
        make_team(1, side="opponent", against=str(tmp_path / "told"), mates={"ally": "place"})


@pytest.mark.slow
def test_a_team_agent_is_refused_in_a_duel_and_by_the_other_side(blind):
    agent = str(blind / "agent")
    with pytest.raises(UserError, match="plays a seat of a team, not a duel"):
        fpg_bench.make_sb3("FPG/OpponentVsPolicy-v0", ally=agent, scenario="link")
    with pytest.raises(UserError, match="plays the ally"):
        as_team_player(agent, "opponent", LINK, TeamRules())


@pytest.mark.slow
def test_a_team_agent_of_others_is_refused_in_one_line(blind):
    with pytest.raises(UserError, match="plays FPG/team_v0, and agents of others play the duel alone"):
        load_agent(blind / "agent", trusted=False)


def seats_policy() -> bytes:
    """A policy of another framework for a seat: a product with constant weights, and drawn noise."""
    nodes = [
        node("MatMul", ["observation", "w"], ["mean"]),
        node("Add", ["mean", "noise"], ["drawn"]),
        node("Tanh", ["drawn"], ["action"]),
    ]
    return model(nodes, [weights(rows=67, scale=0.1)], [value("observation", 67), value("noise", 9)])


def test_a_policy_of_another_framework_plays_the_seats_of_a_team(tmp_path, capsys):
    write_agent(tmp_path / "three", seats_policy(), id=TEAM, side="ally", sample=True, **ABOUT)
    card = read_card(tmp_path / "three")
    assert (card.side, card.scenario) == ("ally", LINK.hash)
    assert card.skills == {"seats": {"allies": [3, 3], "jammers": [2, 2]}, "mates": "full"}
    check_player(tmp_path / "three", "ally")
    suite = "team-ally-link-v1"
    (row,) = fpg_bench.evaluate({"mine": str(tmp_path / "three")}, suite, matches=1)
    assert (row.entry, row.training.steps) == ("mine", 10)
    write_agent(tmp_path / "two", seats_policy(), id=TEAM, side="ally", allies=2, jammers=1, **ABOUT)
    capsys.readouterr()
    (measures,) = watch(tmp_path / "two", "watchful", every=100, seed=3)  # in its own game
    played = play_teams([tmp_path / "two"], ["watchful"], LINK, TeamRules(2, 1), 1, seeds=3)
    assert measures["ally_return"] == pytest.approx(played[0] * 300)
    heads = capsys.readouterr().out.splitlines()[3]
    assert re.findall(r"\w+_\d", heads) == ["ally_0", "ally_1", "opponent_0"]


@pytest.mark.parametrize("skills", [5, {"seats": {}}, {"seats": {"allies": [1, 2]}}, {"seats": 5}])
def test_skills_that_do_not_say_both_sizes_are_one_line(skills, tmp_path):
    about = ABOUT | {"id": TEAM, "side": "ally", "skills": skills}
    with pytest.raises(UserError, match=r"skills: (seats: )?(lacks|expected a mapping)"):
        write_agent(tmp_path / "three", seats_policy(), **about)


@pytest.mark.parametrize("side", ["ally", "opponent"])
def test_scripts_of_teams_keep_to_the_contract_and_those_that_do_not_are_named(side, capsys):
    for name in TEAM_SCRIPTS[side]:
        check_player(name, side, game=TEAM)
    assert capsys.readouterr().out.count("keeps to the contract") == len(TEAM_SCRIPTS[side])
    script = as_team_player(TEAM_SCRIPTS[side][-1], side, LINK, TeamRules())
    script.predict = lambda seen, *_: (np.full((len(seen), 9), 2.0), None)
    with pytest.raises(AssertionError, match=r"actions reach 2; clip them"):
        check_player(script, side, game=TEAM)


def test_a_round_of_teams_is_played_by_the_verb_and_drawn(tmp_path):
    run = fpg("play", "--id", TEAM, "--ally", "cdma", "--opponent", "combs", "--every", "150")
    assert run.returncode == 0, run.stderr
    lines = run.stdout.splitlines()
    assert [line.split()[0] for line in lines[4:6]] == ["150", "300"]
    assert "spreading 100.0%" in lines[-1]
    out = tmp_path / "round.png"
    watch("cdma", "combs", id=TEAM, out=out)
    assert out.read_bytes()[1:4] == b"PNG"
    refused = {"id": TEAM, "rounds": 2}, {"id": TEAM, "out": "round.html"}, {"id": "FPG/AllyVsScripted-v0"}
    for options in refused:
        with pytest.raises(UserError):
            watch("cdma", "combs", **options)


def test_a_model_of_supersuits_games_is_exported_for_the_seats_of_a_team(tmp_path):
    supersuit = pytest.importorskip("supersuit")
    for actions in ("continuous", "discrete"):
        env = supersuit.pettingzoo_env_to_vec_env_v1(TeamParallelEnv(side="ally", actions=actions))
        env = supersuit.concat_vec_envs_v1(env, 1, base_class="stable_baselines3")
        trained = PPO("MlpPolicy", env, n_steps=8, batch_size=8, device="cpu")
        with pytest.raises(UserError, match=r"game=(GameSpec.of\('FPG/team_v0', side='ally'\))$") as refused:
            fpg_bench.export_agent(trained, tmp_path / actions, training_seed=0)
        assert GameSpec.of("FPG/team_v0", side="ally") == eval(str(refused.value).partition("game=")[2])
        game = TeamSpec.of(side="ally", actions=actions)
        assert fpg_bench.export_agent(trained, tmp_path / actions, training_seed=0, game=game) < 1e-4
        agent = load_agent(tmp_path / actions)
        assert agent.card.sample
        assert agent.noise_size == (9 if actions == "continuous" else 1)
        assert play_teams([agent], ["tone"], SHORT_ROUND, TeamRules(), 1).size == 1


def test_a_live_model_of_a_team_is_exported_before_it_plays():
    games = fpg_bench.make_sb3(TEAM_ID, 2, seed=0, **SHORT)
    model = make_model("ppo", games, load_hyperparameters("ppo", games.game_spec, settings("ppo")), 0)
    with pytest.raises(UserError, match="ally PPO: plays a seat of a team, which draws its actions"):
        make_team(1, side="opponent", against=model)


@pytest.mark.parametrize("actions", ["continuous", "discrete", "multi-discrete", "discrete-uniform"])
def test_an_exported_agent_draws_what_the_model_draws(actions, tmp_path):
    game = TeamSpec.of(**{**SHORT, "actions": actions})
    parameters = load_hyperparameters("ppo-stack2", game, settings("ppo"))
    model = make_model("ppo-stack2", fpg_bench.make_sb3(game, 4, 0), parameters, 0)
    assert fpg_bench.export_agent(model, tmp_path, training_seed=0) < 1e-4
    agent, choices = load_agent(tmp_path), model.get_env().get_attr("core")[0].choices
    seen, keys = np.random.default_rng(0).uniform(-1, 1, (200, 67)).astype(np.float32), np.arange(200)
    noise = torch.from_numpy(player_noise(keys.astype(np.uint64), 0 * keys, agent.noise_size))
    stacked = torch.from_numpy(np.concatenate([0 * seen, seen], 1))
    with torch.no_grad():
        drawn = model.policy.get_distribution(stacked).distribution
        if choices is None:
            expected = (drawn.mean + drawn.stddev * noise).clamp(-1, 1).numpy()
        else:
            parts = drawn if isinstance(drawn, list) else [drawn]
            shares = torch.distributions.Normal(0, 1).cdf(noise[:, -len(parts) :])
            chosen = [
                (part.probs.cumsum(1) < share[:, None]).sum(1)
                for part, share in zip(parts, shares.T, strict=True)
            ]
            chosen = torch.stack(chosen, 1).numpy()
            point = noise[:, :1].numpy() if choices.is_drawn else None
            expected = choices.decode(chosen if choices.is_multi else chosen[:, 0], seen, noise=point)
    answers, _ = _seated(agent, keys).predict(seen)
    alike = np.isclose(expected, answers, atol=1e-5).all(axis=1)
    assert alike.mean() > 0.98  # rounding decides where a draw lies between two choices
    assert len(np.unique(np.round(answers, 3), axis=0)) > 5


def test_choices_are_drawn_by_their_probabilities_and_forbidden_ones_never():
    values = np.array([[-1e30, 0.0, 1.0, -1e30, 2.0, -1e30]], np.float32)
    graph = Graph()
    graph.add(
        "Gather",
        graph.constant(np.eye(6, dtype=np.float32)),
        draw_choices(graph, "observation", 6, 0),
        to="action",
    )
    inputs = [rows_of("observation", 6), rows_of("noise", 1)]
    session = onnxruntime.InferenceSession(graph.to_bytes(inputs, [rows_of("action", 6)]))

    def draw(noise):
        feeds = {"observation": np.tile(values, (len(noise), 1)), "noise": noise}
        return session.run(None, feeds)[0].argmax(1)

    noise = np.random.default_rng(0).standard_normal((20_000, 1), np.float32)
    counts = np.bincount(draw(noise), minlength=6) / 20_000
    assert np.allclose(counts, torch.softmax(torch.from_numpy(values[0]), 0), atol=0.015)
    assert draw(np.array([[-9.0], [9.0]], np.float32)).tolist() == [1, 4]


@pytest.mark.parametrize(
    ("algorithm", "options", "message"),
    [
        ("dqn", {"actions": "discrete"}, "draw their actions from a distribution, which DQNPolicy lacks"),
        ("sac", {}, "draw their actions from a distribution, which SACPolicy lacks"),
        ("ppo", {"allies": 6}, "allies: expected a whole number from 1 to 5"),
        ("ppo", {"side": None, "opponent": None}, "got FPG/team_v0 without a side"),
    ],
)
def test_what_cannot_be_trained_is_refused_in_one_line(algorithm, options, message, tmp_path):
    with pytest.raises(UserError, match=message):
        train_tiny(algorithm, tmp_path / "run", {"normalize": None}, env_id=TEAM, **(SHORT | options))
    assert not (tmp_path / "run" / "run.json").exists()


def test_the_suite_of_a_training_has_the_sizes_of_its_teams():
    game = TeamSpec.of(side="opponent", allies=2, jammers=1)
    suite = PolicyEvaluator("team-opponent-link-v1", 1, LINK, "opponent", game=game).suite
    assert (suite.game.allies, suite.game.jammers) == (2, 1)
    assert suite.scale == Scale()
    assert PolicyEvaluator("team-opponent-link-v1", game=TeamSpec.of(side="opponent")).suite.scale != Scale()


def test_a_team_has_no_memory():
    with pytest.raises(UserError, match="memory: needs the 15 numbers"):
        VecMemory(fpg_bench.make_sb3("FPG/team_v0", side="ally"))
