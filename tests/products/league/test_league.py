"""Best responses, self-play and champions: opponents, starting weights, results, and resumption."""

import dataclasses
import json
import logging

import pytest
import train_champions
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import SCRIPTS
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.evaluation.suite import Rival, Scale, load_suite
from fpg_bench.game.scenario import PAPER, STANDARD, as_scenario
from fpg_bench.players.agent import load_agent
from fpg_bench.products.league import best_responses as responding
from fpg_bench.products.league import champions as championing
from fpg_bench.products.league import double_oracle as searching
from fpg_bench.products.league import evaluation, targets
from fpg_bench.products.league.config import BestResponseConfig
from fpg_bench.products.league.double_oracle import double_oracle
from fpg_bench.products.league.verbs import best_response
from tests.training.tiny import settings, train, train_tiny

OPPONENT = "FPG/OpponentVsScripted-v0"
LIMITS = {"jamming_types": ["tone", "comb"], "knowledge": "none"}
TINY = settings("ppo", normalize={"norm_obs": False})


@pytest.fixture(scope="module", autouse=True)
def few_matches():
    """Few matches in each evaluation."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(responding, "MATCHES", 5)
        patched.setattr(responding, "FINAL_MATCHES", 5)
        yield


@pytest.fixture
def trained(monkeypatch):
    """The runs that a league trains, in their order."""
    runs, real = [], responding.train

    def record(config, out, **options):
        runs.append(config)
        return real(config, out, **options)

    monkeypatch.setattr(responding, "train", record)
    return runs


def interrupt(*arguments, **options):
    raise KeyboardInterrupt


# Evaluation


@pytest.mark.parametrize(
    ("side", "scenario", "suite"),
    [
        ("ally", STANDARD, "ally-v2"),
        ("ally", as_scenario(None, opponent_path=("circle", "pursuit")), "ally-v2"),
        ("opponent", as_scenario(None, opponent_path="learned"), "opponent-learned-v2"),
        ("ally", PAPER, None),
        ("ally", as_scenario(None, hop_cost=41), None),
    ],
)
def test_scores_are_on_the_scale_of_the_side_s_public_suite_in_its_own_scenario(side, scenario, suite):
    other = "adaptive" if side == "ally" else "expert"
    player = "idle" if side == "ally" else "tone"
    summary = evaluation.evaluate_against(player, {"it": other}, side, scenario, matches=1)
    assert summary.suite.scale == (Scale() if suite is None else load_suite(suite).scale)


@pytest.mark.parametrize("seeds", [None, tuning_seeds])
def test_the_evaluation_equals_that_of_a_suite_with_the_same_players(seeds):
    suite = dataclasses.replace(load_suite("ally-v2"), matches=10)
    others = {"mine": "tone", "yours": "comb"}
    summary = evaluation.evaluate_against("idle", others, "ally", STANDARD, matches=10, seeds=seeds)
    for name, other in (("mine", "tone/pursuit"), ("yours", "comb/pursuit")):
        record = play(player_entry("idle"), suite, suite.named(other), seeds)
        assert summary.by_rival[name].value == suite.rewards(record.returns).mean()


# Best responses


@pytest.fixture(scope="module")
def ally(tmp_path_factory):
    """The agent of a tiny ally."""
    return train_tiny("ppo", tmp_path_factory.mktemp("responses") / "ally", steps=400)


@pytest.fixture(scope="module")
def result(ally):
    """The results of two best responses to it."""
    return respond(ally, ally.parent.parent / "responses", n_seeds=2)


def respond(agent, out, **options):
    given = {"agent": str(agent), "hyperparams": settings("ppo"), "steps": 400, "n_seeds": 1}
    return responding.best_responses(BestResponseConfig(**given | options), out, progress=False)


def run_folder(out, seed, steps=400, algorithm="ppo"):
    return out / f"{algorithm}-{steps}" / f"seed_{seed}"


def rows_of(out):
    return RowFile(out / responding.ROWS).read()


def trained_rows(out):
    return [row for row in rows_of(out) if row["method"] == "training"]


@pytest.mark.slow
def test_a_response_may_choose_from_a_list_beside_those_that_do_not(ally, result, tmp_path):
    out = tmp_path / "responses"
    respond(ally, out)
    found = respond(ally, out, actions="discrete")
    names = ["ppo-400/seed_0/agent", "ppo-discrete-400/seed_0/agent"]
    assert [row["response"] for row in trained_rows(out)] == names
    agent = load_agent(out / names[1], "opponent")
    assert agent.card.game.actions == "discrete"
    assert respond(ally, out, actions="discrete") == found


@pytest.mark.slow
def test_a_response_to_an_opponent_plays_for_itself(tmp_path, capsys, caplog):
    caplog.set_level(logging.INFO)
    options = {"steps": 400, "n_seeds": 1, "hyperparams": settings("ppo")}
    best_response("tone", tmp_path / "out", options=options, game={})
    result = json.loads((tmp_path / "out" / "best_responses.json").read_text())
    assert result["reward"] == "own"
    found = result["returns"]["tone"]
    assert found["method"] == "script"  # 400 steps train nothing
    *_, kept, lowest, hint = capsys.readouterr().out.splitlines()
    assert kept.startswith(f"tone: {found['return']:.2f} [")
    assert lowest.startswith(f"lowest: {found['return']:.2f} per step, tone; ")
    assert hint.startswith(f"{found['response']} is stronger than these responses")
    earned = trained_rows(tmp_path / "out")[0]["returns"]["tone"]
    told = [line for line in caplog.messages if "spent" in line]
    assert told[0].startswith(f"strongest of {len(SCRIPTS['ally'])}, ")
    assert told[1].startswith(f"ppo-400/seed_0/agent: lowest {earned:.2f} per step; spent ")


@pytest.mark.slow
def test_the_player_s_returns_against_responses_and_scripts_are_reported(ally, result):
    out = ally.parent.parent / "responses"
    assert json.loads((out / "best_responses.json").read_text()) == result
    suite = dataclasses.replace(load_suite("ally-v2"), matches=5)

    def kept(response, seeds=None):
        rival = Rival("it", (response,), suite.scenario)
        return suite.rewards(play(player_entry(str(ally)), suite, rival, seeds).returns).mean()

    for seed, row in enumerate(trained_rows(out)):
        assert (row["steps"], row["answers"]) == (400, str(ally))
        agent = run_folder(out, seed) / "agent"
        about = load_agent(agent, "opponent").card.to_dict()
        assert (about["training_seed"], about["training_steps"]) == (seed, 400)
        game = {"id": "FPG/OpponentVsScripted-v0", "ally": str(ally), "path": "pursuit", "reward": "zero_sum"}
        assert about["game"] == game | {"id": "FPG/OpponentVsPolicy-v0"}
        assert row["returns"][str(ally)] == pytest.approx(kept(str(agent), tuning_seeds), abs=1e-4)
    assert result["policies"] == {str(ally): load_agent(ally).card.policy_sha256}
    scripts = [row["response"] for row in rows_of(out) if row["method"] == "script"]
    assert scripts == list(SCRIPTS["opponent"])
    strongest = min(rows_of(out), key=lambda row: row["returns"][str(ally)])
    found = result["returns"][result["lowest"]]
    assert (found["response"], found["seconds"]) == (strongest["response"], strongest["seconds"])
    assert found["response"] in scripts
    assert found["return"] == pytest.approx(kept(found["response"]), abs=1e-4)  # on evaluation seeds


@pytest.mark.slow
def test_finished_responses_are_not_trained_again_and_others_can_be_added(ally, result, trained):
    out = ally.parent.parent / "responses"
    before = rows_of(out)
    assert respond(ally, out, n_seeds=2) == result
    assert not trained
    respond(ally, out, n_seeds=3)
    respond(ally, out, steps=800)
    respond(ally, out, algorithm="ppo-stack2")
    added = [("ppo", 400, 2), ("ppo", 800, 0), ("ppo-stack2", 400, 0)]
    assert [(run.algorithm, run.steps, run.seed) for run in trained] == added
    names = [f"{algorithm}-{steps}/seed_{seed}/agent" for algorithm, steps, seed in added]
    assert [row["response"] for row in rows_of(out)[len(before) :]] == names
    assert rows_of(out)[: len(before)] == before
    with pytest.raises(UserError, match="holds another run"):  # of this budget and seed
        respond(ally, out, hyperparams=settings("ppo", gamma=0.5))
    for other, options, what in (
        ("expert", {}, "policies"),
        (ally, {"game": {"path": "learned"}}, "scenario"),
        (ally, {"reward": "own"}, "reward"),
    ):
        with pytest.raises(UserError, match=f"holds best responses with another {what}"):
            respond(other, out, **options)


@pytest.mark.slow
def test_an_interrupted_command_goes_on(ally, tmp_path, monkeypatch):
    for place in (f"{targets.__name__}.evaluate_against", f"{responding.__name__}.train"):
        with monkeypatch.context() as patched:
            patched.setattr(place, interrupt)
            with pytest.raises(KeyboardInterrupt):
                respond(ally, tmp_path / "out")
        # The folder is taken before anything is played
        assert (tmp_path / "out" / "best_responses.json").exists()
    respond(ally, tmp_path / "out")
    assert (run_folder(tmp_path / "out", 0) / "agent" / "agent.json").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("env_id", "options", "scenario", "path"),
    [
        (OPPONENT, {"path": "learned"}, as_scenario(None, opponent_path="learned"), "learned"),
        (OPPONENT, {"path": ["circle", "triangle"]}, STANDARD, "pursuit"),
        (OPPONENT, {"scenario": "paper"} | LIMITS, as_scenario(PAPER, **LIMITS), "pursuit"),
        ("FPG/AllyVsPlanner-v0", {"planner": "circle"}, STANDARD, "pursuit"),
    ],
)
def test_the_game_is_that_of_the_agent_s_training(env_id, options, scenario, path, tmp_path, monkeypatch):
    agent = train("ppo", env_id, tmp_path / "agent", hyperparams=settings("ppo"), steps=400, **options)
    configs = []
    monkeypatch.setattr(responding, "train", lambda config, *a, **k: configs.append(config) or interrupt())
    with pytest.raises(KeyboardInterrupt):
        respond(agent, tmp_path / "out")
    result = json.loads((tmp_path / "out" / "best_responses.json").read_text())
    assert (result["path"], result["scenario"]) == (path, scenario.hash)
    assert configs[0].spec.resolve() == scenario
    assert configs[0].spec.sides == ({"ally": "opponent", "opponent": "ally"}[result["side"]],)
    with pytest.raises(KeyboardInterrupt):
        respond(agent, tmp_path / "figures", game={"scenario": "figures"})
    kept = {name: options[name] for name in LIMITS if name in options}
    other = as_scenario("figures", opponent_path=path, rounds_per_match=1, **kept)
    assert configs[1].spec.resolve() == other


@pytest.mark.slow
def test_an_agent_brings_its_scenario_whatever_becomes_of_the_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "mine.yml"
    file.write_text(yaml.safe_dump({"hop_cost": 20}))
    agent = train_tiny("ppo", tmp_path / "agent", steps=400, scenario="mine.yml")
    trained_in = as_scenario("mine.yml").hash
    file.write_text(yaml.safe_dump({"hop_cost": 30}))
    assert respond(agent, tmp_path / "out")["scenario"] == trained_in
    now = as_scenario("mine.yml").hash
    assert respond(agent, tmp_path / "other", game={"scenario": "mine.yml"})["scenario"] == now != trained_in


@pytest.mark.slow
def test_a_script_can_be_the_player_if_its_side_is_clear(tmp_path):
    for options, message in (
        ({}, "plays both sides; set side to ally or opponent"),
        ({"side": "alli"}, "expected one of ally, opponent, got 'alli'; did you mean 'ally'"),
    ):
        with pytest.raises(UserError, match=message):
            respond("random", tmp_path / "out", **options)
    assert respond("random", tmp_path / "out", side="ally")["side"] == "ally"


# Champions


ORACLE = {
    "verb": "double-oracle",
    "side": "ally",
    "actions": "uniform-hop",
    "iterations": 2,
    "steps": 400,
    "response_steps": 300,
    "algorithm": "ppo",
    "response_algorithm": "ppo",
    "response_actions": "discrete",
    "against": ["tone", "suite:training-1/o01"],
    "weight": 2,
    "patience": 1,
}


def load_champion(folder, **changes):
    file = folder / "champions.yml"
    file.write_text(json.dumps({"brave": {**ORACLE, **changes}}))  # JSON is YAML
    return championing.load_champions(file)["brave"]


@pytest.mark.full
@pytest.mark.slow
def test_a_champion_of_a_double_oracle_is_shipped_from_a_finished_search_wherever_it_was_made(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(searching, "MATCHES", 3)
    champion = load_champion(tmp_path)
    rivals = ["tone", "training-1/opponent/o01"]
    search = tmp_path / "elsewhere"
    made = double_oracle(dataclasses.replace(champion.config, seed=3, against=rivals), search, progress=False)
    (tmp_path / "runs" / "brave").mkdir(parents=True)
    search.rename(tmp_path / "runs" / "brave" / "seed_3")
    monkeypatch.setattr(searching, "train", interrupt)
    agent = champion.train(3, tmp_path / "runs" / "brave" / "seed_3")
    champion.ship(agent, tmp_path / "out", 3, "make brave")
    card = load_agent(tmp_path / "out", "ally").card.to_dict()
    assert (card["command"], card["training_seed"]) == ("make brave", 3)
    assert card["training_steps"] == 400 * (made["iteration"] + 1)
    assert card["recipe"] == {"name": "brave", **ORACLE}
    responses = ["runs/response_0_0/agent"] * 2 if made["iteration"] else []
    assert card["game"]["opponent"] == ["tone", "training-1/opponent/o01", *responses]
    assert str(tmp_path) not in json.dumps(card)
    file = tmp_path / "scores.jsonl"
    file.write_text('{"seed": 3, "iteration": 5}\n{"seed": 4, "iteration": 0}\n')
    searching.keep_search(agent.parent, file)
    *rows, other = RowFile(file).read()
    assert other == {"seed": 4, "iteration": 0}
    assert [row["confirmed"] for row in rows] == [
        made["confirmed"].get(str(row["iteration"])) for row in rows
    ]
    assert [row["low"] for row in rows] == [row["low"] for row in made["rows"]]
    keys = ("scenario", "verb", "meta_solver", "steps", "response_steps")
    assert {tuple(row[key] for key in keys) for row in rows} == {
        ("standard", "double-oracle", "weights", 400, 300)
    }


def test_an_invalid_champion_is_refused_in_one_line(tmp_path):
    for changes, message in (
        ({"step": 3}, "unknown key 'step'; did you mean 'steps'"),
        ({"game": {"pth": "circle"}}, "game: unknown key 'pth'; did you mean 'path'"),
        ({"verb": "oracle"}, "expected one of double-oracle, rule-search, tabular-self-play, got 'oracle'"),
        ({"verb": "tabular-self-play"}, "unknown key 'side'"),
    ):
        with pytest.raises(UserError, match=message):
            load_champion(tmp_path, **changes)


def test_a_champion_of_an_earlier_revision_is_trained_there(tmp_path):
    file = tmp_path / "champions.yml"
    file.write_text("old: abc1234\n")
    with pytest.raises(UserError, match="old is trained at revision abc1234; check it out and run this"):
        train_champions.main("old", file=file, runs=tmp_path / "runs")
    assert not (tmp_path / "runs").exists()
