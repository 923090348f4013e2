"""Cards of agents."""

import hashlib
import json
from pathlib import Path

import pytest
import yaml

from fpg_bench import GameSpec, Scenario, preset, write_agent
from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.agent import baselines_folder
from fpg_bench.players.card import AgentCard
from fpg_bench.products.rendering.watching import watch
from tests.policies import policy
from tests.programs import fpg
from tests.training.tiny import settings, train_tiny

SHIPPED = [path for part in ("agents", "suites") for path in (baselines_folder() / part).rglob("agent.json")]
OWN = {"hop_cost": 55.0, "steps_per_round": 20, "check_interval_s": [2, 3]}


def test_every_shipped_card_is_read_names_its_policy_and_knows_its_scenario():
    assert len(SHIPPED) > 300
    for path in SHIPPED:
        card = AgentCard.read(path)
        assert card.played().hash == card.scenario, path
        assert card.side == json.loads(path.read_text())["side"], path
        assert card.describes((path.parent / "policy.onnx").read_bytes()), path


def test_a_card_survives_writing(tmp_path):
    for path in SHIPPED[::40]:
        card = AgentCard.read(path)
        card.write(tmp_path)
        again = AgentCard.read(tmp_path / "agent.json")
        assert json.loads((tmp_path / "agent.json").read_text())["format"] == 2
        assert again.to_dict() == card.to_dict()
        assert (again.game, again.model_extra) == (card.game, card.model_extra)


def test_a_card_is_played_where_it_was_trained_but_for_a_path_of_its_own():
    by_name = {path.parent.relative_to(baselines_folder()).as_posix(): path for path in SHIPPED}
    for name, home, flies in (
        ("agents/ally-scripted/ppo/seed_0", STANDARD, "pursuit"),
        ("agents/ally-planner/ppo/seed_0", STANDARD, "pursuit"),
        ("agents/opponent-learned/ppo/seed_0", STANDARD, "learned"),
        ("agents/ally-link/dqn/seed_0", preset("link"), "pursuit"),
    ):
        card = AgentCard.read(by_name[name])
        assert (card.home(), card.flies) == (home, flies), name
        assert card.fits(home)
        assert not card.fits(preset("paper"))


@pytest.fixture
def own(tmp_path, monkeypatch):
    """An ally of a scenario of its own, beside an opponent of ``standard``."""
    monkeypatch.chdir(tmp_path)
    scenario = Scenario.from_dict(OWN)
    given = {"algorithm": "linear", "training_seed": 0, "training_steps": 1}
    write_agent(
        "mine/ally",
        policy(0),
        **given,
        id="FPG/AllyVsScripted-v0",
        scenario=scenario.hash,
        scenario_fields=scenario.to_dict(),
    )
    write_agent("mine/opponent", policy(1), **given, id="FPG/OpponentVsPolicy-v0")
    return "mine/ally"


def test_an_agent_is_watched_in_the_scenario_of_its_training(own, capsys, caplog):
    caplog.set_level("INFO", "fpg_bench")
    (alone,) = watch(own, "tone", seed=1)
    assert "in which mine/ally was trained" in caplog.text
    assert "hop_cost" in caplog.text
    (named,) = watch(own, "tone", seed=1, scenario=Scenario.from_dict(OWN))
    assert alone == named != watch(own, "tone", seed=1, scenario="standard")[0]
    with pytest.raises(UserError, match="the two agents were trained in different ones; name one"):
        watch(own, "mine/opponent")


def test_an_opponent_that_flies_is_watched_flying():
    agent = "opponent-learned/ppo/seed_0"
    assert watch("idle", agent, every=300) == watch("idle", agent, every=300, path="learned")
    assert watch("idle", agent, every=300, path="pursuit") != watch("idle", agent, every=300)


def test_a_table_says_which_agents_were_trained_elsewhere(own, tmp_path):
    content = {"side": "ally", "scenario": "standard", "matches": 1, "rivals": [{"opponent": "tone"}]}
    (tmp_path / "small-v1.yml").write_text(yaml.safe_dump(content))
    results = evaluate(["idle", own, "ally-scripted/ppo/seed_0"], "small-v1.yml", "out")
    assert "Trained in another scenario than the suite's: linear." in results.table()
    results = evaluate(["ally-scripted/ppo/seed_0"], "small-v1.yml", "other")
    assert "another scenario" not in results.table()


def test_a_scenario_that_cannot_be_told_is_named_by_the_caller(own):
    file = Path("mine/ally/agent.json")
    content = json.loads(file.read_text())
    for change in ({"scenario": "0" * 64}, {"scenario_fields": {"hop_cost": -1}}):
        file.write_text(json.dumps(content | change))
        with pytest.raises(UserError, match=r"ally mine/ally: .*; name the scenario"):
            watch(own, "tone")
        watch(own, "tone", scenario="standard", every=300)


@pytest.mark.slow
def test_a_run_in_ones_own_scenario_is_played_there_by_every_way(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.yml").write_text(yaml.safe_dump(OWN))
    agent = train_tiny("ppo", tmp_path / "run", scenario="own.yml")
    (tmp_path / "own.yml").unlink()  # the agent carries its scenario
    card = AgentCard.read(agent / "agent.json")
    assert card.game == GameSpec("FPG/AllyVsScripted-v0", scenario="own.yml")
    assert card.home() == Scenario.from_dict(OWN)
    assert "in which" in fpg("play", "--ally", str(agent), "--every", "20").stdout
    league = pytest.importorskip("fpg_bench.products.league.best_responses")
    config = league.BestResponseConfig(agent=str(agent), steps=400, n_seeds=1, hyperparams=settings("ppo"))
    found = league.best_responses(config, tmp_path / "responses", progress=False)
    assert found["scenario"] == Scenario.from_dict(OWN).hash
    sha256 = hashlib.sha256((agent / "policy.onnx").read_bytes()).hexdigest()
    assert found["policies"] == {str(agent): sha256}
